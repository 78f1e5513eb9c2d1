"""Error against run time: every basis of a scene's [compare] table against the full model.

The full model runs once; its motion is kept in the user's cache folder under a hash of all it
depends on. The combinations share the mesh, the solid with its factor, the modes and the snapshots;
the offline seconds of one are the sum of the stages it needs, as if it were made alone (its modes
are the first of the largest number asked for).

The indicator needs no full run. At some steps of the steady state the balance of the full model's
own time step is taken at the reduced motion, with its contact forces: r is zero where the basis
holds the full motion. It is measured by the work it can do on the linear structure, relative to
that of the amplitude p of the loads,

    indicator = sqrt(mean_k r_k^T K^-1 r_k / p^T K^-1 p),

the energy norm of the displacement the residual stands for: it has no unit, and neither the mesh
nor the mix of stiff axial and soft transverse forces changes its meaning, as they do that of the
plain norm |r|/|p|. The plain norm is kept beside it, to compare how well the two rank the bases.
"""

from __future__ import annotations

import hashlib
import itertools
import json
import os
import platform
import time as clock
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field, fields, replace
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import scipy.stats

from fenicsrom.arrays import Array
from fenicsrom.errors import AccuracyError, ConvergenceError, SceneError
from fenicsrom.fem.full import full_model
from fenicsrom.files import read_archive, write_archive
from fenicsrom.online.archive import provenance
from fenicsrom.online.load_histories import largest
from fenicsrom.online.measures import errors_percent
from fenicsrom.online.motion import Motion
from fenicsrom.online.scheme import scheme
from fenicsrom.online.simulate import simulate
from fenicsrom.reduction.modes import ComponentModes, SolvedModes, first_modes, solve_modes
from fenicsrom.reduction.snapshots import Snapshots
from fenicsrom.reduction.stages import Reduction
from fenicsrom.scene import Scene, parse_scene, scene_table

if TYPE_CHECKING:
    from fenicsrom.reduction.protocols import Structure

PHASES = 2000  # points of the common grid on which two periods are compared
INSTANTS = 16  # steps of the last period at which the residual is taken
# seconds of a run above which the repeats run two periods only, and are scaled by the number of
# steps
SLOW = 1.0
SHORT_PERIODS = 2


@dataclass(frozen=True)
class Combination:
    """One choice out of each list of [compare]."""

    method: str
    modes: int
    derivatives: str | tuple[str, ...]
    elastic_force: str
    scheme: str

    @property
    def chosen(self) -> str:
        """How the derivatives are chosen, in one word, or their labels."""
        return self.derivatives if isinstance(self.derivatives, str) else " ".join(self.derivatives)

    @property
    def name(self) -> str:
        """All of it in a line."""
        return f"{self.method}, {self.modes}V, {self.chosen}, {self.elastic_force}, {self.scheme}"


@dataclass(eq=False)
class Outcome:
    """What a combination came to.

    Attributes:
        combination: the combination.
        labels: of its coordinates.
        offline: stage -> seconds, as if made alone.
        online: seconds of each timed run.
        timed_periods: periods of a timed run, scaled to the whole one by the number of steps; None:
        the whole run.
        motion: its motion, without coordinates.
        errors: against the full model, in percent; empty without one.
        indicator: residual in the energy norm, relative to the loads.
        residual: plain norm of the residual, relative to the loads.
        failure: why there is no motion; empty if there is.
    """

    combination: Combination
    labels: tuple[str, ...] = ()
    offline: dict[str, float] = field(default_factory=dict)
    online: tuple[float, ...] = ()
    timed_periods: int | None = None
    motion: Motion | None = None
    errors: dict[str, float | None] = field(default_factory=dict)
    indicator: float | None = None
    residual: float | None = None
    failure: str = ""

    @property
    def offline_seconds(self) -> float:
        """All stages."""
        return sum(self.offline.values())

    @property
    def online_seconds(self) -> float:
        """Median of the timed runs."""
        return float(np.median(self.online)) if self.online else float("nan")


@dataclass(eq=False)
class Comparison:
    """All combinations of a scene, with the full model they are measured against.

    Attributes:
        scene: the scene.
        outcomes: one for each combination.
        full: motion of the full model; None if it was not asked for.
        full_run: when and where the full model ran, and whether its motion came from the cache.
        unknowns: free unknowns of the full model.
        compilation: seconds of compilation and of warming up, in no other number.
        warnings: sentences for the user.
    """

    scene: Scene
    outcomes: list[Outcome]
    full: Motion | None
    full_run: dict[str, Any]
    unknowns: int
    compilation: float
    warnings: list[str]

    def rank_correlation(self, name: str = "indicator") -> float | None:
        """Spearman's correlation of the indicator (or `residual`) with the error of the tangential
        amplitude.
        """
        pairs = [
            (getattr(outcome, name), error)
            for outcome in self.outcomes
            if (error := outcome.errors.get("amplitude_tangential")) is not None
            and getattr(outcome, name) is not None
        ]
        return rank_correlation(*zip(*pairs, strict=True)) if len(pairs) > 2 else None

    def speed_up(self, outcome: Outcome) -> float | None:
        """How many times faster than the full model a combination runs online."""
        return self.full.seconds / outcome.online_seconds if self.full and outcome.online else None

    def break_even(self, outcome: Outcome) -> int | None:
        """`break_even` of a combination; None without a full run."""
        if not (self.full and outcome.online):
            return None
        return break_even(outcome.offline_seconds, outcome.online_seconds, self.full.seconds)


# ---------------------------------------------------------------------- arithmetic


def rank_correlation(first: Sequence[float], second: Sequence[float]) -> float | None:
    """Spearman's rank correlation, equal values sharing their mean rank; None if one of the two
    does not vary.
    """
    ranks = np.array([scipy.stats.rankdata(values) for values in (first, second)])
    spread = ranks - ranks.mean(axis=1, keepdims=True)
    size = np.sqrt(np.sum(spread**2, axis=1))
    return float(spread[0] @ spread[1] / (size[0] * size[1])) if size.all() else None


def break_even(offline: float, online: float, full: float) -> int | None:
    """Number of runs after which the offline stage has paid for itself: the least n with offline +
    n online <= n full.

    None if the reduced model is no faster than the full one.
    """
    return max(1, int(np.ceil(offline / (full - online)))) if full > online else None


def pareto_front(costs: Sequence[float], errors: Sequence[float]) -> list[int]:
    """Indices of the points than which no other is both cheaper and more accurate, the cheapest
    first.
    """
    front: list[int] = []
    for k in sorted(range(len(costs)), key=lambda k: (costs[k], errors[k])):
        if not front or errors[k] < errors[front[-1]]:
            front.append(k)
    return front


def motion_errors(motion: Motion, reference: Motion) -> dict[str, float | None]:
    """Errors of the last period against that of a reference, percent.

    Returns:
        What `fenicsrom.online.measures.errors_percent` finds; `history`: L2 norm of the difference of the
        displacements at equal phase, relative to the reference, all points and directions; `state`:
        share of the period in another contact state. None where the reference has nothing to
        compare with.
    """
    shift, other = (
        on_phases(m, m.displacement.reshape(m.time.size, -1)) for m in (motion, reference)
    )
    size = float(np.linalg.norm(other))
    return errors_percent(motion, reference) | {
        "history": 100.0 * float(np.linalg.norm(shift - other)) / size if size > 0.0 else None,
        "state": wrong_state(motion, reference) if reference.state.shape[1] else None,
    }


def on_phases(motion: Motion, values: Array) -> Array:
    """Values (ns, k) of the last period (without one: all), interpolated at `PHASES` equal
    phases.
    """
    part = motion.last_period()
    time = motion.time[part]
    length = motion.period or time[-1] - time[0]
    phases = time[-1] - length + length * np.arange(PHASES) / PHASES
    return np.array([np.interp(phases, time, column) for column in values[part].T]).T


def wrong_state(motion: Motion, reference: Motion) -> float:
    """Share of the last period with a contact state other than the reference's, averaged over the
    points, percent.
    """
    codes = []
    for m in (motion, reference):
        part = m.last_period()
        time = m.time[part]
        length = m.period or time[-1] - time[0]
        phases = time[-1] - length + length * (np.arange(PHASES) + 0.5) / PHASES
        codes.append(
            m.state[part][np.searchsorted(0.5 * (time[1:] + time[:-1]), phases)]
        )  # of the nearest step
    return float(100.0 * np.mean(codes[0] != codes[1]))


# ---------------------------------------------------------------------- the indicator


def residuals(body: Structure, vectors: Array, motion: Motion, scene: Scene) -> Array:
    """Residual (local, k) of the full model's time step at `INSTANTS` steps of the last period of a
    reduced motion.

    Args:
        body: the solid or the beam.
        vectors: (local, n) R.
        motion: with the coordinates of its last period.
        scene: of the motion.
    """
    model = full_model(body)
    plan = scheme(scene.time.scheme, model, scene.time.spectral_radius or 0.0)
    am, af, beta, gamma = plan.alpha_m, plan.alpha_f, plan.beta, plan.gamma
    assert (
        motion.coordinates is not None
        and motion.velocity is not None
        and motion.acceleration is not None
    )
    assert motion.coordinate_time is not None
    time, count = motion.coordinate_time, motion.coordinate_time.size
    first = motion.time.size - count
    rows = body.contact_rows
    found = []
    for k in np.unique(np.linspace(0, count - 2, INSTANTS).round().astype(int)):
        h = time[k + 1] - time[k]
        q, v, a = (
            vectors @ motion.coordinates[k],
            vectors @ motion.velocity[k],
            vectors @ motion.acceleration[k],
        )
        dq = vectors @ (motion.coordinates[k + 1] - motion.coordinates[k])
        a1 = dq / (beta * h * h) - v / (beta * h) - (0.5 / beta - 1.0) * a
        v1 = v + h * ((1.0 - gamma) * a + gamma * a1)
        start = model.elastic_at(q)[0] if plan.start_weight else np.zeros_like(q)
        elastic, _ = model.elastic_over_step(
            start, q, dq, plan.start_weight, plan.points, plan.weights
        )
        inertia = (1.0 - am) * a1 + am * a + plan.damping * ((1.0 - af) * v1 + af * v)
        load = (1.0 - af) * model.load(time[k + 1]) + af * model.load(time[k])
        force = motion.mean_force[first + k + 1].reshape(-1)
        found.append(model.mass_times(inertia) + elastic + rows.T @ force - load)
    return np.array(found).T


def indicators(
    body: Structure, vectors: Array, motion: Motion, scene: Scene
) -> tuple[float, float]:
    """The residual's root mean square in the energy and in the plain norm, relative to the
    amplitude of the loads.
    """
    found = residuals(body, vectors, motion, scene)
    varying = [not load.static for load in scene.loads]
    loads = (
        np.abs(body.load_vectors) @ np.where(varying, largest(body.load_histories), 0.0)[:, None]
    )

    def sizes(block: Array) -> tuple[Array, Array]:
        total = body.comm.allreduce
        return total(np.sum(block * body.factor.solve(block), axis=0)), total(
            np.sum(block**2, axis=0)
        )

    (energy, plain), (load_energy, load_plain) = sizes(found), sizes(loads)
    return float(np.sqrt(np.mean(energy) / load_energy[0])), float(
        np.sqrt(np.mean(plain) / load_plain[0])
    )


# ---------------------------------------------------------------------- the combinations


def combinations(scene: Scene) -> list[Combination]:
    """All combinations of the scene's [compare] table; a linear scene needs neither derivatives nor
    a polynomial.
    """
    table = scene.compare
    schemes = table.schemes or (scene.time.scheme,)
    derivatives, forces = table.derivatives, table.elastic_force
    if not scene.geometrically_nonlinear:
        derivatives, forces = ("none",), ("polynomial",)
    choices = itertools.product(table.methods, table.modes, derivatives, forces, schemes)
    return [Combination(*choice) for choice in choices]


def with_combination(scene: Scene, combination: Combination) -> Scene:
    """The scene with the basis and scheme of a combination.

    Raises:
        SceneError: the combination is impossible, such as derivatives of modes that are not there.
    """
    c, table = combination, scene_table(scene)
    table["basis"] |= {"method": c.method, "modes": c.modes, "elastic_force": c.elastic_force}
    table["basis"]["derivatives"] = (
        c.derivatives if isinstance(c.derivatives, str) else list(c.derivatives)
    )
    if table["time"]["scheme"] != c.scheme:
        table["time"] = {**table["time"], "scheme": c.scheme}
        table["time"].pop("spectral_radius", None)
    return parse_scene(table, scene.source, None)


class Workshop:
    """Makes the reduced models of a body; what combinations have in common is made once, and its
    seconds kept.
    """

    def __init__(self, body: Structure, scene: Scene, seconds: dict[str, float], largest: int):
        """Start from a body, the seconds it took by stage, and the largest number of normal modes
        to come.
        """
        self.body, self._seconds, self._largest = body, dict(seconds), largest
        self._scene = scene
        self._solved: dict[str, tuple[SolvedModes, float]] = {}
        self._modes: dict[tuple[str, int], tuple[ComponentModes, Snapshots]] = {}
        self._taking: dict[tuple[str, int, str], float] = {}

    def reduction(self, scene: Scene) -> tuple[Reduction, dict[str, float]]:
        """What leads to the reduced model a scene asks for, and the seconds of its stages as if it
        were made alone.
        """
        method, count = scene.basis.method, scene.basis.modes
        modes, snapshots, taken = self._component_modes(method, count)
        kinds = {"mmi": ["linear"], "mmi-nls": ["linear", "static"]}.get(
            str(scene.basis.derivatives), []
        )
        shared = sum(
            self._taken(snapshots, (method, count, kind))
            for kind in kinds
            if scene.geometrically_nonlinear
        )
        seconds = {**self._seconds, "modes": taken, "selection": shared}
        return Reduction(self.body, scene, partial(timed, seconds), modes, snapshots), seconds

    def _component_modes(self, method: str, count: int) -> tuple[ComponentModes, Snapshots, float]:
        if method not in self._solved:
            spent: dict[str, float] = {}
            with timed(spent, "solve"):
                solved = solve_modes(
                    self.body, replace(self._scene.basis, method=method, modes=self._largest)
                )
            self._solved[method] = solved, spent["solve"]
        solved, seconds = self._solved[method]
        if (method, count) not in self._modes:
            modes = first_modes(self.body, solved, count)
            self._modes[method, count] = modes, Snapshots(self.body, self._scene, modes)
        return *self._modes[method, count], seconds

    def _taken(self, snapshots: Snapshots, key: tuple[str, int, str]) -> float:
        """Seconds these snapshots took, made now if they were not yet; always with the scheme of
        the scene itself.
        """
        if key not in self._taking:
            spent: dict[str, float] = {}
            with timed(spent, "snapshots"):
                getattr(snapshots, key[2])
            self._taking[key] = spent["snapshots"]
        return self._taking[key]


@contextmanager
def timed(seconds: dict[str, float], stage: str) -> Iterator[None]:
    """Add the run time of the body of a `with` to a stage."""
    begin = clock.perf_counter()
    yield
    seconds[stage] = seconds.get(stage, 0.0) + clock.perf_counter() - begin


def try_out(
    workshop: Workshop,
    scene: Scene,
    combination: Combination,
    full: Motion | None,
    timing: bool = True,
) -> Outcome:
    """Make the model of a combination, run it, time it (or leave that), and measure it against the
    full model.
    """
    outcome = Outcome(combination)
    scene = with_combination(scene, combination)
    try:
        reduction, outcome.offline = workshop.reduction(scene)
        outcome.labels = reduction.basis.labels
        model = reduction.model
        motion = simulate(model, scene, keep_coordinates=True)
        outcome.indicator, outcome.residual = indicators(
            workshop.body, reduction.basis.vectors, motion, scene
        )
        outcome.motion = replace(
            motion, coordinates=None, velocity=None, acceleration=None, coordinate_time=None
        )
        if timing:
            outcome.online, outcome.timed_periods = time_runs(
                model, scene, motion, workshop.body.comm
            )
    except (ConvergenceError, AccuracyError) as error:
        outcome.failure = str(error)
        return outcome
    if full is not None:
        outcome.errors = motion_errors(motion, full)
    return outcome


def time_runs(
    model: Any, scene: Scene, motion: Motion, comm: Any
) -> tuple[tuple[float, ...], int | None]:
    """Seconds of `compare.repeats` runs, and the periods of each where runs are too slow to repeat
    as a whole.
    """
    repeats = scene.compare.repeats
    if (
        comm.bcast(motion.seconds) <= SLOW
        or motion.period is None
        or motion.periods <= SHORT_PERIODS
    ):
        return tuple(simulate(model, scene).seconds for _ in range(repeats)), None
    short = replace(scene, time=replace(scene.time, periods=SHORT_PERIODS, steady_tolerance=0.0))
    runs = (simulate(model, short) for _ in range(repeats))
    return tuple(run.seconds / run.steps * motion.steps for run in runs), SHORT_PERIODS


def compare(scene: Scene, comm: Any, say: Callable[[str], None]) -> Comparison:
    """Compare every combination of a scene's [compare] table with the full model.

    Args:
        scene: the scene.
        comm: MPI communicator of the offline stage and the full model.
        say: is told what happens, a line at a time.

    Raises:
        SceneError: the scene or a combination is impossible.
        ConvergenceError, AccuracyError: the full model or the solid failed; a combination that
        fails is reported.
    """
    from fenicsrom.fem.mesh import build_mesh
    from fenicsrom.fem.solid import solid_of

    if scene.static_only:
        raise SceneError(
            f"{scene.source}: nothing moves in this scene: compare needs a load that varies, or a time.duration"
        )
    scenes = [with_combination(scene, combination) for combination in combinations(scene)]
    largest = max(scene.compare.modes)
    seconds: dict[str, float] = {}
    with timed(seconds, "mesh"):
        mesh = build_mesh(scene.geometry, comm)
    say("compiling and warming up ..")
    cold: dict[str, float] = {}
    warm = Workshop(solid_of(scene, mesh), scene, {}, largest)
    with timed(cold, "compilation"):
        warm_up(warm, scenes[0])
    with timed(seconds, "solid"):
        solid = solid_of(scene, mesh)
    full, full_run = None, {}
    if scene.compare.full:
        full, full_run = full_motion(solid, scene, say)
    outcomes = compare_bases(Workshop(solid, scene, seconds, largest), scene, full, say)
    unknowns = solid.free
    return Comparison(
        scene, outcomes, full, full_run, unknowns, cold["compilation"], solid.warnings
    )


def warm_up(workshop: Workshop, scene: Scene) -> None:
    """Run every stage once for a few steps, so that no later time holds compilation or the filling
    of caches.
    """
    reduction, _ = workshop.reduction(scene)
    short = replace(scene.time, periods=1, steady_tolerance=0.0) if scene.period else scene.time
    simulate(reduction.model, replace(scene, time=short))


def compare_bases(
    workshop: Workshop,
    scene: Scene,
    full: Motion | None,
    say: Callable[[str], None],
    timing: bool = True,
) -> list[Outcome]:
    """Try every combination, and say after each how it went and about how long the rest will
    take.
    """
    wanted = combinations(scene)
    spent: dict[str, list[float]] = {}
    outcomes = []
    for k, combination in enumerate(wanted):
        begin = clock.perf_counter()
        outcome = try_out(workshop, scene, combination, full, timing)
        outcomes.append(outcome)
        spent.setdefault(combination.elastic_force, []).append(clock.perf_counter() - begin)
        mean = {kind: float(np.mean(times)) for kind, times in spent.items()}
        known = max(mean.values())
        left = sum(mean.get(other.elastic_force, known) for other in wanted[k + 1 :])
        error = outcome.errors.get("amplitude_tangential")
        result = outcome.failure or f"{len(outcome.labels)} coordinates"
        result += f", {1e3 * outcome.online_seconds:.3g} ms" if outcome.online else ""
        result += f", error {error:.2g} %" if error is not None else ""
        say(f"{k + 1}/{len(wanted)} {combination.name}: {result}; about {left:.0f} s left")
    return outcomes


# ---------------------------------------------------------------------- the full model and its
# cache


def full_motion(
    body: Structure, scene: Scene, say: Callable[[str], None]
) -> tuple[Motion, dict[str, Any]]:
    """The motion of the full model, from the cache if an equal scene was run before, and when and
    where it ran.
    """
    comm, key = body.comm, cache_key(scene)
    path = cache_folder() / f"full-{key[:32]}.npz"
    found = read_cached(path, key) if comm.rank == 0 else None
    found = comm.bcast(found)
    if found is not None:
        say(f"full model: taken from {path}")
        return found[0], found[1] | {"cached": True}
    say("full model ..")
    last = clock.perf_counter()

    def progress(fraction: float, change: float) -> None:
        nonlocal last
        if clock.perf_counter() - last > 5.0:
            last = clock.perf_counter()
            say(
                f"  full model: {fraction:.0%} of at most {scene.time.periods} periods, change {change:.1e}"
            )

    motion = simulate(full_model(body), scene, progress=progress)
    note = {
        "date": datetime.now(UTC).isoformat(timespec="seconds"),
        "machine": machine(),
        "ranks": comm.size,
    }
    if comm.rank == 0:
        try:
            write_cached(path, key, motion, note)
        except OSError as error:
            say(f"the full model's motion was not kept: {error}")
    return motion, note | {"cached": False}


def cache_folder() -> Path:
    """The folder of this program in the user's cache folder."""
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "fenicsrom"


def cache_key(scene: Scene) -> str:
    """A hash of all that the full model's motion depends on.

    That is the scene without basis and output, the content of the mesh file, and the program, which
    is known by its version, those of the libraries it stands on, and the text of its modules.
    """
    table = scene_table(scene)
    for name in ("title", "basis", "reference", "output", "compare"):
        table.pop(name, None)
    table["geometry"]["mesh"] = hashlib.sha256(scene.geometry.mesh.read_bytes()).hexdigest()
    table["program"] = provenance()
    digest = hashlib.sha256(json.dumps(table, sort_keys=True).encode())
    for module in sorted(Path(__file__).parents[1].rglob("*.py")):
        digest.update(module.read_bytes())
    return digest.hexdigest()


_ARRAYS = [item.name for item in fields(Motion) if item.type == "Array" or item.name == "state"]
_NUMBERS = ["period", "steady", "periods", "steps", "rejected", "newton_iterations", "seconds"]


def write_cached(path: Path, key: str, motion: Motion, note: dict[str, Any]) -> None:
    """Keep a motion; the file appears whole or not at all.

    Raises:
        OSError: it cannot be written.
    """
    header = {"format": key, "note": note, **{name: getattr(motion, name) for name in _NUMBERS}}
    write_archive(path, header, {name: getattr(motion, name) for name in _ARRAYS}, compress=True)


def read_cached(path: Path, key: str) -> tuple[Motion, dict[str, Any]] | None:
    """The motion kept under a key and the note with it; None if there is none, or the file is
    damaged.
    """
    with suppress(SceneError), read_archive(path, "a motion", key) as (header, arrays):
        if all(len(arrays[name]) == header["steps"] + 1 for name in _ARRAYS):
            return Motion(
                **{name: arrays[name] for name in _ARRAYS},
                **{name: header[name] for name in _NUMBERS},
            ), header["note"]
    return None


def machine() -> dict[str, Any]:
    """The processor and how many threads numerical libraries use."""
    name = platform.processor() or platform.machine()
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
        name = next(
            (line.partition(":")[2].strip() for line in lines if line.startswith("model name")),
            name,
        )
    except OSError:
        pass
    threads = os.environ.get("OMP_NUM_THREADS", "not set")
    return {
        "processor": name,
        "cores": os.cpu_count(),
        "system": platform.system(),
        "OMP_NUM_THREADS": threads,
    }

"""Motions of the full model: marched, periodic and kept; the true errors of a reduced model.

A periodic motion is a root of r(z) = P(z) - z with the period map P of the full model
(`fenicsrom.fem.full.full_period`). A full period is by far the most expensive operation, so the
iteration takes as few as it can. With a basis D of some directions, orthonormal in the mass norm,

    dz = D y + (1 - D D^T)(r + P' D y),    (I - D^T P' D) y = D^T r,    (1)

is Newton's step in the span of D, and a full period elsewhere (Lust, Roose, Spence and Champneys
1998, the Newton-Picard method).

At first D spans the reduced basis, and the monodromy matrix of the reduced model takes the place of
D^T P' D. This derivative is enough if the motions that the basis does not span decay within a
period. The stiff vibrations of a solid do not: a scheme that conserves energy keeps them for
thousands of periods. Where the residual does not fall by `GOOD_RATE`, D is enlarged, by normal
modes and then by the residual itself, and the next full period carries P' D along exactly.
"""

from __future__ import annotations

import os
import platform
import re
import time as clock
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from fenicsrom.arrays import Array
from fenicsrom.assess.errors.estimates import MotionErrors, distances
from fenicsrom.errors import AccuracyError, ConvergenceError
from fenicsrom.fem.full.full import FullModel
from fenicsrom.fem.full.full_period import FullPeriodEnd, FullPeriodMap
from fenicsrom.fem.solid.solid import Solid
from fenicsrom.online.model.model import Problem, ReducedModel
from fenicsrom.online.motion.motion import Motion
from fenicsrom.online.periodic.shooting import (
    PeriodicMotion,
    Shooting,
    motion_of,
    solve,
    start_variables,
)
from fenicsrom.online.run.march import end_of
from fenicsrom.online.run.simulate import simulate
from fenicsrom.online.step.state import Record
from fenicsrom.online.store import store
from fenicsrom.progress import log
from fenicsrom.reduction.basis import extended_space
from fenicsrom.scene import Scene, scene_table
from fenicsrom.scene.reading.reading import with_time
from fenicsrom.words import counted

if TYPE_CHECKING:
    from fenicsrom.reduction.protocols import Structure


NOTABLE = 0.01  # an error against the full model must be seen if it is larger
MISSED = 3.0  # times its estimate: an error that was not seen
FULL_PERIODS = 20  # of a full model that starts from the periodic motion of the reduced model


def estimates_found(own: Mapping[str, MotionErrors]) -> dict[str, float]:
    """The estimates of a run by the names of a `fenicsrom.assess.studies.stability.Finding`.

    A finding compares motions at the frequency of the loads, also near a resonance.
    """
    found: dict[str, float] = {}
    if "time step" in own:
        found["estimate"] = max(own["time step"].amplitude, own["time step"].at_frequency)
        found["force_estimate"] = own["time step"].peak_force
    if "basis" in own:
        found["basis_estimate"] = own["basis"].amplitude
    return found


def full_distances(vectors: Array, solid: Any, scene: Scene, motion: Motion) -> MotionErrors:
    """The true errors due to the basis: the distances from the full model at the same time steps.

    The full model starts where the motion ended, if Newton's method found it, and then runs at most
    `FULL_PERIODS`.

    Args:
        vectors: (local, n) vectors of the reduced basis.
        solid: the solid.
        scene: the scene.
        motion: the motion of the reduced model.
    """
    from fenicsrom.fem.full.full import full_model

    start = None
    if motion.newton_from is not None and not motion.buckled and not scene.wears:
        q, v, sliders = end_of(motion)
        start = vectors @ q, vectors @ v, sliders
        scene = with_time(scene, periods=FULL_PERIODS)
    return distances(motion, simulate(full_model(solid), scene, start=start))


def settled_full_motion(
    solid: Any,
    vectors: Array,
    model: ReducedModel,
    scene: Scene,
    motion: Motion,
    full: Motion,
    fresh: bool = False,
    cached: bool = True,
) -> tuple[Motion, str]:
    """The periodic motion of a full model whose march did not settle, and a sentence on it.

    Newton's method starts from the periodic motion of the reduced model. Where the march decays
    slowly, for example near an undamped mode, the march alone would compare a periodic motion with
    a transient.

    Args:
        solid: the solid.
        vectors: (local, n) vectors of the reduced basis.
        model: the reduced model.
        scene: the scene of both motions.
        motion: the motion of the reduced model.
        full: the marched motion of the full model.
        fresh: as in `full_motion`.
        cached: as in `full_motion`.

    Returns:
        The motion, and a sentence. The motion is the marched one, and the sentence is empty, if the
        march has settled or Newton's method did not find the reduced motion.
    """
    is_found = motion.newton_from is not None and motion.steady and not scene.wears
    if full.steady or not is_found or full.period is None:
        return full, ""
    assert motion.search is not None
    shooting = Shooting(Problem.of(model, scene).settled(), motion.search.periods)
    begin = f"the march of the full model did not settle within {counted(full.periods, 'period')}"

    def make() -> Kept:
        try:
            reduced = solve(shooting, shooting.scaled(start_variables(shooting, motion.end)))
            found = full_periodic_motion(solid, vectors, shooting, reduced)
        except ConvergenceError as error:
            return full, {
                "said": f"{begin}; Newton's method did not find its periodic motion either: {error}"
            }
        seconds, periods = full.seconds + found.seconds, full.periods + found.periods
        periodic = motion_of(found.record, reduced.period)
        return replace(periodic, seconds=seconds, periods=periods), {
            "said": f"{begin}; its periodic motion was found by Newton's method in "
            f"{counted(found.periods, 'period')} from that of the reduced model, and its stability "
            "was not examined"
        }

    found, note = _kept(solid.comm, cache_key(scene, "periodic") if cached else None, make, fresh)
    return found, note["said"]


def missed(error: float, estimate: float) -> str:
    """The reason why an estimate counts as too small for its true error, or ""."""
    if error <= max(NOTABLE, MISSED * estimate):
        return ""
    return f"the error against the full model is {error:.1e}, but the estimate is {estimate:.1e}"


FULL_TOLERANCE = 1e-6
"""Of the residual relative to the variables, and of the last step relative to the coordinates.

Both are in the mass norm. Undamped stiff vibrations count by their velocities; their displacements
are smaller than the residual by the ratio of their frequency to that of the loads.
"""

MOST_PERIODS = 40
STALLED = 3  # periods in a row without a smaller residual, after which no motion is found
GOOD_RATE = 0.1  # a step that reduces the residual less asks for derivatives of the full model
RELAXATION = 0.5
"""Part of the residual outside of D that a step with derivatives takes.

A vibration that keeps its size and turns by the angle phi in a period is reduced by cos(phi/2).
"""

NORMAL_MODES = 60  # of the solid, for the first enlargement of the directions
RANK = 1e-8  # singular values below this part of the largest count as zero
UNKNOWNS_PER_MODE = 4  # the eigensolver is not accurate enough for the highest modes of a mesh


@dataclass(frozen=True, eq=False)
class FullPeriodicMotion:
    """A periodic motion of the full model.

    Attributes:
        z: (N,) variables at the start of the period: see `FullPeriodMap`.
        residuals: relative residual after each full period.
        derived: number of full periods that carried derivatives.
        record: rows of the period.
        seconds: run time.
    """

    z: Array
    residuals: tuple[float, ...]
    derived: int
    record: Record
    seconds: float

    @property
    def periods(self) -> int:
        """Number of full periods that were marched."""
        return len(self.residuals)

    @property
    def amplitude(self) -> Array:
        """(P, d) half of peak-to-peak of the displacement, or (1, d) of the probe, m."""
        return np.asarray(np.ptp(self.record.observed, axis=0) / 2.0)


def full_periodic_motion(
    solid: Solid,
    basis: Array,
    shooting: Shooting,
    reduced: PeriodicMotion,
    *,
    tolerance: float = FULL_TOLERANCE,
    most_periods: int = MOST_PERIODS,
) -> FullPeriodicMotion:
    """Find the periodic motion of the full model near one of a reduced model.

    Args:
        solid: the solid.
        basis: (local, n) R, the vectors of the reduced basis.
        shooting: the equation of the reduced motion: it gives contacts, load histories, damping,
            period, scheme and steps.
        reduced: the reduced motion.
        tolerance: tolerance of the residual relative to the variables, in the mass norm.
        most_periods: largest number of full periods.

    Returns:
        The motion; it repeats within the tolerance.

    Raises:
        ConvergenceError: no motion was found; `partial` holds the residuals.
    """
    begin = clock.perf_counter()
    problem = _Problem(solid, basis, shooting)
    residuals: list[float] = []
    derived = 0

    def march(z: Array, block: Array | None = None) -> FullPeriodEnd:
        nonlocal derived
        if len(residuals) >= most_periods or not np.all(np.isfinite(residuals)):
            raise _lost(residuals, f"relative residual {residuals[-1]:.3g}")
        try:
            end = problem.map(z, block)
        except ConvergenceError as error:
            raise _lost(residuals, str(error)) from error
        derived += block is not None
        residuals.append(problem.norm(end.z - z) / max(problem.norm(z), 1e-300))
        if len(residuals) > STALLED and min(residuals[-STALLED:]) >= min(residuals[:-STALLED]):
            raise _lost(residuals, f"{STALLED} periods in a row brought it no nearer")
        log.info(f"  full period {len(residuals)}: relative residual {residuals[-1]:.1e}")
        return end

    z = problem.expanded(shooting.scaled(reduced.z))
    matrix = shooting.scaled_matrix(reduced.end.matrix)
    columns = problem.expanded(matrix)
    end, is_exact = march(z), False
    step, rest = problem.step(matrix, columns, end.z - z)
    while not problem.has_converged(end.z - z, step, z, tolerance):
        if not is_exact:
            before, residual = z, end.z - z
            z = z + step
            end = march(z)
            if residuals[-1] > GOOD_RATE * residuals[-2]:
                is_exact = True
                problem.enlarge(residual, end.z - z)
                z = z if residuals[-1] < residuals[-2] else before
                end = march(z, problem.directions())
        else:
            z = z + step - (1.0 - RELAXATION) * rest
            problem.enlarge(rest)
            end = march(z, problem.directions())
        if is_exact:
            matrix, columns = problem.coordinates(end.columns), end.columns
        step, rest = problem.step(matrix, columns, end.z - z)
    seconds = clock.perf_counter() - begin
    return FullPeriodicMotion(z, tuple(residuals), derived, end.record, seconds)


def _lost(residuals: list[float], reason: str) -> ConvergenceError:
    """The error of a motion that was not found."""
    return ConvergenceError(
        "no periodic motion of the full model was found in "
        f"{counted(len(residuals), 'full period')}: {reason}",
        list(residuals),
        decrements=residuals,
    )


class _Problem:
    """The map of the full model, and the directions D.

    With Q (local, p), orthonormal in the mass norm, the columns of D are those of Q in coordinates,
    velocities and accelerations, and the sliders, scaled as by `Shooting`.
    """

    def __init__(self, solid: Solid, basis: Array, shooting: Shooting):
        """Begin with the span of the basis."""
        self.solid = solid
        problem = shooting.problem
        model = FullModel(solid)
        model.load_histories = problem.model.load_histories
        model.damping = float(problem.model.damping)
        plan = shooting.map.plan._replace(damping=model.damping)
        fractions = shooting.map.fractions
        self.map = FullPeriodMap(problem._replace(model=model), plan, fractions)
        root = np.linalg.cholesky(problem.model.mass)
        self.q = np.asarray(np.linalg.solve(root, basis.T).T, dtype=np.float64)
        shortest = problem.period * float(np.min(np.diff(fractions)))
        self._rates = 1.0, 2.0 * np.pi / problem.period, shortest**-2
        self._slider = np.diag(shooting.scaled(np.eye(shooting.map.size)))
        self._slider = self._slider[shooting.map.blocks * shooting.map.n :]
        self._has_modes = False

    def _blocks(self, z: Array) -> list[Array]:
        """The scaled blocks of variables z (N,) or (N, k): q, v, a and sliders."""
        n, count = self.map.n, self.map.blocks
        parts = [np.asarray(z[k * n : (k + 1) * n] / self._rates[k], float) for k in range(count)]
        return [*parts, (z[count * n :].T * self._slider).T]

    def coordinates(self, z: Array) -> Array:
        """D^T M z of variables z (N,) or (N, k)."""
        *parts, sliders = self._blocks(z)
        columns = [part.reshape(part.shape[0], -1) for part in parts]
        inner = [self.solid.mass_inner(self.q, part).reshape(-1, *z.shape[1:]) for part in columns]
        return np.concatenate([*inner, sliders])

    def expanded(self, y: Array) -> Array:
        """The product D y with coordinates y (k,), or with a block (k, b) of coordinates."""
        p, count = self.q.shape[1], self.map.blocks
        parts = [self.q @ y[k * p : (k + 1) * p] * self._rates[k] for k in range(count)]
        return np.concatenate([*parts, (y[count * p :].T / self._slider).T])

    def directions(self) -> Array:
        """D (N, k)."""
        return self.expanded(np.eye(self.map.blocks * self.q.shape[1] + self.map.memory.size))

    def step(self, matrix: Array, columns: Array, residual: Array) -> tuple[Array, Array]:
        """Newton's step (1) dz (N,), and its part outside of the span of D.

        Args:
            matrix: (k, k) D^T M P' D, exact or of the reduced model.
            columns: (N, k) P' D.
            residual: (N,) r.
        """
        y = _least_squares(np.eye(len(matrix)) - matrix, self.coordinates(residual))
        rest = residual + columns @ y
        rest -= self.expanded(self.coordinates(rest))
        return self.expanded(y) + rest, rest

    def norm(self, z: Array) -> float:
        """Size of variables z (N,)."""
        *parts, sliders = self._blocks(z)
        model = self.map.model
        squares = sum(model.dot(part, model.mass_times(part)) for part in parts)
        return float(np.sqrt(squares + sliders @ sliders))

    def has_converged(self, residual: Array, step: Array, z: Array, tolerance: float) -> bool:
        """Whether a residual and the change of the coordinates by Newton's step are small.

        A residual of a motion that decays slowly may be small far away from the root.
        """
        q, change = self._blocks(z)[0], self._blocks(step)[0]
        model = self.map.model
        moved = np.sqrt(model.dot(change, model.mass_times(change)))
        size = np.sqrt(model.dot(q, model.mass_times(q)))
        return bool(self.norm(residual) <= tolerance * self.norm(z) and moved <= tolerance * size)

    def enlarge(self, *residuals: Array) -> None:
        """Add the parts of residuals (N,), and at the first time normal modes, to Q."""
        new = np.stack([part for z in residuals for part in self._blocks(z)[:-1]], axis=1)
        if not self._has_modes:
            new = np.concatenate([self._normal_modes(), new], axis=1)
            self._has_modes = True
        self.q = extended_space(self.solid.mass_inner, self.q, new)

    def _normal_modes(self) -> Array:
        """Normal modes (N, k) of the solid: half as many while the highest ones are inaccurate."""
        count = min(NORMAL_MODES, self.solid.free // UNKNOWNS_PER_MODE)
        while True:
            try:
                modes: Array = self.solid.eigenmodes(self.solid.factor, count)[1]
                return modes
            except AccuracyError:
                count //= 2
                if count == 0:
                    raise


def _least_squares(matrix: Array, right: Array) -> Array:
    """The shortest solution of a square system, in which sliders that stick are free.

    Long rows are scaled to unit length. They belong to stiff coordinates, and would otherwise
    decide which singular values count as zero.
    """
    size = np.maximum(np.linalg.norm(matrix, axis=1), 1.0)
    found: Array = np.linalg.lstsq(matrix / size[:, None], right / size, rcond=RANK)[0]
    return found


WHAT = "the motion of the full model"


Kept = tuple[Motion, dict[str, Any]]
"""A motion, and when and where it ran."""


def full_motion(
    body: Structure,
    scene: Scene,
    name: str = "full",
    fresh: bool = False,
    cached: bool = True,
    **options: Any,
) -> Kept:
    """The motion of the full model, from the cache if an equal scene ran before.

    Args:
        body: the solid or the beam.
        scene: its scene.
        name: the model, "full", "disk" or "beam".
        fresh: whether to compute a motion that the cache has.
        cached: False for a body of another mesh than that of its scene.
        options: of `simulate`.

    Returns:
        The motion; when and where it ran, and whether it came from the cache.
    """
    from fenicsrom.fem.full.full import full_model  # slow to import

    last = clock.perf_counter()

    def progress(fraction: float, change: float) -> None:
        nonlocal last
        if clock.perf_counter() - last > 5.0:
            last = clock.perf_counter()
            limit = f"at most {scene.time.periods} periods"
            log.info(f"  {name} model: {100.0 * fraction:.0f} % of {limit}, change {change:.1e}")

    def make() -> Kept:
        log.info(f"  integrating the {name} model")
        motion = simulate(full_model(body), scene, progress=progress, **options)
        date = datetime.now(UTC).isoformat(timespec="seconds")
        return motion, {"date": date, "machine": machine(), "ranks": body.comm.size}

    return _kept(body.comm, cache_key(scene, name) if cached else None, make, fresh)


def _kept(comm: Any, key: str | None, make: Callable[[], Kept], fresh: bool) -> Kept:
    """What `make` gives, or the cache holds under a key. Collective."""
    folder = store.cache_folder()
    if folder is None or key is None:
        motion, note = make()
        return motion, note | {"cached": False}
    found = (
        store.read_results(folder, key, WHAT, _motion_of) if comm.rank == 0 and not fresh else None
    )
    found = comm.bcast(found)
    if found is not None:
        log.info(f"{WHAT}: taken from {folder}")
        return found[0], found[1] | {"cached": True}
    motion, note = make()
    if comm.rank == 0:
        tree, arrays = store.pack(replace(motion, end=None))
        store.write_results(folder, key, WHAT, {"note": note, "motion": tree}, arrays)
    return motion, note | {"cached": False}


def _motion_of(header: Any, arrays: Any) -> tuple[Motion, dict[str, Any]]:
    """A motion and its note."""
    return store.unpack(header["motion"], arrays, {"Motion": Motion}), header["note"]


DEPENDS = {"full": (), "disk": (), "beam": ("reference",), "periodic": ("basis",)}
"""The tables on which one motion alone depends: of the solid, of the whole disk of a sector, of the
beam, or the periodic one that starts from that of the reduced model."""


def cache_key(scene: Scene, name: str = "full") -> str | None:
    """A hash of all that a motion of `DEPENDS` depends on; None if the mesh reads other files."""
    table = scene_table(scene)
    for key in {"title", "basis", "reference", "output", "compare"} - {*DEPENDS[name]}:
        table.pop(key, None)
    mesh = table["geometry"]["mesh"] = store.mesh_digest(scene.geometry.files)
    return None if mesh is None else store.key_of([name, table])


def machine() -> dict[str, Any]:
    """The processor and the number of threads of the numerical libraries."""
    name = platform.processor() or platform.machine()
    with suppress(OSError):
        found = re.search(r"model name\s*: (.*)", Path("/proc/cpuinfo").read_text("utf-8"))
        name = found[1].strip() if found else name
    return {
        "processor": name,
        "cores": os.cpu_count(),
        "system": platform.system(),
        "OMP_NUM_THREADS": os.environ.get("OMP_NUM_THREADS", "not set"),
    }

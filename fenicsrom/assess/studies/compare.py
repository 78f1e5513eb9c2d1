"""Error against run time: every choice of a scene's [compare] table against its full model.

The choices are meshes, numbers of time steps and bases. The full model runs once, on the mesh and
with the time steps of the scene; its motion is kept in the user's cache folder
(`assess.full.full_motions`).
The combinations of a mesh share it and the solid with its factor; those with the same method and
number of modes share these modes and the snapshots. The offline seconds of a combination are the
sum of the stages that it needs, as if it were the only combination. The indicator
(`assess.errors.comparisons`) needs no full run.

Of bodies that touch, the errors are those of the probe and of the energy that friction dissipates,
and those that a run would estimate stand beside them. One motion of the scene chooses the interface
vectors of all combinations of a mesh.
"""

import itertools
import time as clock
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from fenicsrom.assess.errors.agreement import break_even, motion_errors, rank_correlation
from fenicsrom.assess.errors.comparisons import indicators
from fenicsrom.assess.errors.estimates import MotionErrors, times_distance
from fenicsrom.assess.errors.judge import judge_with_residual
from fenicsrom.assess.errors.plausibility import equilibrium_deformation, equilibrium_warnings
from fenicsrom.assess.errors.sizing import Sized, sized
from fenicsrom.assess.full.full_motions import full_motion
from fenicsrom.errors import AccuracyError, ConvergenceError, SceneError
from fenicsrom.notes import Note, NoteKind
from fenicsrom.online.contact.points import ContactPoints
from fenicsrom.online.model.model import ReducedModel
from fenicsrom.online.motion.motion import Motion
from fenicsrom.online.run.simulate import simulate
from fenicsrom.online.store.archive import StoredModel
from fenicsrom.progress import ask, log
from fenicsrom.reduction.basis import ReducedBasis, project
from fenicsrom.reduction.candidates import extended_basis
from fenicsrom.reduction.modes import component_modes
from fenicsrom.reduction.protocols import Structure
from fenicsrom.reduction.snapshots import Snapshots
from fenicsrom.reduction.stages import Reduction
from fenicsrom.reduction.training import motion_of_scene, train
from fenicsrom.scene import Scene, override_table, parse_scene, scene_table
from fenicsrom.scene.base.rules import BY_MOTION
from fenicsrom.scene.checks.checks import require_motion
from fenicsrom.scene.keys.schema import COMPARED
from fenicsrom.scene.reading.reading import with_time
from fenicsrom.words import brief, counted

# a run of more seconds is timed over two periods only; the time is scaled by the number of steps
SLOW = 1.0
REPEATS = 5  # timed runs of each model
SHORT_PERIODS = 2


@dataclass(frozen=True)
class Combination:
    """One choice from each list of [compare]."""

    method: str
    modes: int
    derivatives: str | tuple[str, ...]
    elastic_force: str
    scheme: str
    size: int | None = None
    mesh: str = ""
    steps: int | None = None

    @property
    def chosen(self) -> str:
        """How the derivatives are selected, in one word, or their labels."""
        return self.derivatives if isinstance(self.derivatives, str) else " ".join(self.derivatives)

    @property
    def name(self) -> str:
        """All choices in one line."""
        found = f"{self.method}, {self.modes}V, {self.chosen}, {self.elastic_force}, {self.scheme}"
        found += "" if self.size is None else f", size {self.size}"
        found += "" if self.steps is None else f", {self.steps} steps"
        return f"{found}, {self.mesh}" if self.mesh else found


@dataclass(eq=False)
class Outcome:
    """The result of a combination.

    Attributes:
        combination: the combination.
        labels: labels of its coordinates.
        offline: seconds by stage, as if made alone.
        online: seconds of each timed run.
        timed_periods: periods of a timed run that is scaled to the whole run by its steps; None if
            the whole run was timed.
        motion: the motion, without coordinates.
        errors: errors against the full model, in percent; empty without a full model.
        estimated: the errors due to the basis that a run estimates, of bodies that touch; or None.
        indicator: residual in the energy norm, relative to the loads.
        residual: plain norm of the residual, relative to the loads.
        failure: the reason why there is no motion; empty if there is a motion.
    """

    combination: Combination
    labels: tuple[str, ...] = ()
    offline: dict[str, float] = field(default_factory=dict)
    online: tuple[float, ...] = ()
    timed_periods: int | None = None
    motion: Motion | None = None
    errors: dict[str, float | None] = field(default_factory=dict)
    estimated: MotionErrors | None = None
    indicator: float | None = None
    residual: float | None = None
    failure: str = ""

    @property
    def offline_seconds(self) -> float:
        """Seconds of all offline stages."""
        return sum(self.offline.values())

    @property
    def online_seconds(self) -> float:
        """Median run time of the timed runs, s."""
        return float(np.median(self.online)) if self.online else float("nan")

    @property
    def error(self) -> float | None:
        """The error of the tangential amplitude or, of bodies that touch, of the probe, percent."""
        return self.errors.get("probe", self.errors.get("amplitude_tangential"))


@brief()
@dataclass(eq=False, repr=False)
class Comparison:
    """All combinations of a scene, with the full model they are measured against.

    Attributes:
        scene: the scene.
        outcomes: one for each combination.
        full: motion of the full model; None if it was not asked for.
        full_run: when and where the full model ran, and whether its motion came from the cache.
        unknowns: free unknowns of the full model.
        points: the contact points.
        compilation: seconds of compilation and warming up; no other number contains them.
        warnings: notes for the user.
        interrupted: whether the comparison was asked to stop before the last combination.
        files: the written files, the one to open first at the head.
    """

    scene: Scene
    outcomes: list[Outcome]
    full: Motion | None
    full_run: dict[str, Any]
    unknowns: int
    points: ContactPoints
    compilation: float
    warnings: list[Note]
    interrupted: bool = False
    files: list[Path] = field(default_factory=list)

    def rank_correlation(self, name: str = "indicator") -> float | None:
        """Spearman's correlation of the indicator with the `error` of the combinations.

        Args:
            name: "indicator" or "residual".
        """
        pairs = [
            (getattr(outcome, name), error)
            for outcome in self.outcomes
            if (error := outcome.error) is not None and getattr(outcome, name) is not None
        ]
        return rank_correlation(*zip(*pairs, strict=True)) if len(pairs) > 2 else None

    def speed_up(self, outcome: Outcome) -> float | None:
        """Ratio of the run times of the full model and of a combination online."""
        return self.full.seconds / outcome.online_seconds if self.full and outcome.online else None

    def break_even(self, outcome: Outcome) -> int | None:
        """`break_even` of a combination; None without a full run."""
        if not (self.full and outcome.online):
            return None
        return break_even(outcome.offline_seconds, outcome.online_seconds, self.full.seconds)


# ---------------------------------------------------------------------- the combinations


def combinations(scene: Scene) -> list[Combination]:
    """All combinations of a [compare] table; a linear scene has no derivatives to choose."""
    table = scene.compare
    schemes = table.schemes or (scene.time.scheme,)
    methods, derivatives, forces = table.methods, table.derivatives, table.elastic_force
    if scene.joined:  # the default lists have others; "all" has a hundred with interface vectors
        methods = tuple(method for method in methods if method == "rubin")
        derivatives = tuple(one for one in derivatives if one not in ("mmi", "mmi-nls"))
        if table.derivatives == COMPARED:
            derivatives = "principal", "none"
    if not scene.geometrically_nonlinear:
        derivatives, forces = ("none",), ("polynomial",)
    choices = itertools.product(methods, table.modes, derivatives, forces, schemes)
    bases = []
    for choice in choices:
        adapts = (choice[2], choice[3]) == ("principal", "polynomial")
        sizes = (None, *(table.sizes or ())) if adapts else (None,)
        bases += [Combination(*choice, size) for size in sizes]
    outer = itertools.product(("", *(table.meshes or ())), table.steps or (None,), bases)
    return [replace(basis, mesh=mesh, steps=steps) for mesh, steps, basis in outer]


def with_combination(scene: Scene, combination: Combination) -> Scene:
    """The scene with the basis, scheme, steps and mesh of a combination.

    Raises:
        SceneError: the combination is impossible, such as derivatives of missing modes.
    """
    c, table = combination, scene_table(scene)
    table["basis"] |= {"method": c.method, "modes": c.modes, "elastic_force": c.elastic_force}
    table["basis"].pop("size", None)
    table["basis"] |= {} if c.size is None else {"size": c.size}
    given = c.derivatives
    table["basis"]["derivatives"] = given if isinstance(given, str) else list(given)
    if c.mesh:
        table = override_table(table, c.mesh, scene.source)
    steps = {} if c.steps is None else {"steps_per_period": c.steps}
    return with_time(parse_scene(table, scene.source, None), scheme=c.scheme, **steps)


class Workshop:
    """Makes the reduced models of a body; shared stages run once, and their seconds are kept."""

    def __init__(self, body: Structure, scene: Scene, seconds: dict[str, float]):
        """Start from a body.

        Args:
            body: the structure.
            scene: its scene.
            seconds: run times of its stages.
        """
        self.body, self._scene, self._seconds = body, scene, dict(seconds)
        self._done: dict[Any, tuple[Any, float]] = {}

    def reduction(self, scene: Scene) -> tuple[Reduction, dict[str, float]]:
        """The stages of a scene's reduced model, and their seconds as if it were made alone."""
        method, count = scene.basis.method, scene.basis.modes
        assert isinstance(count, int)  # of [compare]
        options = replace(self._scene.basis, method=method, modes=count)
        modes, taken = self._once((method, count), partial(component_modes, self.body, options))
        # the snapshots always use the scheme of the scene of the body
        take = partial(Snapshots, self.body, self._scene, modes)
        snapshots, _ = self._once((method, count, "snapshots"), take)
        chosen = scene.basis.derivatives
        kinds = ("linear",) if chosen == "mmi" else ("linear", "static")
        shared = sum(
            self._once((method, count, kind), partial(getattr, snapshots, kind))[1]
            for kind in kinds
            if scene.geometrically_nonlinear and chosen in BY_MOTION
        )
        seconds = {**self._seconds, "modes": taken, "selection": shared}
        return Reduction(self.body, scene, partial(timed, seconds), modes, snapshots), seconds

    def _once(self, key: Any, work: Callable[[], Any]) -> tuple[Any, float]:
        """The result of some work, and the seconds that it took when it was done first."""
        if key not in self._done:
            begin = clock.perf_counter()
            self._done[key] = work(), clock.perf_counter() - begin
        return self._done[key]


@contextmanager
def timed(seconds: dict[str, float], stage: str) -> Iterator[None]:
    """Add the run time of a `with` block to a stage."""
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
    """Make the model of a combination, run it and compare it with the full model.

    Args:
        workshop: makes the model.
        scene: the scene.
        combination: the combination.
        full: motion of the full model, or None.
        timing: whether to repeat the run to time it.
    """
    outcome = Outcome(combination)
    scene = with_combination(scene, combination)
    try:
        reduction, outcome.offline = workshop.reduction(scene)
        basis, model = reduction.basis, reduction.model
        motion = simulate(model, scene, keep_coordinates=True)
        if scene.basis.adapts:
            with timed(outcome.offline, "size"):
                extended, chosen = _sized(workshop.body, scene, reduction, motion)
            basis = extended.part(chosen.stored.labels, chosen.stored.model.mass)
            model, motion = chosen.stored.model, chosen.motion
            if scene.joined and chosen.other is not None:
                modes, stored = reduction.modes, chosen.stored
                outcome.estimated = judge_with_residual(
                    workshop.body, modes, extended, stored, motion, chosen.other
                ).errors
        outcome.labels = basis.labels
        found = indicators(workshop.body, basis.vectors, motion, scene)
        outcome.indicator, outcome.residual = found
        outcome.motion = kept(motion)
        if timing:
            timings = time_runs(model, scene, motion, workshop.body.comm)
            outcome.online, outcome.timed_periods = timings
    except (ConvergenceError, AccuracyError, SceneError) as error:  # no such `basis.size`
        outcome.failure = str(error)
        return outcome
    if full is not None:
        outcome.errors = errors_against(motion, full, scene)
    return outcome


def kept(motion: Motion) -> Motion:
    """A motion without its coordinates."""
    return replace(motion, coordinates=None, velocity=None, acceleration=None, coordinate_time=None)


def errors_against(motion: Motion, full: Motion, scene: Scene) -> dict[str, float | None]:
    """The errors of a motion against that of the full model, percent."""
    found = motion_errors(motion, full)
    if scene.joined:
        distance = times_distance(1.0, motion, full)
        found["probe"] = 100.0 * distance.probe
        found["friction_dissipation"] = 100.0 * distance.dissipation
    return found


def _sized(
    body: Structure, scene: Scene, found: Reduction, motion: Motion
) -> tuple[ReducedBasis, Sized]:
    """The basis with all candidates, and the model and motion of the size that a scene asks for.

    Args:
        body: the structure.
        scene: the scene.
        found: the stages of the first basis.
        motion: its motion.
    """
    assert isinstance(found.model, ReducedModel)
    extended = extended_basis(body, scene.basis, found)
    whole = project(body, extended, body.geometrically_nonlinear)
    stored = StoredModel(
        model=found.model,
        scene=scene,
        method=extended.method,
        labels=found.basis.labels,
        dofs=body.free,
        frequencies_hz=found.modes.frequencies_hz,
        provenance={},
        candidates=whole,
        further=extended.labels[found.basis.size :],
    )

    def run(larger: StoredModel, near: Any) -> Motion:
        return simulate(larger.model, scene, near=near, keep_coordinates=True)

    chosen = sized(stored, motion, run)
    assert chosen is not None
    return extended, chosen


def time_runs(
    model: Any, scene: Scene, motion: Motion, comm: Any
) -> tuple[tuple[float, ...], int | None]:
    """Time `REPEATS` runs.

    Returns:
        The seconds of each run, and None. If the whole run is too slow to repeat, only some periods
        are timed: the seconds are then scaled to the whole run, and the number of periods is given.
    """
    if (
        comm.bcast(motion.seconds) <= SLOW
        or motion.period is None
        or motion.search is not None
        or motion.periods <= SHORT_PERIODS
    ):
        return tuple(simulate(model, scene).seconds for _ in range(REPEATS)), None
    short = replace(scene, time=scene.time.changed(periods=SHORT_PERIODS, steady_tolerance=0.0))
    runs = (simulate(model, short) for _ in range(REPEATS))
    return tuple(run.seconds / run.steps * motion.steps for run in runs), SHORT_PERIODS


def compare(scene: Scene, comm: Any) -> Comparison:
    """Compare every combination of a scene's [compare] table with the full model.

    Args:
        scene: the scene.
        comm: MPI communicator of the offline stage and the full model.

    Raises:
        SceneError: the scene or a combination is impossible.
        ConvergenceError, AccuracyError: the full model or the solid failed. The failure of a
            combination is part of its outcome.
    """
    require_motion(scene, "compare")
    wanted = combinations(scene)
    scenes = {c.mesh: with_combination(scene, c) for c in reversed(wanted)}  # all are possible
    cold: dict[str, float] = {}
    workshop = _workshop(scenes[""], scene, comm, cold)
    solid: Any = workshop.body
    solid.warnings += equilibrium_warnings(equilibrium_deformation(solid, scene))
    full, full_run = full_motion(solid, scene) if scene.compare.full else (None, {})
    mesh = ""

    def attempt(combination: Combination) -> Outcome:
        nonlocal workshop, mesh
        if combination.mesh != mesh:
            mesh = combination.mesh
            workshop = _workshop(scenes[mesh], scene, comm, cold)
        return try_out(workshop, scene, combination, full)

    outcomes, interrupted = try_each(wanted, attempt)
    warned = list(dict.fromkeys(solid.warnings))  # the modes of each choice may say the same
    warned += outcome_notes(scene, outcomes)
    return Comparison(
        scene,
        outcomes,
        full=full,
        full_run=full_run,
        unknowns=solid.free,
        points=solid.points,
        compilation=cold["compilation"],
        warnings=warned,
        interrupted=interrupted,
    )


def outcome_notes(scene: Scene, outcomes: Sequence[Outcome]) -> list[Note]:
    """Notes on the combinations that failed, and on those that did not become periodic."""
    notes = []
    if failed := sum(bool(outcome.failure) for outcome in outcomes):
        text = f"{failed} of {counted(len(outcomes), 'combination')} failed"
        notes.append(Note(NoteKind.FAILED, text))
    motions = {one.combination.name: one.motion for one in outcomes if one.motion}
    unsteady = [name for name, motion in motions.items() if motion.period and not motion.steady]
    if unsteady and scene.time.steady_tolerance:
        text = f"the motions of {'; '.join(unsteady)} did not become periodic, so their errors "
        text += "hold for the last period only: raise time.periods"
        notes.append(Note(NoteKind.UNSETTLED, text, "time.periods"))
    return notes


def _workshop(first: Scene, scene: Scene, comm: Any, cold: dict[str, float]) -> Workshop:
    """The workshop of the mesh of a combination; its compilation is timed apart.

    Args:
        first: the scene of the first combination on this mesh.
        scene: the scene.
        comm: MPI communicator.
        cold: receives the seconds of compilation.
    """
    from fenicsrom.fem.mesh.mesh import build_mesh
    from fenicsrom.fem.solid.solid import solid_of

    seconds: dict[str, float] = {}
    with timed(seconds, "mesh"):
        mesh = build_mesh(first.geometry, comm)
    log.info("compiling and warming up ..")
    on_mesh = replace(scene, geometry=first.geometry)
    trial = solid_of(on_mesh, mesh)
    with timed(cold, "compilation"):
        warm_up(Workshop(trial, scene, {}), first)
    trial.destroy()
    with timed(seconds, "solid"):
        solid = solid_of(on_mesh, mesh)
    if scene.basis.masters == "motion":
        alone = replace(on_mesh, backbone=None, response=None)
        move = partial(motion_of_scene, scene=alone)
        with timed(seconds, "interface_vectors"):
            train(solid, alone, lambda reduction: move(reduction.model), [alone])
    return Workshop(solid, scene, seconds)


def warm_up(workshop: Workshop, scene: Scene) -> None:
    """Run every stage once for a few steps, so that later times contain no compilation."""
    reduction, _ = workshop.reduction(scene)
    short = scene.time.changed(periods=1, steady_tolerance=0.0) if scene.period else scene.time
    simulate(reduction.model, replace(scene, time=short))


def try_each(
    wanted: Sequence[Combination], attempt: Callable[[Combination], Outcome]
) -> tuple[list[Outcome], bool]:
    """Try every combination; after each, report its result and the remaining time.

    Args:
        wanted: the combinations.
        attempt: tries one.

    Returns:
        The outcomes, and whether an interrupt left some out.

    Raises:
        KeyboardInterrupt: there is no outcome yet.
    """
    spent: dict[str, list[float]] = {}
    outcomes: list[Outcome] = []
    for k, combination in enumerate(wanted):
        begin = clock.perf_counter()
        try:
            ask()
            outcome = attempt(combination)
        except KeyboardInterrupt:
            if not outcomes:
                raise
            return outcomes, True
        outcomes.append(outcome)
        spent.setdefault(combination.elastic_force, []).append(clock.perf_counter() - begin)
        mean = {kind: float(np.mean(times)) for kind, times in spent.items()}
        known = max(mean.values())
        left = sum(mean.get(other.elastic_force, known) for other in wanted[k + 1 :])
        error = outcome.error
        result = outcome.failure or counted(len(outcome.labels), "coordinate")
        result += f", {1e3 * outcome.online_seconds:.3g} ms" if outcome.online else ""
        result += f", error {error:.2g} %" if error is not None else ""
        log.info(f"{k + 1}/{len(wanted)} {combination.name}: {result}; about {left:.0f} s left")
    return outcomes, False

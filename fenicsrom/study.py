"""A study: the stages of a scene in their order, each run only if the scene needs it.

    scene -> mesh -> solid -> modes -> selection -> derivatives -> basis -> reduced model -> motion

Each step is a function of its own, to be called from Python one by one (`demos/slip_liftoff.py`) or all together by `run`.
"""

from __future__ import annotations

import time as clock
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from fenicsrom.basis import ReducedBasis, build_basis
from fenicsrom.beam import BeamBody, timoshenko
from fenicsrom.contact import ContactPoints, frame, no_points
from fenicsrom.derivatives import all_pairs, modal_derivatives
from fenicsrom.errors import AccuracyError, ConvergenceError, SceneError
from fenicsrom.integrate import Motion
from fenicsrom.modes import ComponentModes, component_modes
from fenicsrom.online import (
    amplitude,
    at_rest,
    check_basis_error,
    check_energy,
    check_time_error,
    other_scheme,
    out_of_reach,
    settled,
    simulate,
    step_errors,
    wanders,
)
from fenicsrom.plan import Stage, plan
from fenicsrom.reduced import project, project_intrusively
from fenicsrom.scene import Scene
from fenicsrom.selection import STATIC_LEVELS, Selection, participation, select
from fenicsrom.solid import Solid

if TYPE_CHECKING:
    from fenicsrom.modes import Body

Array = NDArray[np.float64]

SNAPSHOTS = 200  # of the linear transient, at most
MORE_MODES = 2  # that a basis is completed by where it has all derivatives
MORE_DERIVATIVES = 15  # that a basis is completed by, at most, to see whether it was rich enough
SNAPSHOT_STEADINESS = 1e-3  # change over a period at which the linear transient is steady enough to choose modes by


@dataclass(frozen=True, eq=False)
class Derivatives:
    """Modal derivatives by label: vectors (local, k)."""

    labels: tuple[str, ...]
    vectors: Array


def choose(solid: Body, modes: ComponentModes, snapshots: Snapshots | None = None) -> Selection:
    """Choose the modes and derivatives the scene's [basis] asks for.

    Args:
        solid: the body.
        modes: its component modes.
        snapshots: of these modes, where some are known already.

    Raises:
        ConvergenceError: the linear transient or the nonlinear statics did not converge.
    """
    scene = solid.scene
    wanted = scene.basis.derivatives
    if not scene.geometrically_nonlinear or wanted == "none" or (wanted in ("mmi", "mmi-nls") and scene.still):
        return Selection(modes.labels, (), {}, {})
    if wanted == "all":
        return Selection(modes.labels, tuple(all_pairs(modes.labels)), {}, {})
    if not isinstance(wanted, str):
        return Selection(modes.labels, wanted, {}, {})
    snapshots = snapshots or Snapshots(solid, modes)
    deflections = snapshots.linear
    if wanted == "mmi-nls":
        deflections = np.concatenate([snapshots.static, deflections], axis=1)
    coordinates = participation(modes.vectors, deflections, solid.mass_inner, solid.largest(modes.vectors))
    return select(coordinates, modes.labels, wanted, scene.basis.threshold)


class Snapshots:
    """The deflections by which modes and derivatives are chosen, each kind found when it is first asked for."""

    def __init__(self, solid: Body, modes: ComponentModes):
        """Keep the body and its component modes."""
        self._solid, self._modes = solid, modes

    @cached_property
    def linear(self) -> Array:
        """(local, s) of the geometrically linear transient."""
        return linear_snapshots(self._solid, self._modes)

    @cached_property
    def static(self) -> Array:
        """(local, levels) of the nonlinear statics."""
        return static_snapshots(self._solid, self.linear)


def linear_snapshots(solid: Body, modes: ComponentModes) -> Array:
    """Deflections (local, s) over the last period of a geometrically linear transient with friction."""
    scene = solid.scene
    labels = [label for label in modes.labels if label.endswith("V")]
    basis = build_basis(
        modes.method, modes.masters, modes.rows, modes.normal, labels, solid.mass_inner, solid.comm.allreduce
    )
    coarse = scene.time.steady_tolerance
    time = replace(scene.time, steady_tolerance=max(coarse, SNAPSHOT_STEADINESS) if coarse is not None else None)
    motion = simulate(project(solid, basis, nonlinear=False), replace(scene, time=time), keep_coordinates=True)
    assert motion.coordinates is not None
    step = -(-motion.coordinates.shape[0] // SNAPSHOTS)
    return basis.vectors @ motion.coordinates[::step].T


def static_snapshots(solid: Body, linear: Array) -> Array:
    """Nonlinear static deflections (local, `STATIC_LEVELS`) from the equilibrium.

    The force is the one that would hold the linear structure in its largest deflection of the transient, f = K u (eq. 18 at
    the phase of the largest deflection), in equal levels up to all of it.
    """
    sizes = np.array([solid.mass_inner(u[:, None], u[:, None])[0, 0] for u in linear.T])
    force = solid.stiffness_times(linear[:, [int(np.argmax(sizes))]])[:, 0]
    rest = solid.rest_force
    u, found = solid.equilibrium, []
    for level in range(1, STATIC_LEVELS + 1):
        u = solid.static(rest + level / STATIC_LEVELS * force, u)
        found.append(u - solid.equilibrium)
    return np.array(found).T


def differentiate(solid: Body, modes: ComponentModes, labels: tuple[str, ...]) -> Derivatives:
    """Solve for the modal derivatives of these labels.

    Raises:
        AccuracyError: a derivative is not symmetric.
    """
    exact = solid.scene.basis.differentiation == "exact"
    derivative = solid.tangent_derivative if exact else solid.tangent_difference
    total = solid.comm.allreduce
    return Derivatives(labels, modal_derivatives(modes.vectors, modes.labels, labels, derivative, modes.inverse, total))


def enrich(solid: Body, modes: ComponentModes, selection: Selection, derivatives: Derivatives) -> ReducedBasis:
    """The basis of the selected modes and derivatives."""
    kept = [k for k, label in enumerate(modes.labels) if label.endswith("V") and label in selection.modes]
    vectors = np.concatenate([modes.normal[:, kept], derivatives.vectors], axis=1)
    labels = [modes.labels[k] for k in kept] + list(derivatives.labels)
    return build_basis(modes.method, modes.masters, modes.rows, vectors, labels, solid.mass_inner, solid.comm.allreduce)


def reduce(solid: Body, basis: ReducedBasis) -> Any:
    """The reduced model the scene's `basis.elastic_force` asks for: polynomial, or projection of the full force."""
    scene = solid.scene
    if scene.geometrically_nonlinear and scene.basis.elastic_force == "projection":
        return project_intrusively(solid, basis)
    return project(solid, basis, scene.geometrically_nonlinear)


Timer = Callable[[str], AbstractContextManager[None]]


class Reduction:
    """From a body to its reduced model, stage by stage: each is gone through, and timed, when it is first asked for.

    This is the one statement of what the stages need of one another: `run`, `fenicsrom modes` and `fenicsrom compare` ask for
    as much as they want.
    """

    def __init__(
        self, body: Body, timed: Timer, modes: ComponentModes | None = None, snapshots: Snapshots | None = None
    ):
        """Start from a body and the scene it has, with its modes (and snapshots of these) where they are known already."""
        self._body, self._timed, self._snapshots = body, timed, snapshots
        if modes is not None:
            self.modes = modes

    @cached_property
    def modes(self) -> ComponentModes:
        """The component modes."""
        wanted = self._body.scene.basis
        with self._timed("modes"):
            return component_modes(self._body, wanted.method, wanted.modes)

    @cached_property
    def selection(self) -> Selection:
        """The modes and derivatives that are kept."""
        modes = self.modes
        with self._timed("selection"):
            return choose(self._body, modes, self._snapshots)

    @cached_property
    def derivatives(self) -> Derivatives:
        """These derivatives."""
        modes, selection = self.modes, self.selection
        with self._timed("derivatives"):
            return differentiate(self._body, modes, selection.derivatives)

    @cached_property
    def basis(self) -> ReducedBasis:
        """The basis of both."""
        modes, selection, derivatives = self.modes, self.selection, self.derivatives
        with self._timed("basis"):
            return enrich(self._body, modes, selection, derivatives)

    @cached_property
    def model(self) -> Any:
        """The reduced model on it."""
        basis = self.basis
        with self._timed("reduction"):
            return reduce(self._body, basis)


class Stopwatch:
    """Times stages and says when they begin and end."""

    def __init__(self, say: Callable[[str], None]):
        """Say what happens through `say`, a line at a time."""
        self.say = say
        self.seconds: dict[str, float] = {}

    @contextmanager
    def __call__(self, stage: str) -> Iterator[None]:
        """Time a stage."""
        self.say(f"{stage} ..")
        begin = clock.perf_counter()
        yield
        self.seconds[stage] = clock.perf_counter() - begin

    def progress(self, model: str, steady: float | None) -> Callable[[float, float], None]:
        """A callback for `simulate` that says how far it is, every two seconds at most."""
        last = clock.perf_counter()
        count = 0

        def say(fraction: float, change: float) -> None:
            nonlocal last, count
            count += 1
            if clock.perf_counter() - last > 2.0:
                last = clock.perf_counter()
                goal = f" (steady at {steady:.0e})" if steady else ""
                self.say(f"  {model}: period {count}, change {change:.1e}{goal}")

        return say


@dataclass(eq=False)
class Study:
    """What a run found.

    Attributes:
        scene: the scene.
        stages: the plan it followed.
        solid: the body.
        modes: its component modes.
        selection: the modes and derivatives kept.
        derivatives: the derivatives.
        basis: the basis; None if only modes were asked for.
        model: the reduced model; None if only modes were asked for.
        motions: "reduced", "full" and "beam" -> motion, as far as they ran.
        seconds: stage -> run time in s.
        left_out: what the scene did not need, and why.
        errors: estimated relative errors of the reduced model's amplitudes by the "time step" and the "basis", and of its
            "peak force by the time step".
        deflection: (d,) displacement of the probe in the equilibrium, m; None without static load.
        unfinished: the name of the model whose integration or whose check failed, with its error; None if all went well.
    """

    scene: Scene
    stages: list[Stage]
    solid: Solid
    modes: ComponentModes
    selection: Selection
    derivatives: Derivatives
    basis: ReducedBasis | None = None
    model: Any = None
    motions: dict[str, Motion] = field(default_factory=dict)
    seconds: dict[str, float] = field(default_factory=dict)
    left_out: list[str] = field(default_factory=list)
    errors: dict[str, float] = field(default_factory=dict)
    deflection: Array | None = None
    unfinished: tuple[str, Exception] | None = None


def offline(scene: Scene, comm: Any, watch: Stopwatch, modes_only: bool = False) -> Study:
    """What comes before the motion: mesh, solid, modes, selection and derivatives of a scene, basis and model.

    Without basis and model if only the modes are asked for; mesh and solid alone of a scene in which nothing moves.
    """
    from fenicsrom.mesh import build_mesh

    stages = plan(scene, modes_only)
    with watch("mesh"):
        mesh = build_mesh(scene.geometry, comm)
    with watch("solid"):
        solid = Solid(mesh, scene)
    if scene.still and not modes_only:
        none = component_modes(solid, scene.basis.method, 0)
        study = Study(scene, stages, solid, none, Selection((), (), {}, {}), Derivatives((), none.normal), seconds=watch.seconds)
        return _reported(study)
    found = Reduction(solid, watch)
    modes, selection, derivatives = found.modes, found.selection, found.derivatives
    study = _reported(Study(scene, stages, solid, modes, selection, derivatives, seconds=watch.seconds))
    if not modes_only:
        study.basis, study.model = found.basis, found.model
    dropped = [label for label in modes.labels if label not in selection.modes]
    light = [label for label, weight in selection.weights.items() if label not in selection.derivatives]
    threshold = scene.basis.threshold
    if dropped:
        study.left_out.append(f"modes {', '.join(dropped)}: take part with less than {threshold:g} of the largest")
    if light:
        study.left_out.append(f"derivatives {', '.join(light)}: weigh at most {threshold:g} of the largest")
    return study


def _reported(study: Study) -> Study:
    """The study with what it left out, and where the static loads leave the probe; collective."""
    solid = study.solid
    study.left_out = [f"{stage.name}: {stage.why}" for stage in study.stages if not stage.runs]
    if solid.loaded:
        study.deflection = np.asarray(solid.comm.allreduce(solid.probe_rows @ solid.equilibrium))
    return study


def run(
    scene: Scene, comm: Any, say: Callable[[str], None], restarts: Callable[[Study], dict[str, Any]] | None = None
) -> Study:
    """Everything a scene asks for, but the files.

    Args:
        scene: the scene.
        comm: MPI communicator of the offline stage and the full model.
        say: is told what happens, a line at a time.
        restarts: is shown the reduced model before it moves, and gives the `resume` and `checkpoint` of its motion.

    Returns:
        What was found; `unfinished` names a model whose integration failed, its motion up to there is in `motions`.

    Raises:
        SceneError: the scene asks for something impossible.
        ConvergenceError, AccuracyError: an offline stage failed.
    """
    watch = Stopwatch(say)
    study = offline(scene, comm, watch)
    if scene.still:
        return study
    models: dict[str, Callable[[], Any]] = {"reduced": lambda: study.model}
    if scene.reference.full:
        models["full"] = lambda: full_model(study.solid)
    if scene.reference.beam is not None:
        models["beam"] = lambda: beam_model(scene)
    for name, make in models.items():
        model = make()
        options = restarts(study) if restarts is not None and name == "reduced" else {}
        with watch(f"{name} motion"):
            try:
                study.motions[name] = simulate(
                    model, scene, keep_coordinates=name == "reduced",
                    progress=watch.progress(name, scene.time.steady_tolerance), **options,
                )  # fmt: skip
            except (AccuracyError, ConvergenceError) as error:
                if error.partial is not None:
                    study.motions[name] = error.partial
                study.unfinished = (name, error)
        if study.unfinished:
            break
        if study.motions[name].buckled:
            study.solid.warnings.append(
                f"the {name} model is buckled by the preload: its equilibrium nearest to the unloaded body is unstable in "
                f"{study.motions[name].buckled} direction(s), and the motion starts from the stable one it falls into"
            )
        if not study.motions[name].steady and scene.period is not None and scene.time.steady_tolerance:
            study.solid.warnings.append(
                f"the {name} model did not repeat within {study.motions[name].periods} periods: its amplitudes are those of "
                f"the last one among others{other_scheme(scene)}"
            )
        # the run time proper, without compilation
        watch.seconds[f"{name} motion"] = study.motions[name].seconds
    if scene.contacts and "reduced" in study.motions:
        study.left_out += out_of_reach(study.motions["reduced"], study.solid.points)
    if not study.unfinished:
        with watch("checks"):
            check(study)
    return study


def check(study: Study) -> None:
    """Estimate the errors of the motions and keep them in the study; one that is too large makes it unfinished."""
    scene, model = study.scene, ""
    try:
        for name, motion in study.motions.items():
            model = name
            check_energy(motion)
        model, motion = "reduced", study.motions["reduced"]
        study.errors["time step"], force = step_errors(study.model, scene, motion)
        if scene.contacts:
            study.errors["peak force by the time step"] = force
        check_time_error(scene, study.errors["time step"], wanders(motion))
        if settled(motion):
            richer = complete(study, motion.buckled > 0)
            if richer is not None:
                study.errors["basis"] = basis_error(reduce(study.solid, richer), scene, motion)
                check_basis_error(scene, study.errors["basis"])
    except (AccuracyError, ConvergenceError) as error:
        study.unfinished = (model, error)


def complete(study: Study, buckled: bool = False) -> ReducedBasis | None:
    """A richer basis to compare with; None if none is of use.

    With more of the derivatives that were left out, the heaviest first; if none were, or the preload has buckled the model
    and so taken it far from the state that the basis is about, with `MORE_MODES` more normal modes and all derivatives.
    """
    if not study.scene.geometrically_nonlinear:
        return None
    kept = study.derivatives.labels
    weights = study.selection.weights
    missing = sorted(set(all_pairs(study.modes.labels)) - set(kept), key=lambda label: (-weights.get(label, 0.0), label))
    if buckled or not missing:
        return more_modes(study)
    more = differentiate(study.solid, study.modes, tuple(missing[:MORE_DERIVATIVES]))
    vectors = np.concatenate([study.derivatives.vectors, more.vectors], axis=1)
    try:
        return enrich(study.solid, study.modes, study.selection, Derivatives((*kept, *more.labels), vectors))
    except AccuracyError:  # they depend on those that are there: nothing to learn from them
        return None


def more_modes(study: Study) -> ReducedBasis | None:
    """The basis of `MORE_MODES` more normal modes, with all derivatives; None if the body has no more."""
    wanted = study.scene.basis
    try:
        modes = component_modes(study.solid, wanted.method, wanted.modes + MORE_MODES)
        selection = Selection(modes.labels, tuple(all_pairs(modes.labels)), {}, {})
        return enrich(study.solid, modes, selection, differentiate(study.solid, modes, selection.derivatives))
    except (AccuracyError, SceneError):
        return None


def basis_error(richer: Any, scene: Scene, motion: Motion) -> float:
    """Estimate of the relative error of a settled motion by its basis: how far the amplitudes of a richer model are from its.

    And how far the displacement it starts with, where the preload has buckled it. Infinite if that does not settle.

    Raises:
        ConvergenceError: the richer model fails.
    """
    other = simulate(richer, scene)
    if not settled(other):
        return float("inf")
    apart = 0.0
    if not (at_rest(motion) and at_rest(other)):
        size = float(np.linalg.norm(amplitude(other)))
        apart = float(np.linalg.norm(amplitude(motion) - amplitude(other))) / size if size > 0.0 else float("inf")
    if motion.buckled or other.buckled:  # how far it has buckled too
        start, other_start = motion.displacement[0], other.displacement[0]
        apart = max(apart, float(np.linalg.norm(start - other_start) / np.linalg.norm(other_start)))
    return apart


def full_model(body: Body) -> Any:
    """The full model of a body, as the time integration wants it."""
    if isinstance(body, BeamBody):
        return body.full_model()
    from fenicsrom.full import FullModel

    return FullModel(body)


def beam_model(scene: Scene) -> Any:
    """The full model of `beam_body`.

    Raises:
        SceneError: the scene's loads or contacts are not those of a planar beam along x.
    """
    return beam_body(scene).full_model()


def beam_body(scene: Scene) -> BeamBody:
    """The planar Timoshenko beam of a scene, in the plane of x and y: loads at its section, contact and probe at its tip.

    Raises:
        SceneError: the scene's loads or contacts are not those of a planar beam along x.
    """
    section, d = scene.reference.beam, scene.geometry.dimension
    assert section is not None
    try:
        beam = timoshenko(section, scene.material, not scene.geometrically_nonlinear)
    except SceneError as error:
        raise SceneError(f"{scene.source}: {error}") from None
    n = beam.mass.shape[0]
    if len(scene.contacts) > 1:
        count = len(scene.contacts)
        raise SceneError(f"{scene.source}: reference.beam = true: the beam has one contact point, the scene {count}")
    for k, load in enumerate(scene.loads):
        if load.kind != "force":
            what = f"the beam takes point forces only, no {load.kind} as in loads[{k}]"
            raise SceneError(f"{scene.source}: reference.beam = true: {what}")
    for k, item in enumerate([*scene.loads, *scene.contacts]):
        vector = item.direction if k < len(scene.loads) else item.normal
        if vector is None or (k >= len(scene.loads) and item.place.at == "nodes"):
            raise SceneError(f"{scene.source}: reference.beam = true: the beam has one contact point, before a plane")
        if d == 3 and abs(vector[2]) > 1e-12:
            raise SceneError(f"{scene.source}: reference.beam = true: the beam moves in the x-y plane, {list(vector)} leaves it")

    def rows(node: int) -> Array:
        found = np.zeros((d, n))
        found[0, beam.unknown(node, 0)] = found[1, beam.unknown(node, 1)] = 1.0
        return found

    if any(load.static and load.size for load in scene.loads):
        raise SceneError(f"{scene.source}: reference.beam = true: the beam starts at rest, undeformed; leave out static loads")
    tip = rows(beam.tip_node)
    loads = np.array([np.array(load.direction) @ rows(beam.load_node) for load in scene.loads]).reshape(-1, n).T
    frames = [frame(np.array(contact.normal)) for contact in scene.contacts]
    contact_rows = np.concatenate([axes @ tip for axes in frames] or [np.zeros((0, n))])
    points = no_points(d)
    if frames:
        position = np.zeros((1, d))
        position[0, 0] = section.length
        points = ContactPoints(np.zeros(1, dtype=np.int64), np.ones(1), position, np.array(frames))
    return BeamBody(scene, beam, loads, points, contact_rows, tip)

"""The stages of a scene: what is needed and why, in the order in which they run.

    mesh -> solid -> modes -> selection -> derivatives -> basis -> reduced model -> motions -> files

`stages` is the only place that says what a scene needs. `run` executes the needed stages, `plan`
lists all of them. The numbers are written before the pictures.
"""

from __future__ import annotations

import time as clock
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from fenicsrom.errors import AccuracyError, ConvergenceError, ErrorKind, SceneError

if TYPE_CHECKING:
    from fenicsrom.assess.response import Response
    from fenicsrom.fem.mesh import Mesh
    from fenicsrom.online.archive import StoredModel
    from fenicsrom.online.motion import Motion
    from fenicsrom.post.record import Study
    from fenicsrom.reduction.snapshots import Snapshots
    from fenicsrom.reduction.stages import Reduction
    from fenicsrom.scene import Scene

ALL_STATIC = "all loads are static, so only the equilibrium is computed"
MODES_ONLY = "only the modes are asked for"
PROGRESS_INTERVAL = 2.0  # shortest time between two lines on the progress of a motion, s


def never() -> bool:
    """Tell that the run may continue: the default of `stop`."""
    return False


class Stopwatch:
    """Times stages, and announces each stage.

    Attributes:
        say: receives one line at a time.
        seconds: stage -> run time, s.
    """

    def __init__(self, say: Callable[[str], None]):
        """Announce stages through `say`."""
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
        """Make a callback for `simulate` that reports the progress every two seconds.

        Args:
            model: name of the model.
            steady: change per period at which the motion counts as steady.
        """
        last = clock.perf_counter()
        count = 0

        def report(fraction: float, change: float) -> None:
            nonlocal last, count
            count += 1
            if clock.perf_counter() - last > PROGRESS_INTERVAL:
                last = clock.perf_counter()
                goal = f" (steady at {steady:.0e})" if steady else ""
                self.say(f"  {model}: period {count}, change {change:.1e}{goal}")

        return report


@dataclass(frozen=True)
class Item:
    """One line of the plan.

    Attributes:
        name: name of a stage, or of a part of the stage above this line.
        needed: whether the scene needs it.
        reason: why, in a few words.
    """

    name: str
    needed: bool
    reason: str


@dataclass(frozen=True)
class Stage(Item):
    """One stage of a scene.

    Attributes:
        run: executes the stage and stores its result in the study.
        parts: the parts of the stage; the stage skips a part that is not needed.
        writes: whether the stage only writes files. Such a stage runs even if a motion failed.
    """

    run: Callable[[Run], None]
    parts: tuple[Item, ...] = ()
    writes: bool = False


@dataclass(eq=False)
class Run:
    """What the stages of one run share.

    Attributes:
        study: the record that the stages fill.
        comm: MPI communicator of the offline stages and the full model.
        watch: times the stages.
        folder: folder of the output files; None writes no files.
        resume: checkpoint from which the reduced model continues.
        stop: called between stages and after each period; the run ends when it returns True.
        mesh: the mesh; None until it is made.
        snapshots: the deflections by which modes and derivatives are selected.
        reduction: the stages from the modes to the reduced model.
    """

    study: Study
    comm: Any
    watch: Stopwatch
    folder: Path | None = None
    resume: Path | None = None
    stop: Callable[[], bool] = never
    mesh: Mesh | None = None
    snapshots: Snapshots = field(init=False)
    reduction: Reduction = field(init=False)


# ------------------------------------------------------------------ what a scene needs


def stages(scene: Scene, modes_only: bool = False, files: bool = True) -> list[Stage]:
    """List the stages of a scene in their order.

    Args:
        scene: the scene.
        modes_only: stop after the modal derivatives.
        files: include the stages that write files.
    """
    offline = _offline_stages(scene, modes_only)
    moving = not scene.static_only and not modes_only
    why_not = MODES_ONLY if modes_only else ALL_STATIC
    reference = scene.reference
    full, beam = reference.full, reference.beam is not None
    listed = [
        *offline,
        Stage(
            "reduced motion",
            moving,
            f"time.scheme is {scene.time.scheme}" if moving else why_not,
            lambda run: _integrate(run, "reduced"),
            parts=(_newton_item(scene),) if moving else (),
        ),
        Stage(
            "full motion",
            moving and full,
            f"reference.full is {_lower(full)}" if moving else why_not,
            lambda run: _integrate(run, "full"),
        ),
        Stage(
            "beam motion",
            moving and beam,
            f"reference.beam is {'given' if beam else 'not given'}" if moving else why_not,
            lambda run: _integrate(run, "beam"),
        ),
        Stage(
            "checks",
            moving,
            "energy balance, time step and basis" if moving else why_not,
            lambda run: check(run.study),
        ),
    ]
    return listed + (_file_stages(scene, moving, modes_only) if files else [])


def plan(scene: Scene, modes_only: bool = False) -> list[Item]:
    """List the stages of a scene, each followed by its parts."""
    return [item for stage in stages(scene, modes_only) for item in (stage, *stage.parts)]


def _offline_stages(scene: Scene, modes_only: bool) -> list[Stage]:
    """List the stages from the mesh to the reduced model."""
    basis, nonlinear = scene.basis, scene.geometrically_nonlinear
    with_modes = modes_only or not scene.static_only
    with_basis = not modes_only and not scene.static_only
    by_motion = basis.derivatives in ("mmi", "mmi-nls")
    selecting = nonlinear and by_motion and not scene.static_only
    listed = nonlinear and not by_motion and basis.derivatives != "none"
    derivatives = _derivatives_reason(scene) if with_modes else ALL_STATIC
    no_basis = MODES_ONLY if modes_only else ALL_STATIC
    which = f"basis.method is {basis.method}" if with_modes else ALL_STATIC
    return [
        Stage("mesh", True, f"{scene.geometry.mesh.name}, {scene.geometry.dimension}D", _mesh),
        Stage(
            "solid",
            True,
            f"elements of degree {scene.geometry.degree}",
            _solid,
            _solid_parts(scene),
        ),
        Stage("modes", with_modes, which, _modes, _mode_parts(scene) if with_modes else ()),
        Stage("linear transient", with_modes and selecting, derivatives, _linear_transient),
        Stage(
            "nonlinear statics",
            with_modes and selecting and basis.derivatives == "mmi-nls",
            derivatives,
            _nonlinear_statics,
        ),
        Stage("selection", with_modes, derivatives, _selection),
        Stage("derivatives", with_modes and (selecting or listed), derivatives, _derivatives),
        Stage("basis", with_basis, which if with_basis else no_basis, _basis),
        Stage(
            "reduction",
            with_basis,
            _elastic_reason(scene) if with_basis else no_basis,
            _reduced_model,
            _reduction_parts(scene) if with_basis else (),
        ),
    ]


def _file_stages(scene: Scene, moving: bool, modes_only: bool) -> list[Stage]:
    """List the stages that write files: the numbers first, the report with its pictures last."""
    output = scene.output
    why_not = MODES_ONLY if modes_only else ALL_STATIC

    def wanted(name: str, key: str, needed: bool, write: Callable[[Run], None]) -> Stage:
        """Make a stage that the key of the [output] table switches on."""
        on = getattr(output, key)
        reason = f"output.{key} is {_lower(on)}" if needed or not on else why_not
        return Stage(name, on and needed, reason, write, writes=True)

    shapes = moving or modes_only
    fields = shapes or any(load.static for load in scene.loads) or scene.rotation is not None
    return [
        Stage("numbers", True, "every run", _numbers, writes=True),
        wanted("ParaView modes", "paraview", fields, _paraview_modes),
        wanted("ParaView motion", "motion", moving, _paraview_motion),
        wanted("pictures", "pictures", shapes, _pictures),
        wanted("animation", "animation", moving, _animation),
        Stage("report", True, "every run", _report, writes=True),
    ]


def _lower(value: bool) -> str:
    """Write a truth value as TOML does."""
    return str(value).lower()


def _count(number: int, noun: str) -> str:
    """Write a number and a noun, which gets an s in the plural."""
    return f"{number} {noun}{'s' * (number != 1)}"


def _solid_parts(scene: Scene) -> tuple[Item, ...]:
    """List what is assembled and solved with the solid."""
    static = sum(load.static for load in scene.loads)
    rotation = scene.rotation
    loads = _count(static, "static load") if static else "no static load"
    return (
        Item(
            "static equilibrium",
            static > 0 or rotation is not None,
            f"{loads}, centrifugal force" if rotation else loads,
        ),
        Item(
            "rotating frame",
            rotation is not None,
            f"{rotation.speed_rpm:g} rpm" if rotation else "no rotation",
        ),
        Item(
            "gyroscopic term",
            rotation is not None and rotation.coriolis,
            f"rotation.coriolis is {_lower(rotation.coriolis)}" if rotation else "no rotation",
        ),
    )


def _mode_parts(scene: Scene) -> tuple[Item, ...]:
    """List the kinds of component modes."""
    basis = scene.basis
    interface = "free" if basis.method == "rubin" else "fixed"
    return (
        Item("normal modes", basis.modes > 0, f"{basis.modes} {interface}-interface modes"),
        Item("static modes", bool(scene.contacts), _static_modes_reason(scene)),
    )


def _static_modes_reason(scene: Scene) -> str:
    """Describe the contact displacements that have static modes."""
    masters = scene.basis.masters
    if not scene.contacts:
        return "no contact"
    if not isinstance(masters, str):
        return f"interface modes, at most {masters}"
    each = scene.geometry.dimension if masters == "all" else 1
    what = "contact displacements" if masters == "all" else "normal contact displacements"
    points = sum(contact.place.at != "nodes" for contact in scene.contacts)
    regions = [k for k, contact in enumerate(scene.contacts) if contact.place.at == "nodes"]
    if not regions:
        return f"{points * each} {what}"
    parts = [f"{points * each}"] if points else []
    parts += [f"{each} per node of contacts[{k}]" for k in regions]
    return f"{what}: {', '.join(parts)}"


def _derivatives_reason(scene: Scene) -> str:
    """Say how the modal derivatives are selected."""
    wanted = scene.basis.derivatives
    if not scene.geometrically_nonlinear:
        return "the scene is geometrically linear"
    kind = wanted if isinstance(wanted, str) else "a list of labels"
    if wanted in ("mmi", "mmi-nls") and scene.static_only:
        return f"basis.derivatives is {kind}, but all loads are static"
    return f"basis.derivatives is {kind}"


def _elastic_reason(scene: Scene) -> str:
    """Say how the elastic force is reduced."""
    if not scene.geometrically_nonlinear:
        return "the scene is geometrically linear"
    return f"basis.elastic_force is {scene.basis.elastic_force}"


def _reduction_parts(scene: Scene) -> tuple[Item, ...]:
    """List the terms of the reduced model."""
    nonlinear, touching = scene.geometrically_nonlinear, bool(scene.contacts)
    projected = scene.basis.elastic_force == "projection"
    elastic, dimension = _elastic_reason(scene), scene.geometry.dimension
    regions = sum(contact.place.at == "nodes" for contact in scene.contacts)
    points = len(scene.contacts) - regions
    parts = [_count(points, "point")] if points else []
    parts += [f"every node of {_count(regions, 'place')}"] if regions else []
    where = " and ".join(parts) or "no contact"
    return (
        Item("elastic polynomial", nonlinear and not projected, elastic),
        Item("intrusive projection", nonlinear and projected, elastic),
        Item("contact forces", touching, where),
        Item(
            "contact weighting",
            regions > 0,
            where if regions or not touching else "no region of many nodes",
        ),
        Item(
            "second tangent direction",
            touching and dimension == 3,
            f"{dimension} dimensions" if touching else "no contact",
        ),
    )


def _newton_item(scene: Scene) -> Item:
    """Say whether a time step iterates."""
    nonlinear = scene.geometrically_nonlinear
    reason = (
        "nonlinear elastic force" if nonlinear else f"{_elastic_reason(scene)}: one solve per step"
    )
    return Item("Newton iterations", nonlinear, reason)


# ------------------------------------------------------------------ running the stages


def run(
    scene: Scene,
    comm: Any = None,
    say: Callable[[str], None] | None = None,
    *,
    folder: Path | None = None,
    resume: Path | None = None,
    modes_only: bool = False,
    stop: Callable[[], bool] = never,
    mesh: Mesh | None = None,
) -> Study:
    """Run all stages that a scene needs.

    Args:
        scene: the scene.
        comm: MPI communicator of the offline stages and the full model; by default all ranks.
        say: receives the progress, one line at a time; by default nobody.
        folder: folder of the output files; None writes no files.
        resume: checkpoint from which the reduced model continues.
        modes_only: stop after the modal derivatives.
        stop: called between stages and after each period; the run ends when it returns True.
        mesh: the mesh; None makes or reads the mesh of the scene.

    Returns:
        The record of the run. If the integration or a check of a model failed, `unfinished` holds
        the name of the model and the error, and `motions` holds the motion up to the failure.

    Raises:
        SceneError: the scene or the checkpoint cannot be used.
        ConvergenceError, AccuracyError: an offline stage failed.
        KeyboardInterrupt: `stop` returned True.
        OSError: a file cannot be written.
    """
    from fenicsrom.post.record import Study

    watch = Stopwatch(say if say is not None else lambda line: None)
    run = Run(Study(scene), comm or _all_ranks(), watch, folder, resume, stop, mesh)
    execute(run, stages(scene, modes_only, files=folder is not None))
    return run.study


def offline(
    scene: Scene, comm: Any, watch: Stopwatch, modes_only: bool = False, mesh: Mesh | None = None
) -> Study:
    """Run the stages up to the reduced model, or up to the modal derivatives; write no files."""
    from fenicsrom.post.record import Study

    run = Run(Study(scene), comm, watch, mesh=mesh)
    execute(run, _offline_stages(scene, modes_only))
    return run.study


def build_model(scene: Scene, mesh: Mesh | None = None, comm: Any = None) -> StoredModel:
    """Build the reduced model of a scene, without integrating it.

    Args:
        scene: the scene.
        mesh: the mesh; None makes or reads the mesh of the scene.
        comm: MPI communicator; by default all ranks.

    Returns:
        The model with its scene and labels, for `StoredModel.simulate` and `save_model`.

    Raises:
        SceneError: the scene cannot be used, or all its loads are static.
        ConvergenceError, AccuracyError: a stage failed.
    """
    from fenicsrom.post.summary import stored_model

    if scene.static_only:
        reason = "all loads are static, so there is no reduced model to integrate"
        raise SceneError(f"{scene.source}: {reason}", kind=ErrorKind.CONFLICT, source=scene.source)
    watch = Stopwatch(lambda line: None)
    return stored_model(offline(scene, comm or _all_ranks(), watch, mesh=mesh))


def response(
    scene: Scene,
    comm: Any = None,
    say: Callable[[str], None] | None = None,
    *,
    folder: Path | None = None,
    stop: Callable[[], bool] = never,
) -> Response:
    """Build the reduced model of a scene and compute its response curves.

    Args:
        scene: the scene, with a table [response].
        comm: MPI communicator of the offline stages; by default all ranks.
        say: receives the progress, one line at a time; by default nobody.
        folder: folder of the reduced model; None writes no model.
        stop: asked between the offline stages; the run ends where it returns True.

    Raises:
        SceneError: the scene cannot be used.
        ConvergenceError, AccuracyError: an offline stage failed.
        KeyboardInterrupt: `stop` returned True before the curves began.
        OSError: the model cannot be written.
    """
    from fenicsrom.assess.response import check_response
    from fenicsrom.online.archive import save_model
    from fenicsrom.post.record import Study
    from fenicsrom.post.summary import MODEL, stored_model

    check_response(scene)
    say = say if say is not None else (lambda line: None)
    run = Run(Study(scene), comm or _all_ranks(), Stopwatch(say), folder, stop=stop)
    execute(run, _offline_stages(scene, modes_only=False))
    stored = stored_model(run.study)
    if folder is not None and run.comm.rank == 0:
        save_model(folder / MODEL, stored)
    found = response_of_model(stored, say)
    found.warnings[:0] = run.study.warnings
    return found


def response_of_model(stored: StoredModel, say: Callable[[str], None] | None = None) -> Response:
    """Compute the response curves of a stored model; arguments as `response`.

    Raises:
        SceneError: the scene of the model cannot be used.
    """
    from fenicsrom.assess import response as curves

    watch = Stopwatch(say if say is not None else lambda line: None)
    with watch("response curves"):
        return curves.response(stored, watch.say)


def _all_ranks() -> Any:
    """Give the communicator of all ranks."""
    from mpi4py import MPI

    return MPI.COMM_WORLD


def execute(run: Run, listed: list[Stage]) -> None:
    """Run the needed stages in their order.

    After a failed motion or check, only the stages that write files run.
    """
    study = run.study
    study.left_out += [
        f"{item.name}: {item.reason}"
        for stage in listed
        for item in (stage, *stage.parts)
        if not item.needed
    ]
    for stage in listed:
        if not stage.needed or (study.unfinished and not stage.writes):
            continue
        _stop_where_asked(run.stop)
        with run.watch(stage.name):
            stage.run(run)
        if not stage.writes:
            study.seconds.setdefault(stage.name, run.watch.seconds[stage.name])


def _mesh(run: Run) -> None:
    """Make or read the mesh, unless the caller gave one."""
    from fenicsrom.fem.mesh import build_mesh

    if run.mesh is None:
        run.mesh = build_mesh(run.study.scene.geometry, run.comm)


def _solid(run: Run) -> None:
    """Assemble the solid, and solve for its static equilibrium if there are static loads."""
    import numpy as np

    from fenicsrom.fem.solid import solid_of

    assert run.mesh is not None
    solid = run.study.solid = solid_of(run.study.scene, run.mesh)
    if solid.loaded:
        deflection = solid.comm.allreduce(solid.probe_rows @ solid.equilibrium)
        run.study.deflection = np.asarray(deflection)


def _modes(run: Run) -> None:
    """Compute the component modes."""
    from fenicsrom.reduction.modes import component_modes
    from fenicsrom.reduction.snapshots import Snapshots
    from fenicsrom.reduction.stages import Reduction

    study, basis = run.study, run.study.scene.basis
    study.modes = component_modes(study.solid, basis)
    run.snapshots = Snapshots(study.solid, study.scene, study.modes)
    run.reduction = Reduction(
        study.solid, study.scene, lambda stage: nullcontext(), study.modes, run.snapshots
    )


def _linear_transient(run: Run) -> None:
    """Compute the deflections of the geometrically linear transient."""
    assert run.snapshots.linear is not None


def _nonlinear_statics(run: Run) -> None:
    """Compute the nonlinear static deflections."""
    assert run.snapshots.static is not None


def _selection(run: Run) -> None:
    """Select modes and derivatives, and note the ones that are left out."""
    from fenicsrom.reduction.stages import Derivatives

    study = run.study
    assert study.modes is not None
    selection = study.selection = run.reduction.selection
    study.derivatives = Derivatives((), study.modes.normal[:, :0])  # placeholder
    if not selection.derivatives:
        run.reduction.derivatives = study.derivatives
    threshold = study.scene.basis.threshold
    dropped = [label for label in study.modes.labels if label not in selection.modes]
    light = [label for label in selection.weights if label not in selection.derivatives]
    if dropped:
        study.left_out.append(
            f"modes {', '.join(dropped)}: their amplitude is below {threshold:g} of the largest"
        )
    if light:
        study.left_out.append(
            f"derivatives {', '.join(light)}: their weight is at most {threshold:g} of the largest"
        )


def _derivatives(run: Run) -> None:
    """Compute the selected modal derivatives."""
    run.study.derivatives = run.reduction.derivatives


def _basis(run: Run) -> None:
    """Build the reduced basis."""
    run.study.basis = run.reduction.basis


def _reduced_model(run: Run) -> None:
    """Project the solid on the basis."""
    run.study.model = run.reduction.model


def _integrate(run: Run, name: str) -> None:
    """Integrate one model: "reduced", "full" or "beam"."""
    from fenicsrom.online.measures import out_of_reach
    from fenicsrom.online.simulate import simulate
    from fenicsrom.post.sentences import (
        buckled_sentence,
        free_slider_sentence,
        unsteady_sentence,
    )

    study, scene = run.study, run.study.scene
    options = _checkpoints(run) if name == "reduced" else {}
    try:
        motion = simulate(
            _model(study, name),
            scene,
            keep_coordinates=name == "reduced",
            progress=run.watch.progress(name, scene.time.steady_tolerance),
            stop=run.stop,
            **options,
        )
    except (AccuracyError, ConvergenceError) as error:
        study.unfinished = (name, error)
        if error.partial is None:
            return
        motion = error.partial
    study.motions[name] = motion
    if name == "reduced" and scene.contacts:
        study.left_out += out_of_reach(motion, study.solid.points)
    if study.unfinished:
        return
    if motion.buckled:
        study.warnings.append(buckled_sentence(name, motion))
    if sentence := free_slider_sentence(name, motion):
        study.warnings.append(sentence)
    if not motion.steady and scene.period is not None and scene.time.steady_tolerance:
        study.warnings.append(unsteady_sentence(name, motion, scene))
    study.seconds[f"{name} motion"] = motion.seconds  # without the compilation


def _model(study: Study, name: str) -> Any:
    """Make the model of this name."""
    if name == "full":
        from fenicsrom.fem.full import full_model

        return full_model(study.solid)
    if name == "beam":
        from fenicsrom.reduction.beam import beam_model

        return beam_model(study.scene)
    return study.model


def _checkpoints(run: Run) -> dict[str, Any]:
    """Load the checkpoint to resume from, write the model, and prepare the next checkpoints.

    Raises:
        SceneError: the checkpoint does not belong to this model and scene.
        OSError: a file cannot be written.
    """
    from fenicsrom.online.archive import save_model
    from fenicsrom.online.checkpoints import keeper, load_checkpoint
    from fenicsrom.online.model import ReducedModel
    from fenicsrom.post.summary import CHECKPOINT, MODEL, stored_model

    study, model = run.study, run.study.model
    if not isinstance(model, ReducedModel):
        if run.resume is not None:
            raise SceneError(
                f'{run.resume}: basis.elastic_force = "projection" has no checkpoints; '
                'use "polynomial"',
                kind=ErrorKind.CONFLICT,
                key="basis.elastic_force",
                source=str(run.resume),
            )
        return {}
    options: dict[str, Any] = {}
    if run.resume is not None:
        options["resume"] = load_checkpoint(run.resume, model, study.scene)
    if run.folder is not None and run.comm.rank == 0:
        save_model(run.folder / MODEL, stored_model(study))
        study.files.append(run.folder / MODEL)
        keep = keeper(run.folder / CHECKPOINT, model, study.scene)
        options["checkpoint"] = keep
    return options


def _stop_where_asked(stop: Callable[[], bool]) -> None:
    """End the run if `stop` asks for it.

    Raises:
        KeyboardInterrupt: `stop` returned True.
    """
    if stop():
        raise KeyboardInterrupt


def check(study: Study) -> None:
    """Estimate the errors of the motions; an error that is too large makes the study unfinished."""
    from fenicsrom.assess.estimates import basis_error, richer_basis, start_in, step_errors
    from fenicsrom.assess.verdicts import check_basis_error, check_time_error
    from fenicsrom.online.energy import check_energy
    from fenicsrom.online.measures import has_settled, is_unsteady
    from fenicsrom.reduction.stages import reduce

    scene, model = study.scene, ""
    try:
        for name, motion in study.motions.items():
            model = name
            check_energy(motion)
        model, motion = "reduced", study.motions["reduced"]
        study.errors["time step"], force = step_errors(study.model, scene, motion)
        if scene.contacts:
            study.errors["peak force by the time step"] = force
        check_time_error(scene, study.errors["time step"], is_unsteady(motion))
        if has_settled(motion) and study.modes is not None and study.derivatives is not None:
            richer = richer_basis(
                study.solid,
                scene,
                study.modes,
                study.selection,
                study.derivatives,
                motion.buckled > 0,
            )
            if richer is not None:
                assert study.basis is not None
                study.errors["basis"] = basis_error(
                    reduce(study.solid, scene.basis, richer),
                    scene,
                    motion,
                    start_in(study.solid, study.basis, richer, motion),
                )
                check_basis_error(scene, study.errors["basis"])
    except (AccuracyError, ConvergenceError) as error:
        study.unfinished = (model, error)


# ------------------------------------------------------------------ files


def _output(run: Run) -> Path:
    """Give the folder of the output files."""
    assert run.folder is not None
    return run.folder


def _numbers(run: Run) -> None:
    """Write the summary, the history and the checkpoint."""
    from fenicsrom.post.summary import write_numbers

    if run.comm.rank == 0:
        run.study.files = [*write_numbers(run.study, _output(run)), *run.study.files]


def _paraview_modes(run: Run) -> None:
    """Write the shapes for ParaView."""
    from fenicsrom.post.fields import write_shapes

    run.study.files += write_shapes(run.study, _output(run))


def _paraview_motion(run: Run) -> None:
    """Write the last period of the reduced model for ParaView."""
    from fenicsrom.post.fields import write_last_period

    if "reduced" in run.study.motions:
        run.study.files += write_last_period(run.study, _output(run))


def _pictures(run: Run) -> None:
    """Draw the motions and the shapes."""
    from fenicsrom.post.pictures import write_pictures

    run.study.pictures += write_pictures(run.study, _output(run))


def _animation(run: Run) -> None:
    """Animate the last period of the reduced model."""
    from fenicsrom.post.pictures import write_animation

    if "reduced" in run.study.motions:
        run.study.pictures += write_animation(run.study, _output(run))


def _report(run: Run) -> None:
    """Write the report, and the summary again if there are new warnings about the pictures."""
    from fenicsrom.post.report import write_study_report
    from fenicsrom.post.summary import SUMMARY, summary
    from fenicsrom.post.writers import write_summary

    if run.comm.rank == 0:
        study, folder = run.study, _output(run)
        write_summary(folder / SUMMARY, summary(study))
        report = write_study_report(study, folder)
        study.files = [report, *study.files, *(path for _, path in study.pictures)]


# ------------------------------------------------------------------ a stored model


@dataclass(frozen=True, eq=False)
class Rerun:
    """The record of a run of a stored model.

    Attributes:
        motion: the motion; up to the failure if there was one.
        unfinished: the error of the integration or of a check, or None.
        warnings: warnings for the user.
        files: the written files.
    """

    motion: Motion
    unfinished: ConvergenceError | AccuracyError | None
    warnings: list[str]
    files: list[Path]


def rerun(
    stored: StoredModel,
    model: Any,
    scene: Scene,
    folder: Path,
    *,
    resume: Path | None = None,
    say: Callable[[str], None] | None = None,
    stop: Callable[[], bool] = never,
) -> Rerun:
    """Integrate a stored model, check the motion and write the files: the numbers first.

    Args:
        stored: the stored model, for its provenance.
        model: the model with the parameters of the scene.
        scene: the scene.
        folder: folder of the output files.
        resume: checkpoint from which the model continues.
        say: receives the progress, one line at a time; by default nobody.
        stop: called between stages and after each period; the run ends when it returns True.

    Raises:
        SceneError: the checkpoint cannot be used.
        ConvergenceError, AccuracyError: the integration failed at its start.
        KeyboardInterrupt: `stop` returned True.
        OSError: a file cannot be written.
    """
    from fenicsrom.assess.verdicts import rejection_reason
    from fenicsrom.online.checkpoints import keeper, load_checkpoint
    from fenicsrom.online.simulate import simulate
    from fenicsrom.post.pictures import motion_pictures, not_drawn, write_motion_pictures
    from fenicsrom.post.report import write_rerun_report
    from fenicsrom.post.sentences import free_slider_sentence
    from fenicsrom.post.summary import CHECKPOINT, write_rerun_numbers

    watch = Stopwatch(say if say is not None else lambda line: None)
    begin = load_checkpoint(resume, model, scene) if resume is not None else None
    unfinished: ConvergenceError | AccuracyError | None
    with watch("reduced motion"):
        try:
            motion = simulate(
                model,
                scene,
                resume=begin,
                checkpoint=keeper(folder / CHECKPOINT, model, scene),
                progress=watch.progress("reduced", scene.time.steady_tolerance),
                stop=stop,
            )
        except (AccuracyError, ConvergenceError) as error:
            if error.partial is None:
                raise
            motion, unfinished = error.partial, error
        else:
            unfinished = None
    if unfinished is None:
        _stop_where_asked(stop)
        with watch("checks"):
            unfinished = rejection_reason(model, scene, motion)
    _stop_where_asked(stop)
    with watch("numbers"):
        files = write_rerun_numbers(stored, scene, motion, folder)
    _stop_where_asked(stop)
    pictures = motion_pictures({"reduced": motion}) if scene.output.pictures else []
    sentence = not_drawn([picture.name for picture in pictures])
    free = free_slider_sentence("reduced", motion)
    warnings = [text for text in (free, sentence) if text]
    with watch("pictures"):
        written = write_motion_pictures([] if sentence else pictures, folder)
    report = write_rerun_report(stored, scene, motion, written, warnings, folder)
    return Rerun(motion, unfinished, warnings, [report, *files, *(path for _, path in written)])

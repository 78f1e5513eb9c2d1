"""A study: the stages of a scene in their order, each run only if the scene needs it.

    scene -> mesh -> solid -> modes -> selection -> derivatives -> basis -> reduced model -> motion

Each step is a function of its own, to be called from Python one by one (`demos/slip_liftoff.py`) or
all together by `run`.
"""

from __future__ import annotations

import time as clock
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from fenicsrom.arrays import Array
from fenicsrom.assess.estimates import basis_error, richer_basis, step_errors
from fenicsrom.assess.verdicts import (
    check_basis_error,
    check_time_error,
    other_scheme,
)
from fenicsrom.errors import AccuracyError, ConvergenceError
from fenicsrom.fem.full import full_model
from fenicsrom.fem.solid import Solid
from fenicsrom.online.energy import check_energy
from fenicsrom.online.measures import has_settled, is_unsteady, out_of_reach
from fenicsrom.online.motion import Motion
from fenicsrom.online.simulate import simulate
from fenicsrom.plan import Stage, plan
from fenicsrom.reduction.basis import ReducedBasis
from fenicsrom.reduction.beam import beam_model
from fenicsrom.reduction.modes import ComponentModes, component_modes
from fenicsrom.reduction.selection import Selection
from fenicsrom.reduction.stages import Derivatives, Reduction, reduce
from fenicsrom.scene import Scene


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
        errors: estimated relative errors of the reduced model's amplitudes by the "time step" and
            the "basis", and of its "peak force by the time step".
        deflection: (d,) displacement of the probe in the equilibrium, m; None without static load.
        unfinished: the name of the model whose integration or whose check failed, with its error;
            None if all went well.
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
    """What comes before the motion: mesh, solid, modes, selection and derivatives of a scene, basis
    and model.

    Without basis and model if only the modes are asked for; mesh and solid alone of a scene in
    which nothing moves.
    """
    from fenicsrom.fem.mesh import build_mesh

    stages = plan(scene, modes_only)
    with watch("mesh"):
        mesh = build_mesh(scene.geometry, comm)
    with watch("solid"):
        solid = Solid(mesh, scene)
    if scene.static_only and not modes_only:
        none = component_modes(solid, scene.basis.method, 0)
        study = Study(
            scene,
            stages,
            solid,
            none,
            Selection((), (), {}, {}),
            Derivatives((), none.normal),
            seconds=watch.seconds,
        )
        return _reported(study)
    found = Reduction(solid, watch)
    modes, selection, derivatives = found.modes, found.selection, found.derivatives
    study = _reported(
        Study(scene, stages, solid, modes, selection, derivatives, seconds=watch.seconds)
    )
    if not modes_only:
        study.basis, study.model = found.basis, found.model
    dropped = [label for label in modes.labels if label not in selection.modes]
    light = [
        label for label, weight in selection.weights.items() if label not in selection.derivatives
    ]
    threshold = scene.basis.threshold
    if dropped:
        study.left_out.append(
            f"modes {', '.join(dropped)}: take part with less than {threshold:g} of the largest"
        )
    if light:
        study.left_out.append(
            f"derivatives {', '.join(light)}: weigh at most {threshold:g} of the largest"
        )
    return study


def _reported(study: Study) -> Study:
    """The study with what it left out, and where the static loads leave the probe; collective."""
    solid = study.solid
    study.left_out = [f"{stage.name}: {stage.why}" for stage in study.stages if not stage.runs]
    if solid.loaded:
        study.deflection = np.asarray(solid.comm.allreduce(solid.probe_rows @ solid.equilibrium))
    return study


def run(
    scene: Scene,
    comm: Any,
    say: Callable[[str], None],
    restarts: Callable[[Study], dict[str, Any]] | None = None,
) -> Study:
    """Everything a scene asks for, but the files.

    Args:
        scene: the scene.
        comm: MPI communicator of the offline stage and the full model.
        say: is told what happens, a line at a time.
        restarts: is shown the reduced model before it moves, and gives the `resume` and
            `checkpoint` of its motion.

    Returns:
        What was found; `unfinished` names a model whose integration failed, its motion up to there
        is in `motions`.

    Raises:
        SceneError: the scene asks for something impossible.
        ConvergenceError, AccuracyError: an offline stage failed.
    """
    watch = Stopwatch(say)
    study = offline(scene, comm, watch)
    if scene.static_only:
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
                    model,
                    scene,
                    keep_coordinates=name == "reduced",
                    progress=watch.progress(name, scene.time.steady_tolerance),
                    **options,
                )
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
        if (
            not study.motions[name].steady
            and scene.period is not None
            and scene.time.steady_tolerance
        ):
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
    """Estimate the errors of the motions and keep them in the study; one that is too large makes it
    unfinished.
    """
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
        if has_settled(motion):
            richer = richer_basis(
                study.solid,
                scene,
                study.modes,
                study.selection,
                study.derivatives,
                motion.buckled > 0,
            )
            if richer is not None:
                study.errors["basis"] = basis_error(reduce(study.solid, richer), scene, motion)
                check_basis_error(scene, study.errors["basis"])
    except (AccuracyError, ConvergenceError) as error:
        study.unfinished = (model, error)

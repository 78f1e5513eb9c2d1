"""The stages of a scene in their order, with the reason why the scene needs each stage.

    mesh -> solid -> modes -> selection -> derivatives -> basis -> reduced model -> candidates
        -> motions -> files

`stages` is the only place that says what a scene needs. `run` executes the needed stages, `plan`
lists all of them. The numbers are written before the pictures.
"""

from collections.abc import Callable
from functools import partial
from typing import Any

from fenicsrom.scene import Scene
from fenicsrom.scene.base.rules import BY_MOTION
from fenicsrom.scene.base.tables import toml_value
from fenicsrom.scene.checks.checks import LEAST_MODES
from fenicsrom.scene.keys.excitation import HIGHEST_MODE, highest_frequency
from fenicsrom.study import building, motions, writing
from fenicsrom.study.stage import Item, Run, Stage
from fenicsrom.words import counted

Work = Callable[[Run], None]

ALL_STATIC = "no load varies in time, so only the equilibrium is computed"
MODES_ONLY = "only the modes are asked for"


def plan(scene: Scene, modes_only: bool = False) -> list[Item]:
    """List the stages of a scene, each followed by its parts."""
    if scene.speeds_rpm is not None and not modes_only:
        speeds = ", ".join(f"{speed:g}" for speed in scene.speeds_rpm)
        reason = f"rotation.speeds_rpm joins {speeds} rpm"
        model = Item("model for all speeds", True, reason)
        listed = stages(scene.at_speed(scene.speeds_rpm[-1]))
        names = "mesh", "solid", "reduced motion", "size", "checks", "numbers", "pictures", "report"
        kept = [stage for stage in listed if stage.name in names]
        return [*kept[:2], model, *kept[2:]]
    return [item for stage in stages(scene, modes_only) for item in (stage, *stage.parts)]


def stages(scene: Scene, modes_only: bool = False, files: bool = True) -> list[Stage]:
    """List the stages of a scene in their order.

    Args:
        scene: the scene.
        modes_only: stop after the modal derivatives.
        files: include the stages that write files.
    """
    moved, basis = _with_motion(scene, modes_only), scene.basis
    full, beam = scene.reference.full, scene.reference.beam
    full_reason = f"reference.full is {toml_value(full)}"
    beam_reason = f"reference.beam is {'given' if beam else 'not given'}"
    scheme = f"time.scheme is {scene.time.scheme}"
    unseen = "what the full equations ask for and no candidate holds judges the basis, too"
    checked = "energy balance, time step, basis and mesh"
    listed = [
        *offline_stages(scene, modes_only),
        moved("beam check", beam, beam_reason, lambda run: motions.check_beam(run.study)),
        moved("reduced motion", True, scheme, _motion_of("reduced"), (newton_item(scene),)),
        moved("size", basis.adapts, size_reason(scene), motions.fit_size),
        moved("residual", True, unseen, motions.see_residual),
        moved("mode comparison", full, full_reason, lambda run: motions.compare_modes(run.study)),
        moved("full motion", full, full_reason, _motion_of("full")),
        moved("beam motion", beam, beam_reason, _motion_of("beam")),
        moved("checks", True, checked, lambda run: motions.check(run.study)),
        Stage("stresses", with_stresses(scene), stress_reason(scene), motions.stresses),
    ]
    return listed + (_file_stages(scene, modes_only) if files else [])


def offline_stages(scene: Scene, modes_only: bool) -> list[Stage]:
    """List the stages from the mesh to the reduced model."""
    basis, nonlinear = scene.basis, scene.geometrically_nonlinear
    geometry, moved = scene.geometry, _with_motion(scene, modes_only)
    with_modes = modes_only or not scene.static_only
    by_motion = basis.derivatives in BY_MOTION
    selecting = nonlinear and by_motion and not scene.static_only
    statics = selecting and basis.derivatives != "mmi"
    deriving = selecting or (nonlinear and not by_motion and basis.derivatives not in ("none", ()))
    derivatives = derivatives_reason(scene) if with_modes else ALL_STATIC
    which = f"basis.method is {basis.method}" if with_modes else ALL_STATIC
    left_out = "vectors that the basis leaves out: they judge it, and it may take them"
    reduction, terms = elastic_reason(scene), reduction_parts(scene)
    without = "without contact (of bodies that touch: closed points stuck), and all points stuck"
    stuck = Stage("contact frequencies", True, without, building.contact_frequencies)
    names = ", ".join(file.name for file in geometry.files)
    file, degree = f"{names}, {geometry.dimension}D", geometry.degree
    elements, finer = f"elements of degree {degree}", f"elements of degree {degree + 1}"
    parts = building.solid, building.modes
    solid, modes = (partial(part, modes_only=modes_only) for part in parts)
    return [
        Stage("mesh", True, file, building.mesh),
        Stage("solid", True, elements, solid, solid_parts(scene)),
        Stage(
            "interface vectors",
            with_modes and not modes_only and basis.masters == "motion",
            f"basis.masters is {basis.masters}",
            building.interface_vectors,
        ),
        Stage("modes", with_modes, which, modes, mode_parts(scene) if with_modes else ()),
        *([stuck] if modes_only and scene.contacts else []),
        Stage("linear transient", selecting, derivatives, building.linear_transient),
        Stage("nonlinear statics", statics, derivatives, building.nonlinear_statics),
        Stage("selection", with_modes, derivatives, building.selection),
        Stage("derivatives", with_modes and deriving, derivatives, building.derivatives),
        moved("basis", True, which, building.basis),
        moved("candidates", True, left_out, building.candidates),
        moved("reduction", True, reduction, building.reduced_model, terms),
        Stage("finer elements", True, f"{finer} judge the mesh", building.finer_elements),
        Stage("stress points", with_stresses(scene), stress_reason(scene), building.stress_points),
    ]


def _file_stages(scene: Scene, modes_only: bool) -> list[Stage]:
    """List the stages that write files, from the numbers to the report with its pictures."""
    output = scene.output
    moving, why_not = _moving(scene, modes_only)

    def wanted(name: str, key: str, needed: bool, write: Work) -> Stage:
        """Make a stage that the key of the [output] table switches on."""
        on = getattr(output, key)
        reason = f"output.{key} is {toml_value(on)}" if needed or not on else why_not
        return Stage(name, on and needed, reason, write, writes=True)

    shapes = output.paraview and (moving or modes_only or is_loaded(scene))
    keys = [f"output.{key} is {toml_value(getattr(output, key))}" for key in ("paraview", "motion")]
    in_scene = shapes or (output.motion and moving)
    stressed = with_stresses(scene) and output.pictures
    peaks = stress_reason(scene) if output.pictures else "output.pictures is false"
    return [
        Stage("numbers", True, "every run", writing.numbers, writes=True),
        wanted("ParaView modes", "paraview", shapes, writing.paraview_modes),
        wanted("ParaView motion", "motion", moving, writing.paraview_motion),
        Stage("ParaView scene", in_scene, ", ".join(keys), writing.paraview_scene, writes=True),
        wanted("pictures", "pictures", True, writing.pictures),
        Stage("stress picture", stressed, peaks, writing.stress_picture, writes=True),
        wanted("animation", "animation", moving, writing.animation),
        Stage("report", True, "every run", writing.report, writes=True),
    ]


def _with_motion(scene: Scene, modes_only: bool) -> Callable[..., Stage]:
    """A function that makes a stage, as `Stage` does, which only models with a motion need."""
    moving, why_not = _moving(scene, modes_only)

    def stage(name: str, *given: Any) -> Stage:
        """Make a stage."""
        return Stage(name, *given) if moving else Stage(name, False, why_not, given[2])

    return stage


def _motion_of(model: str) -> Work:
    """The work of integrating a model."""
    return lambda run: motions.integrate(run, model)


def _moving(scene: Scene, modes_only: bool) -> tuple[bool, str]:
    """Tell whether the models are integrated, and the reason if they are not."""
    return not scene.static_only and not modes_only, MODES_ONLY if modes_only else ALL_STATIC


def is_loaded(scene: Scene) -> bool:
    """Whether static loads, contacts between bodies or the centrifugal force deform the body."""
    turning = scene.rotation is not None and scene.rotation.speed_rpm != 0.0
    return turning or scene.joined or any(load.static and load.size != 0.0 for load in scene.loads)


def solid_parts(scene: Scene) -> tuple[Item, ...]:
    """The parts of the solid."""
    rotation, loaded = scene.rotation, is_loaded(scene)
    turning = rotation is not None and rotation.speed_rpm != 0.0
    coriolis = rotation is not None and turning and rotation.coriolis
    speed = f"{rotation.speed_rpm:g} rpm" if rotation else "no rotation"
    frame = f"rotation.coriolis is {toml_value(coriolis)}" if turning else "no rotation"
    forces = "static loads and rotation" if loaded else "no static load, no rotation"
    forces = "contacts between bodies" if scene.joined else forces
    return (
        Item("static equilibrium", loaded, forces),
        Item("rotating frame", turning, speed),
        Item("gyroscopic term", coriolis, frame),
        Item("damped modes", any(scene.damping.modal), "damping.ratios"),
    )


def mode_parts(scene: Scene) -> tuple[Item, ...]:
    """The parts of the modes."""
    basis, contacts = scene.basis, bool(scene.contacts)
    varies = any(not load.static for load in scene.loads)
    modes = f"basis.modes is {basis.modes}"
    if basis.modes == "auto":
        modes += f": up to {HIGHEST_MODE * highest_frequency(scene):.5g} Hz, at least {LEAST_MODES}"
    masters = f"basis.masters is {basis.masters}" if contacts else "no contact"
    return (
        Item("normal modes", basis.modes != 0, modes),
        Item("responses to loads", varies, "loads that the modes do not represent"),
        Item("static modes", contacts, masters),
    )


def derivatives_reason(scene: Scene) -> str:
    """Say how the modal derivatives are selected."""
    wanted = scene.basis.derivatives
    if not scene.geometrically_nonlinear:
        return "the scene is geometrically linear"
    kind = wanted if isinstance(wanted, str) else "a list of labels" if wanted else "empty"
    if wanted in BY_MOTION and scene.static_only:
        return f"basis.derivatives is {kind}, but all loads are static"
    return f"basis.derivatives is {kind}"


def size_reason(scene: Scene) -> str:
    """Say why the basis takes coordinates, or not."""
    basis = scene.basis
    if basis.size is not None:
        return f"basis.size is {basis.size}"
    if basis.adapts:
        return f"basis.accuracy is {basis.accuracy:g}"
    if basis.derivatives == "principal":
        return f"basis.elastic_force is {basis.elastic_force}"
    return "basis.derivatives chooses all coordinates"


def reduction_parts(scene: Scene) -> tuple[Item, ...]:
    """List the terms of the reduced model."""
    nonlinear, touching = scene.geometrically_nonlinear, bool(scene.contacts)
    projected = scene.basis.elastic_force == "projection"
    elastic, dimension = elastic_reason(scene), scene.geometry.dimension
    regions = sum(contact.place.at == "nodes" for contact in scene.contacts)
    where = counted(len(scene.contacts), "contact") if touching else "no contact"
    whole = f"{counted(regions, 'contact')} of every node of a place"
    pressed = f"{counted(len(scene.followers), 'pressure')} with follower = true"
    return (
        Item("elastic polynomial", nonlinear and not projected, elastic),
        Item("intrusive projection", nonlinear and projected, elastic),
        Item("follower pressures", bool(scene.followers), pressed),
        Item("contact forces", touching, where),
        Item("contact weighting", regions > 0, whole),
        Item("second tangent direction", touching and dimension == 3, f"{dimension}D, {where}"),
    )


def elastic_reason(scene: Scene) -> str:
    """Say how the elastic force is reduced."""
    if not scene.geometrically_nonlinear:
        return "the scene is geometrically linear"
    return f"basis.elastic_force is {scene.basis.elastic_force}"


def with_stresses(scene: Scene) -> bool:
    """Whether the scene asks for stresses."""
    return scene.output.stresses != "none"


def stress_reason(scene: Scene) -> str:
    """Say which stresses the scene asks for."""
    return f"output.stresses is {scene.output.stresses}"


def newton_item(scene: Scene) -> Item:
    """Say whether a time step iterates."""
    linear = f"{elastic_reason(scene)}: one solve per step"
    nonlinear = scene.geometrically_nonlinear
    return Item("Newton iterations", nonlinear, "nonlinear elastic force" if nonlinear else linear)

"""The parts of the stages, and the reasons why a scene needs a stage or a part."""

from __future__ import annotations

from fenicsrom.scene import Scene
from fenicsrom.scene.base.rules import BY_MOTION
from fenicsrom.scene.base.toml import toml_value
from fenicsrom.scene.checks.checks import LEAST_MODES
from fenicsrom.scene.keys.excitation import HIGHEST_MODE, highest_frequency
from fenicsrom.study.stage import Item
from fenicsrom.words import counted


def is_loaded(scene: Scene) -> bool:
    """Whether static loads or the centrifugal force deform the body."""
    turning = scene.rotation is not None and scene.rotation.speed_rpm != 0.0
    return turning or any(load.static and load.size != 0.0 for load in scene.loads)


def solid_parts(scene: Scene) -> tuple[Item, ...]:
    """List the matrices and equations that are assembled and solved with the solid."""
    static = sum(load.static and load.size != 0.0 for load in scene.loads)
    rotation = scene.rotation
    turning = rotation is not None and rotation.speed_rpm != 0.0
    coriolis = rotation is not None and turning and rotation.coriolis
    ratios = scene.damping.modal
    forces = counted(static, "static load") if static else "no static load"
    forces += ", centrifugal force" if turning else ""
    speed = f"{rotation.speed_rpm:g} rpm" if rotation else "no rotation"
    frame = f"rotation.coriolis is {toml_value(coriolis)}" if turning else "no rotation"
    given = f"damping.ratios of {counted(len(ratios), 'mode')}" if ratios else "no damping.ratios"
    return (
        Item("static equilibrium", is_loaded(scene), forces),
        Item("rotating frame", turning, speed),
        Item("gyroscopic term", coriolis, frame),
        Item("damped modes", any(ratios), given),
    )


def mode_parts(scene: Scene) -> tuple[Item, ...]:
    """List the kinds of component modes."""
    varies = any(not load.static for load in scene.loads)
    responses = "static responses to loads that the modes do not represent"
    return (
        Item("normal modes", scene.basis.modes != 0, _normal_modes_reason(scene)),
        Item("responses to loads", varies, responses),
        Item("static modes", bool(scene.contacts), _static_modes_reason(scene)),
    )


def _normal_modes_reason(scene: Scene) -> str:
    """Say how many normal modes are computed, and why."""
    modes = f"{'free' if scene.basis.method == 'rubin' else 'fixed'}-interface modes"
    if scene.basis.modes != "auto":
        return f"{scene.basis.modes} {modes}"
    highest = highest_frequency(scene)
    return (
        f"{modes} up to {HIGHEST_MODE * highest:.5g} Hz, {HIGHEST_MODE:g} times the highest "
        f"frequency that the scene excites, and the next one, but at least {LEAST_MODES}"
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
    points = len(scene.contacts) - regions
    parts = [counted(points, "point")] if points else []
    parts += [f"every node of {counted(regions, 'place')}"] if regions else []
    where = " and ".join(parts) or "no contact"
    weighted = where if regions or not touching else "no region of many nodes"
    space = f"{dimension} dimensions" if touching else "no contact"
    followers = len(scene.followers)
    pressed = counted(followers, "pressure") if followers else "no pressure follows the deformation"
    return (
        Item("elastic polynomial", nonlinear and not projected, elastic),
        Item("intrusive projection", nonlinear and projected, elastic),
        Item("follower pressures", followers > 0, pressed),
        Item("contact forces", touching, where),
        Item("contact weighting", regions > 0, weighted),
        Item("second tangent direction", touching and dimension == 3, space),
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

"""Checks between keys of a rotating body: its axis, its speeds and the sectors of a disk."""

import math
from dataclasses import MISSING
from operator import mul, sub

from fenicsrom.errors import ErrorKind, refuse
from fenicsrom.scene.base.rules import Problem, Problems, Where, order_problems
from fenicsrom.scene.base.tables import require_none
from fenicsrom.scene.checks.curve_checks import speed_problems
from fenicsrom.scene.keys import times
from fenicsrom.scene.keys.rotation import Rotation
from fenicsrom.scene.keys.schema import Scene

IN_PLANE = "only allowed in 3D; in 2D the axis is normal to the plane"


def rotation_problems(scene: Scene) -> Problems:
    """Yield the problems of the axis and the speeds."""
    rotation: Rotation | None = scene.rotation
    if rotation is None:
        return
    if scene.geometry.dimension == 2 and rotation.axis is not None:
        yield Problem("rotation.axis", IN_PLANE)
    if scene.geometry.dimension == 3 and rotation.axis is None:
        yield Problem("rotation.axis", "must be a vector along the axis in 3D")
    if scene.reference.beam:
        yield Problem("reference.beam", "must be false with [rotation]: the beam cannot turn")
    if rotation.history:
        yield from _history_problems(scene, rotation)
    if rotation.speeds_rpm is not None:
        yield from _range_problems(scene, rotation.speed_rpm, rotation.speeds_rpm)


def cyclic_problems(scene: Scene) -> Problems:
    """Yield what does not agree with a disk of equal sectors."""
    cyclic, rotation = scene.cyclic, scene.rotation
    if cyclic is None:
        return
    axis = cyclic.axis or (rotation.axis if rotation is not None else None)
    if scene.geometry.dimension == 3 and axis is None:
        yield Problem("cyclic.axis", "must be a vector along the axis in 3D", value=MISSING)
    if cyclic.left == cyclic.right:
        yield Problem("cyclic.right", "must be another group than cyclic.left")
    if scene.geometry.dimension == 2 and cyclic.axis is not None:
        yield Problem("cyclic.axis", IN_PLANE)
    elif rotation is not None and not _are_parallel(axis, rotation.axis):
        yield Problem("cyclic.axis", "must be along rotation.axis")
    elif rotation is not None and cyclic.point is not None:
        if _off_axis(tuple(map(sub, cyclic.point, _origin(rotation, scene))), axis):
            yield Problem("cyclic.point", "must be on the axis of [rotation]")
    for k, h in enumerate(cyclic.diameters or ()):
        if h > cyclic.sectors // 2:
            allowed = f"must be at most {cyclic.sectors // 2}, half the number of sectors"
            yield Problem(f"cyclic.diameters[{k}]", allowed, ErrorKind.RANGE)
    if scene.bolts:
        yield Problem("bolts", "not allowed with [cyclic]")
    chosen = scene.output.sectors
    if not isinstance(chosen, str) and max(chosen, default=0) >= cyclic.sectors:
        allowed = f'must be "all", or numbers below {cyclic.sectors}'
        yield Problem("output.sectors", allowed, ErrorKind.RANGE)
    given = cyclic.mistuning
    if isinstance(given, tuple) and len(given) != cyclic.sectors:
        allowed = f"must hold a number for each of the {cyclic.sectors} sectors, not {len(given)}"
        yield Problem("cyclic.mistuning", allowed, ErrorKind.RANGE)
    for k, contact in enumerate(scene.contacts):
        waves = contact.surface is not None and contact.surface.waves
        parts = {"abradable": contact.abradable, "surface.waves": waves}
        for name in filter(parts.get, parts):
            yield Problem(f"contacts[{k}].{name}", "not allowed with [cyclic]")
        if contact.surface is not None:
            moved = tuple(map(sub, contact.surface.point, cyclic.point or _origin(rotation, scene)))
            turned = contact.surface.kind == "cylinder"
            turned = turned and not _are_parallel(contact.surface.axis, axis)
            if turned or _off_axis(moved, axis):
                allowed = "must be on the axis of the disk, about which all sectors see it alike"
                yield Problem(f"contacts[{k}].surface.point", allowed)
    for k, load in enumerate(scene.loads):
        if load.everywhere and not _are_parallel(load.direction, axis):
            allowed = "must be along cyclic.axis: another direction is another one in each sector"
            yield Problem(f"loads[{k}].direction", allowed)


def require_disk_run(scene: Scene) -> None:
    """Check that a sector of a disk can move in time.

    Raises:
        SceneError: it cannot.
    """
    if scene.static_only:
        reason = "no load varies in time; a run of a disk needs one, or a time.duration"
        raise refuse(scene.source, reason, ErrorKind.MISSING, "loads")
    require_none(_disk_run_problems(scene), scene, Where(scene.source))


def _disk_run_problems(scene: Scene) -> Problems:
    """Yield what a run of a disk cannot do."""
    rotation = scene.rotation
    if not scene.contacts and not scene.probe:
        yield Problem("probe", "must be a table: the motion is seen there", value=MISSING)
    unusual: dict[str, object] = {
        "rotation.history": rotation is not None and rotation.history,
        "rotation.speeds_rpm": rotation is not None and rotation.speeds_rpm,
        "basis.size": scene.basis.size,
        "basis.elastic_force": scene.basis.elastic_force == "projection",
        "reference.full": scene.reference.full,
        "output.animation": scene.output.animation,
        **{f"loads[{k}].follower": True for k in scene.followers},
    }
    for k, load in enumerate(scene.loads):
        unusual[f"loads[{k}].sweep"] = load.order and load.transient
    for key in filter(unusual.get, unusual):
        yield Problem(key, "not allowed in a run of a disk ([cyclic])")


def _origin(rotation: Rotation | None, scene: Scene) -> tuple[float, ...]:
    """A point of the axis of rotation."""
    origin = (0.0,) * scene.geometry.dimension
    return origin if rotation is None else rotation.point or origin


def _off_axis(moved: tuple[float, ...], axis: tuple[float, ...] | None) -> bool:
    """Whether a place relative to the axis is beside it."""
    along = 0.0 if axis is None else sum(map(mul, moved, axis))
    line = tuple(along * part for part in axis or (0.0,) * len(moved))
    return math.dist(moved, line) > 1e-9 * max(1.0, math.hypot(*moved))


def _are_parallel(a: tuple[float, ...] | None, b: tuple[float, ...] | None) -> bool:
    """Whether two unit vectors are parallel. If one of them is None, both must be."""
    if a is None or b is None:
        return a is b
    return abs(sum(map(mul, a, b))) > 1.0 - 1e-9


def _history_problems(scene: Scene, rotation: Rotation) -> Problems:
    """Yield what a run at a varying speed needs."""
    key, instants = "rotation.history", [time for time, _ in rotation.history]
    if instants[0] != 0.0:
        yield Problem(f"{key}[0]", "the first time must be 0", ErrorKind.RANGE, value=instants[0])
    yield from order_problems(key, instants)
    speeds = [speed for _, speed in rotation.history]
    if rotation.speeds_rpm is None:
        allowed = f"must cover the speeds of rotation.history, {min(speeds):g} to {max(speeds):g}"
        yield Problem("rotation.speeds_rpm", allowed)
    else:
        given = {f"{key}[{k}]": speed for k, speed in enumerate(speeds)}
        yield from speed_problems(rotation.speeds_rpm, given)
    if not rotation.coriolis:
        yield Problem("rotation.coriolis", "must be true with rotation.history")
    if not scene.geometrically_nonlinear:
        allowed = "must be true with rotation.history, whose equilibrium changes"
        yield Problem("geometrically_nonlinear", allowed)
    if isinstance(scene.time.stepping, times.StepsPerRevolution) and min(speeds) <= 0.0:
        allowed = "not allowed with a speed of 0 in rotation.history; use step or tolerance"
        yield Problem("time.steps_per_revolution", allowed)


def _range_problems(scene: Scene, speed: float, speeds: tuple[float, ...]) -> Problems:
    """Yield what a model for a range of speeds cannot do."""
    yield from speed_problems(speeds, {"rotation.speed_rpm": speed})
    basis = scene.basis
    unusual = {
        "basis.method": basis.method != "rubin",
        "basis.derivatives": basis.derivatives != "principal",
        "basis.elastic_force": basis.elastic_force != "polynomial",
        "output.stresses": scene.output.stresses != "none",
        "reference.full": scene.reference.full,
    }
    for key in filter(unusual.get, unusual):
        yield Problem(key, "not allowed with rotation.speeds_rpm")
    for k in scene.followers:
        yield Problem(f"loads[{k}].follower", "must be false with rotation.speeds_rpm")

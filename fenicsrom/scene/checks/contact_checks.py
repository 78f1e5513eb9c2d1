"""Checks between keys of the contacts: with rigid surfaces and between bodies."""

import math
from functools import partial
from operator import mul

from fenicsrom.errors import ErrorKind, refuse
from fenicsrom.scene.base.rules import Problem, Problems, Where, order_problems
from fenicsrom.scene.keys import times
from fenicsrom.scene.keys.contacts import Contact, Surface, surface_spin
from fenicsrom.scene.keys.places import Region
from fenicsrom.scene.keys.schema import Scene

WHOLE_TURNS = 1e-9  # part of the turns in a period by which they may miss a whole number


def contact_problems(contact: Contact, key: str, dimension: int) -> Problems:
    """Yield the problems of a contact alone."""
    if contact.against is not None:
        yield from _pair_problems(contact, key)
    elif contact.surface is None and contact.normal is None:
        yield Problem(f"{key}.normal", "a normal, a surface or against must be given")
    else:
        for name in filter(partial(getattr, contact), ("reach", "neighbour")):
            yield Problem(f"{key}.{name}", "only allowed with against")
    if (contact.gap or 0.0) < 0.0 and contact.against is None:
        yield Problem(f"{key}.gap", "must be at least 0 without against", ErrorKind.RANGE)
    if contact.gap and contact.preload:
        allowed = "not allowed with a preload, which is the force at the undeformed position"
        yield Problem(f"{key}.gap", allowed)
    yield from order_problems(f"{key}.approach", [time for time, _ in contact.approach])
    if contact.surface is not None:
        yield from _surface_problems(contact, key, dimension)


def _pair_problems(contact: Contact, key: str) -> Problems:
    """Yield the problems of a contact between two regions of the body."""
    for name in ("normal", "surface", "abradable", "approach"):
        if getattr(contact, name):
            yield Problem(f"{key}.{name}", "not allowed with against")
    for name in ("node", "nearest"):
        if getattr(contact.place, name):
            yield Problem(
                f"{key}.{name}", "not allowed with against: give a group, a box or a plane"
            )
    if contact.place.at == "centre":
        yield Problem(f"{key}.at", 'must be "nodes" with against')
    if contact.against == contact.place.group:
        yield Problem(f"{key}.against", "must be another group than that of the contact")


def joined_problems(scene: Scene) -> Problems:
    """Yield what is not allowed with contacts between bodies."""
    if not scene.joined:
        if scene.basis.masters == "motion":
            yield Problem("basis.masters", "only allowed with a contact against a region")
        if scene.bolts:
            yield Problem("bolts", "only allowed with a contact against a region")
        return
    why = "with a contact against a region of the body"
    for k, contact in enumerate(scene.contacts):
        if contact.against is not None and _regions(contact) in map(_regions, scene.contacts[:k]):
            yield Problem(f"contacts[{k}].against", "has a contact with the same region already")
        if contact.neighbour and scene.cyclic is None:
            yield Problem(f"contacts[{k}].neighbour", "only allowed with [cyclic]")
    for k in scene.followers if scene.cyclic is not None else ():
        yield Problem(f"loads[{k}].follower", f"must be false in a disk {why}")
    basis = scene.basis
    allowed = {
        "basis.method": ("rubin",),
        "basis.masters": ("motion", "all"),
        "basis.elastic_force": ("polynomial",),
    }
    for key, values in allowed.items():
        table, name = key.split(".")
        value = getattr(getattr(scene, table), name)
        if value is not None and value not in values:
            quoted = " or ".join(f'"{value}"' for value in values)
            yield Problem(key, f"must be {quoted} {why}")
    if basis.derivatives in ("mmi", "mmi-nls"):
        yield Problem("basis.derivatives", f'must be "principal", "all" or "none" {why}')
    if isinstance(scene.time.stepping, times.Tolerance):
        yield Problem("time.tolerance", f"not allowed {why}: give a fixed step")
    if scene.geometry.degree > 2:
        yield Problem("geometry.degree", f"must be 1 or 2 {why}")


def _regions(contact: Contact) -> set[Region]:
    """The two regions of a contact between bodies."""
    place = contact.place
    return {Region(group=place.group, box=place.box, plane=place.plane), contact.other}


def tie_problems(scene: Scene) -> Problems:
    """Yield what is not allowed with ties."""
    for k, tie in enumerate(scene.ties):
        if tie.against == tie.group:
            yield Problem(f"ties[{k}].against", "must be another group than that of the tie")
        pair = {tie.group, tie.against}
        if any(pair == {one.place.group, one.against} for one in scene.contacts):
            yield Problem(f"ties[{k}].against", "these regions have a contact already")


def abradable_problems(scene: Scene, contact: Contact, key: str) -> Problems:
    """Yield what does not agree with an abradable layer."""
    if contact.abradable is None:
        return
    if contact.preload:
        allowed = f"not allowed with {key}.abradable: use an approach to press the layer"
        yield Problem(f"{key}.preload", allowed)
    if scene.time.scheme != "discrete-gradient":
        yield Problem("time.scheme", f'must be "discrete-gradient" with {key}.abradable')
    for name in ("response", "backbone"):
        if getattr(scene, name) is not None:
            allowed = f"not allowed with {key}.abradable: a surface that wears does not repeat"
            yield Problem(name, allowed)
    if (out_of_place := _out_of_place(scene, contact.surface, 1, f"{key}.abradable")) is not None:
        yield Problem(f"{key}.abradable", out_of_place, ErrorKind.RANGE)


def _surface_problems(contact: Contact, key: str, dimension: int) -> Problems:
    surface = contact.surface
    assert surface is not None
    if contact.normal is not None:
        yield Problem(f"{key}.normal", "not allowed with a surface")
    wanted = dimension == 3 and surface.kind == "cylinder"
    if wanted and surface.axis is None:
        yield Problem(f"{key}.surface.axis", "must be a vector for a cylinder in 3D")
    if not wanted and surface.axis is not None:
        yield Problem(f"{key}.surface.axis", "only allowed for a cylinder in 3D")
    if dimension == 2 and surface.kind == "sphere":
        yield Problem(f"{key}.surface.kind", 'must be "cylinder" in 2D')
    if surface.radius is not None and contact.gap:
        yield Problem(f"{key}.gap", "not allowed with surface.radius, which determines the gap")
    for name in ("waves", "spin", "angle_from"):
        if surface.kind == "sphere" and getattr(surface, name) not in (None, ()):
            yield Problem(f"{key}.surface.{name}", "only allowed for a cylinder")
    if surface.axis is not None and surface.angle_from is not None:
        if abs(sum(map(mul, surface.axis, surface.angle_from))) > 1.0 - 1e-9:
            allowed = "must not be along the axis"
            yield Problem(f"{key}.surface.angle_from", allowed, ErrorKind.RANGE)
    for index, (order, _, _) in enumerate(surface.waves):
        if order != round(order) or order < 1:
            allowed = "the order must be an integer of at least 1"
            yield Problem(f"{key}.surface.waves[{index}]", allowed, ErrorKind.RANGE, value=order)


def require_no_pairs(scene: Scene) -> None:
    """Check that a scene has no contacts between bodies, for an export to another program.

    Raises:
        SceneError: it has some.
    """
    for k, contact in enumerate(scene.contacts):
        if contact.against is not None:
            reason = "not allowed in fenicsrom export, because other programs have no contact that "
            reason += "is averaged between two meshes"
            raise refuse(scene.source, reason, ErrorKind.CONFLICT, f"contacts[{k}].against")


def require_repeating(scene: Scene) -> None:
    """Check that all that excites the body repeats in the period of the loads, waves too.

    Raises:
        SceneError: the waves of a turning surface do not; the error names their key.
    """
    for k, contact in enumerate(scene.contacts):
        surface = contact.surface
        if surface is not None and scene.period is not None:
            orders = [round(order) for order, height, _ in surface.waves if height != 0.0]
            key = f"contacts[{k}].surface.waves"
            if (allowed := _out_of_place(scene, surface, math.gcd(*orders), key)) is not None:
                raise Where(scene.source, key).refuse(surface.waves, allowed, ErrorKind.RANGE)


def _out_of_place(scene: Scene, surface: Surface | None, order: int, key: str) -> str | None:
    """What is allowed in place of a turn that does not repeat in the period; None if it does."""
    period = scene.period or 0.0
    spin = 0.0 if surface is None else surface_spin(surface, scene.rotation)
    turned = abs(spin) * period / (2.0 * math.pi)
    if abs(order * turned - round(order * turned)) <= WHOLE_TURNS * order * turned:
        return None
    return (
        f"with {key} the surface must come back to its place in the period of the loads, "
        f"{period:.6g} s, in which it makes {turned:.6g} turns; lengthen the period, for example "
        "by engine_order = 1 with harmonics = [[3, 1.0, 0.0]] in place of engine_order = 3"
    )

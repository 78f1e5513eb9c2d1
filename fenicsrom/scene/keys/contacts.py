"""The tables [[contacts]], [[bolts]] and [[ties]]: what touches, presses and glues the body."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from fenicsrom.scene.base import rules
from fenicsrom.scene.base.rules import choice, either, flag, integer, number, rows_of
from fenicsrom.scene.base.tables import table_of
from fenicsrom.scene.keys import places
from fenicsrom.scene.keys.rotation import Rotation

_ORDER = {"type": "integer", "minimum": 1}
_WAVES = rows_of("order", "height", "phase", unit="–, m, rad", first=_ORDER)


@dataclass(frozen=True, kw_only=True)
class Surface:
    """A round rigid surface.

    Attributes:
        kind: shape; in 2D a cylinder is a circle.
        point: a point of the axis, or the centre.
        axis: axis of a cylinder in 3D, of any length.
        inside: whether the body is inside, as a blade in its casing.
        radius: radius. Default: from the gap.
        spin: rate at which a cylinder turns, seen from the body. Default: the casing is at rest.
        waves: waves of a cylinder: each moves the surface towards the body by height · cos(order
            (angle − spin t) − phase). The angle is positive about the axis.
        angle_from: direction from the axis where the angle starts. Default: the middle of the
            contact points.
    """

    kind: Annotated[str, choice("cylinder", "sphere")]
    point: Annotated[tuple[float, ...], rules.point]
    axis: Annotated[tuple[float, ...] | None, rules.direction] = None
    inside: Annotated[bool, flag] = True
    radius: Annotated[float | None, number(above=0.0, unit="m")] = None
    spin: Annotated[float | None, number(unit="rad/s")] = None
    waves: Annotated[tuple[tuple[float, ...], ...], _WAVES] = ()
    angle_from: Annotated[tuple[float, ...] | None, rules.direction] = None


@dataclass(frozen=True, kw_only=True)
class Abradable:
    """A layer on the surface that the body wears, such as the coating of a casing.

    Attributes:
        thickness: thickness of the layer.
        modulus: Young's modulus of the layer.
        yield_stress: stress that crushes the new layer.
        hardening: growth of this stress with plastic strain.
        viscosity: growth of this stress with the rate of plastic strain.
        area: area that presses the layer, of all nodes together. The nodes share it by their area
            or length.
        width: width of the trace along the axis. Default: the distance between the outermost
            points, in 2D the thickness.
        cells: angles of a turning surface at which the worn depth is known.
    """

    thickness: Annotated[float, number(above=0.0, unit="m")]
    modulus: Annotated[float, number(above=0.0, unit="Pa")]
    yield_stress: Annotated[float, number(above=0.0, unit="Pa")]
    hardening: Annotated[float, number(least=0.0, unit="Pa")] = 0.0
    viscosity: Annotated[float, number(least=0.0, unit="N s/m²")] = 0.0
    area: Annotated[float, number(above=0.0, unit="m²")]
    width: Annotated[float | None, number(above=0.0, unit="m")] = None
    cells: Annotated[int, integer(3, 1_000_000)] = 720


@dataclass(frozen=True, kw_only=True)
class Contact:
    """A point, or every node of a region, against a rigid surface or another region of the body.

    With `against`, every node of the facets of a region is a contact point (at = "nodes" says
    nothing more), and the other region moves. The region with the smaller facets comes first.

    With at = "nodes" the preload and both stiffnesses are those of a unit of the region: of an area
    of facets, of a length of edges (a curve in 3D), or of one node of a node set.

    Attributes:
        place: where the contact is.
        normal: unit vector into a rigid plane; not with a surface.
        surface: a round rigid surface instead of the plane.
        against: the other region, a group of facets, or { box = .. } or { plane = .. }; not with
            normal or surface. A box or a plane leaves out the bodies of the other side's group;
            of two with the same two bodies, the first takes the body with smaller facets.
        neighbour: whether `against` is a region of the next sector; only with [cyclic].
        reach: facets at larger distances are not opposite one another; only with `against`.
        abradable: a layer on the surface that the body wears; not with a preload.
        preload: normal force at the undeformed position. With at = "nodes": N/m² on facets, N/m on
            curves in 3D, N for each node of a node set. With `against` the bodies give way under
            it, which leaves a part.
        gap: initial distance, of the nearest node; not with a preload. Default: 0, and with
            `against` and without a preload the distance in the mesh. With `against`, a negative gap
            is the interference of a press fit.
        approach: how far the surface has moved towards the body, linear between the times. Default:
            at rest.
        normal_stiffness: stiffness along the normal. With at = "nodes": N/m³ on facets, N/m² on
            curves, N/m for each node; `fenicsrom plan` says which.
        tangential_stiffness: stiffness along the surface, in the same unit.
        friction: coefficient of friction.
    """

    place: Annotated[places.Place, places.Place]
    normal: Annotated[tuple[float, ...] | None, rules.direction] = None
    surface: Annotated[Surface | None, table_of(Surface)] = None
    against: Annotated[str | places.Region | None, either(rules.name, table_of(places.Region))] = (
        None
    )
    neighbour: Annotated[bool, flag] = False
    reach: Annotated[float | None, number(above=0.0, unit="m")] = None
    abradable: Annotated[Abradable | None, table_of(Abradable)] = None
    preload: Annotated[float, number(least=0.0, unit="N")] = 0.0
    gap: Annotated[float | None, number(unit="m")] = None
    approach: Annotated[
        tuple[tuple[float, ...], ...], rows_of("time", "distance", unit="s, m")
    ] = ()
    normal_stiffness: Annotated[float, number(above=0.0, unit="N/m")]
    tangential_stiffness: Annotated[float, number(above=0.0, unit="N/m")]
    friction: Annotated[float, number(least=0.0)]

    @property
    def has_region(self) -> bool:
        """Whether every node of a region is a contact point."""
        return self.place.at == "nodes" or self.against is not None

    @property
    def other(self) -> places.Region:
        """The region `against` which the contact is."""
        given = self.against
        return given if isinstance(given, places.Region) else places.Region(group=given)

    @property
    def has_mesh_gaps(self) -> bool:
        """Whether its gaps are those of the mesh."""
        return self.against is not None and self.gap is None and not self.preload


@dataclass(frozen=True, kw_only=True)
class Bolt:
    """A bolt that pulls two regions together along the line between their centres.

    The force stays constant. In a geometrically nonlinear scene its direction follows the regions.

    Attributes:
        head: group of the facets under the head.
        nut: group of the facets under the nut.
        force: tension.
    """

    head: Annotated[str, rules.name]
    nut: Annotated[str, rules.name]
    force: Annotated[float, number(above=0.0, unit="N")]


@dataclass(frozen=True, kw_only=True)
class Tie:
    """Two regions without common nodes that move as one, as part of the structure.

    The region with the smaller facets comes first.

    Attributes:
        group: group of the facets of one region.
        against: group of the facets of the other one.
        reach: facets at larger distances are not tied. Default: a tenth of a facet.
    """

    group: Annotated[str, rules.name]
    against: Annotated[str, rules.name]
    reach: Annotated[float | None, number(above=0.0, unit="m")] = None


def surface_turns(surface: Surface, rotation: Rotation | None) -> float:
    """The angle by which a surface turns for each radian of the body, as the body sees it."""
    if surface.spin is not None or rotation is None or surface.kind == "sphere":
        return 0.0
    about = 1.0
    if surface.axis is not None and rotation.axis is not None:
        about = sum(a * b for a, b in zip(surface.axis, rotation.axis, strict=True))
    return -about if abs(about) > 1.0 - 1e-9 else 0.0


def surface_spin(surface: Surface, rotation: Rotation | None) -> float:
    """Rate (rad/s) at which a surface turns about its axis, as the body sees it."""
    omega = 0.0 if rotation is None else rotation.omega
    return (surface.spin or 0.0) + surface_turns(surface, rotation) * omega

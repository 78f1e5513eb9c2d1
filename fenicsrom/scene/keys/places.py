"""Places: parts and points of the solid, by name or by coordinates."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from fenicsrom.scene.base import rules
from fenicsrom.scene.base.rules import choice, list_of, number
from fenicsrom.scene.base.tables import table_of

AXES = ("x", "y", "z")


@dataclass(frozen=True, kw_only=True)
class Plane:
    """A plane that picks facets.

    Attributes:
        point: a point of the plane.
        normal: normal of the plane, scaled to unit length.
        tolerance: points at this distance still count as points of the plane; by default 1e-6 of
            the extent of the mesh.
    """

    point: Annotated[tuple[float, ...], rules.point]
    normal: Annotated[tuple[float, ...], rules.direction]
    tolerance: Annotated[float | None, number(above=0.0, unit="m")] = None


@dataclass(frozen=True, kw_only=True)
class Region:
    """A part of the solid, given by a name or by coordinates; all fields except one are None.

    Attributes:
        group: name of a group of facets or nodes of the mesh.
        box: opposite corners of a box; picks the boundary facets with every vertex in it.
        plane: a plane; picks the boundary facets with every vertex on it.
    """

    group: Annotated[str | None, rules.name] = None
    box: Annotated[tuple[tuple[float, ...], tuple[float, ...]] | None, rules.box] = None
    plane: Annotated[Plane | None, table_of(Plane)] = None


@dataclass(frozen=True, kw_only=True)
class Place(Region):
    """A point of the solid: on a region, or a node; exactly one of these keys is given.

    Attributes:
        node: coordinates of a node, which must exist there.
        nearest: coordinates of a point; picks the nearest node at any distance.
        at: which point of a region is meant: its mean displacement ("mean"), the node nearest to
            its centroid ("centre"), or, for a contact only, every node ("nodes").
    """

    node: Annotated[tuple[float, ...] | None, rules.point] = None
    nearest: Annotated[tuple[float, ...] | None, rules.point] = None
    at: Annotated[str, choice("mean", "centre", "nodes")] = "mean"


@dataclass(frozen=True, kw_only=True)
class Support(Region):
    """A region or a node on which the displacement, or a part of it, is clamped.

    Attributes:
        node: coordinates of a node, which must exist there.
        components: components that are clamped: ["y"] for a roller on a plane y = constant or for
            a plane of symmetry; by default all.
        normal: direction of the only displacement that is clamped, as on a slanted roller or a
            slanted plane of symmetry; not with components.
    """

    node: Annotated[tuple[float, ...] | None, rules.point] = None
    components: Annotated[tuple[str, ...] | None, list_of(choice(*AXES))] = None
    normal: Annotated[tuple[float, ...] | None, rules.direction] = None

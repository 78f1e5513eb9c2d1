"""Places: parts and points of the solid, by name or by coordinates."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from fenicsrom.scene import rules
from fenicsrom.scene.rules import choice, number
from fenicsrom.scene.tables import table_of


@dataclass(frozen=True, kw_only=True)
class Plane:
    """A plane that picks facets.

    Attributes:
        point: a point of the plane.
        normal: normal of the plane, scaled to unit length.
        tolerance: distance that still counts as on the plane; by default 1e-6 of the extent of the
            mesh.
    """

    point: Annotated[tuple[float, ...], rules.point]
    normal: Annotated[tuple[float, ...], rules.direction]
    tolerance: Annotated[float | None, number(above=0.0, unit="m")] = None


@dataclass(frozen=True, kw_only=True)
class Region:
    """A part of the solid, by its name or by coordinates; all fields except one are None.

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
        at: point of a region: the area-weighted mean over it, the node nearest to its centroid, or
            (of a contact only) every node with its share of the area or length, or one for each
            node of a group that has only nodes.
    """

    node: Annotated[tuple[float, ...] | None, rules.point] = None
    nearest: Annotated[tuple[float, ...] | None, rules.point] = None
    at: Annotated[str, choice("mean", "centre", "nodes")] = "mean"


@dataclass(frozen=True, kw_only=True)
class Support(Region):
    """A region on which every displacement is clamped."""

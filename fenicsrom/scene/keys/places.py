"""Parts and points of the solid, by name or by coordinates, and what holds the solid there."""

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

    @property
    def is_mean(self) -> bool:
        """Whether the place is the mean of a region, and not one of its nodes or all of them."""
        return self.node is None and self.nearest is None and self.at == "mean"


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


@dataclass(frozen=True, kw_only=True)
class Attachment:
    """One or more of a mass, a spring and a dashpot to the ground, at a node or over a region.

    Over a region, each node gets a part in proportion to its share of the area. A spring acts with
    the force −k u, and a dashpot with the force −c u̇.

    Attributes:
        place: the node or the region.
        components: directions in which spring and dashpot act, such as ["z"]; by default all.
        mass: mass.
        stiffness: stiffness k of the spring, in each of these directions.
        stiffness_per_area: stiffness of the spring: in N/m³ on facets (in 2D edges times the
            thickness), in N/m² on curves in 3D, in N/m for each node of a node set.
        damping: damping coefficient c of the dashpot, in each of these directions; modes and
            Campbell diagrams leave it out.
        damping_per_area: damping coefficient: in N s/m³ on facets, in N s/m² on curves in 3D, in
            N s/m for each node of a node set.
    """

    place: Annotated[Place, Place]
    components: Annotated[tuple[str, ...] | None, list_of(choice(*AXES))] = None
    mass: Annotated[float, number(least=0.0, unit="kg")] = 0.0
    stiffness: Annotated[float, number(least=0.0, unit="N/m")] = 0.0
    stiffness_per_area: Annotated[float, number(least=0.0, unit="N/m³")] = 0.0
    damping: Annotated[float, number(least=0.0, unit="N s/m")] = 0.0
    damping_per_area: Annotated[float, number(least=0.0, unit="N s/m³")] = 0.0

    @property
    def viscous(self) -> bool:
        """Whether there is a dashpot."""
        return self.damping > 0.0 or self.damping_per_area > 0.0

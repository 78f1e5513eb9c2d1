"""Concentrated masses, springs and dashpots to the ground at places of the body."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from fenicsrom.scene.base.rules import choice, list_of, number
from fenicsrom.scene.keys.places import AXES, Place


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
        stiffness_per_area: stiffness of the spring per area of a region of facets, per length of
            edges (N/m²), or per node of a group of nodes (N/m).
        damping: damping coefficient c of the dashpot, in each of these directions; modes and
            Campbell diagrams leave it out.
        damping_per_area: damping coefficient per area, length or node, as `stiffness_per_area`.
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

"""How the body of a CAD file is meshed."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Annotated

from fenicsrom.scene.base import rules
from fenicsrom.scene.base.rules import number
from fenicsrom.scene.base.tables import tables_of


@dataclass(frozen=True, kw_only=True)
class Refinement:
    """A face near which the cells are smaller.

    Attributes:
        group: name of the face.
        size: size of the cells on the face; by default half of that of the body.
        origin: key of the support or contact from which a default follows, for messages.
    """

    group: Annotated[str, rules.name]
    size: Annotated[float | None, number(above=0.0, unit="m")] = None
    origin: str = field(default="", compare=False)


@dataclass(frozen=True, kw_only=True)
class Meshing:
    """The sizes of the cells of a .step file, besides `geometry.size`.

    Attributes:
        curvature: number of cells along a full circle, on curved faces and edges such as fillets
            and holes; 0 for none.
        smallest: smallest size that the curvature asks for; by default a twentieth of
            `geometry.size`.
        growth: ratio of the sizes of neighbouring cells, away from the refined faces.
        near: faces with smaller cells, unless the body is structured; by default the named faces of
            supports and contacts.
    """

    curvature: Annotated[float, number(least=0.0, most=1000.0)] = 8.0
    smallest: Annotated[float | None, number(above=0.0, unit="m")] = None
    growth: Annotated[float, number(above=1.0, most=10.0)] = 1.5
    near: Annotated[tuple[Refinement, ...] | None, tables_of(Refinement)] = None

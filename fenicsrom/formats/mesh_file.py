"""The content of a mesh file, the same for every format."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from fenicsrom.formats.physics import Physics
from fenicsrom.formats.shapes import SHAPES, Shape

Ints = npt.NDArray[Any]
Marks = npt.NDArray[np.bool_]
Floats = npt.NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Block:
    """Cells of one kind.

    Attributes:
        kind: gmsh's number of the element type.
        nodes: node indices in gmsh's order, shape (cells, nodes).
        groups: the cells (cells,) of each group by its name; a name may also stand for cells of
            another dimension and for nodes, which are other groups.
        name: name of the element type in the file.
        labels: numbers of the cells in the file, shape (cells,), or None.
    """

    kind: int
    nodes: Ints
    groups: dict[str, Marks] = field(default_factory=dict)
    name: str = ""
    labels: Ints | None = None

    @property
    def shape(self) -> Shape:
        """The shape of the cells."""
        return SHAPES[self.kind]


@dataclass(frozen=True, eq=False)
class MeshFile:
    """The content of a mesh file.

    Attributes:
        points: coordinates of the nodes, shape (n, 3).
        blocks: the cells of every dimension.
        node_groups: node indices of each group of nodes by its name.
        not_read: the parts of the file that are not read, each in a few words.
        notes: sentences about the file for the user.
        physics: materials, supports, masses and loads of the file.
    """

    points: Floats
    blocks: tuple[Block, ...]
    node_groups: dict[str, Ints] = field(default_factory=dict)
    not_read: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    physics: Physics = field(default_factory=Physics)


def unsupported(elements: str) -> str:
    """Say that elements, such as "cells of type wedge", would leave a hole in the body."""
    return f"{elements} are not supported; use triangles, quadrilaterals, tetrahedra or hexahedra"

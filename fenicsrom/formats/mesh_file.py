"""The content of a mesh file, the same for every format: the mesh, and the physics beside it.

`Physics` names groups and gives coordinates, as a scene does.
"""

from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

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


AXES = "xyz"
"""Names of the components 0, 1 and 2."""


def axes_of(components: set[int]) -> str:
    """The names of the displacements among some components, such as "xz" for 0, 2 and 4."""
    return "".join(AXES[k] for k in sorted(components & {0, 1, 2}))


@dataclass(frozen=True)
class DeckMaterial:
    """A material.

    Attributes:
        name: its name in the file.
        young: Young's modulus; None if the material is not isotropic and elastic.
        poisson: Poisson's ratio, or None.
        density: density; None if the file has none.
        group: the group of its cells; None if all cells have it.
    """

    name: str
    young: float | None
    poisson: float | None
    density: float | None
    group: str | None = None


@dataclass(frozen=True)
class DeckLoad:
    """A static load: a force, a pressure on a group, or an acceleration of the body.

    Attributes:
        kind: "force", "pressure" or "acceleration".
        vector: the force or acceleration (3,); the pressure in its first entry.
        point: coordinates of the node of a force.
        group: the group of facets under a pressure, or over which a force is spread.
    """

    kind: str
    vector: tuple[float, ...]
    point: tuple[float, ...] | None = None
    group: str | None = None


NEVER_SLIPS = 1e3
"""The coefficient of friction that stands for rough surfaces."""


@dataclass(frozen=True)
class DeckJoint:
    """A contact or a tie between two surfaces.

    Attributes:
        name: what the file calls it.
        group: the group of the first surface, of facets or nodes.
        against: that of the other one.
        tied: whether it is a tie.
        reach: largest distance of what is joined; None for the default.
        shut: whether the file closes the gaps.
        friction: coefficient of friction.
        normal: normal stiffness per area; None for a rigid contact.
        tangential: tangential stiffness per area; None for a rigid contact.
    """

    name: str
    group: str
    against: str
    tied: bool
    reach: float | None = None
    shut: bool = False
    friction: float = 0.0
    normal: float | None = None
    tangential: float | None = None


DeckSupport = tuple[str | tuple[float, ...], tuple[int, ...]]
"""A group of nodes or facets, or the coordinates of a node, and the components that are held."""


@dataclass(frozen=True)
class Physics:
    """What a file holds besides the mesh.

    Attributes:
        materials: the materials of the cells.
        supports: what is held.
        masses: coordinates of a node and its mass.
        springs: coordinates of a node, component, and stiffness of its spring to the ground.
        loads: static loads.
        not_taken: what a scene cannot state, each in a few words.
        thickness: thickness of a plane body; None if the file has none.
        strain: whether the strains of a plane body are plane, and not its stresses.
        lost_support: whether a support is not taken.
        joints: contacts and ties between surfaces.
    """

    materials: tuple[DeckMaterial, ...] = ()
    supports: tuple[DeckSupport, ...] = ()
    masses: tuple[tuple[tuple[float, ...], float], ...] = ()
    springs: tuple[tuple[tuple[float, ...], int, float], ...] = ()
    loads: tuple[DeckLoad, ...] = ()
    not_taken: tuple[str, ...] = ()
    thickness: float | None = None
    strain: bool = False
    lost_support: bool = False
    joints: tuple[DeckJoint, ...] = ()


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

"""Queries and edits of the model in an open gmsh, as numpy arrays.

Node numbers are those of gmsh. A "kind" is gmsh's number of an element type.
"""

from typing import Any

import numpy as np
import numpy.typing as npt

from fenicsrom.errors import ErrorKind, refuse
from fenicsrom.formats.shapes import SHAPES, STRAIGHT, distinct

Ints = npt.NDArray[Any]
Floats = npt.NDArray[np.float64]

QUADRATIC = {1: 8, 2: 9, 3: 10, 4: 11, 5: 12}
"""Kind of degree 2, with all nodes, of each straight kind."""


def group_entities(gmsh: Any, source: str, d: int) -> dict[str, list[int]]:
    """Entities of each physical group of dimension d, by its name or, without a name, its number.

    Raises:
        SceneError: a group has no elements.
    """
    groups = {}
    for _, tag in gmsh.model.getPhysicalGroups(d):
        name = gmsh.model.getPhysicalName(d, tag) or str(tag)
        groups[name] = [*groups.get(name, []), *gmsh.model.getEntitiesForPhysicalGroup(d, tag)]
    for name, entities in groups.items():
        blocks = [block for on in entities for block in gmsh.model.mesh.getElements(d, on)[1]]
        if not any(len(block) for block in blocks):
            reason = f"group {name!r} is empty; it must have cells or facets of the mesh"
            raise refuse(source, reason, ErrorKind.MESH)
    return groups


def model_nodes(gmsh: Any) -> tuple[Ints, Floats]:
    """Sorted numbers (n,) of the nodes, and their coordinates (n, 3)."""
    numbers, coordinates, _ = gmsh.model.mesh.getNodes()
    order = np.argsort(numbers)
    return numbers[order], coordinates.reshape(-1, 3)[order]


def fits(gmsh: Any, given: int, kind: int) -> bool:
    """Whether elements `given` can be used as `kind`.

    Elements can be used if they are of this kind, or if this kind is straight and has the same
    vertices.
    """
    wanted, found = (gmsh.model.mesh.getElementProperties(k) for k in (kind, given))
    return given == kind or (wanted[2] == 1 and found[5] == wanted[5])


def elements_of(gmsh: Any, d: int, entities: list[int], kind: int) -> Ints:
    """Node numbers (m, nodes of the kind) of the elements that can be used as a kind."""
    width = gmsh.model.mesh.getElementProperties(kind)[3]
    blocks = [np.empty((0, width), dtype=np.uint64)]
    for entity in entities:
        for given, elements, nodes in zip(*gmsh.model.mesh.getElements(d, entity), strict=True):
            if fits(gmsh, given, kind):
                blocks.append(nodes.reshape(len(elements), -1)[:, :width])
    return np.concatenate(blocks)


def cell_sides(gmsh: Any, entity: int, kind: int, d: int) -> Ints:
    """Node numbers (k, nodes) of the edges (d = 1) or faces (d = 2) of the cells of an entity.

    Vertices come first.
    """
    number = len(gmsh.model.mesh.getElementsByType(kind, entity)[0])
    shape = SHAPES[straight_kind(gmsh, kind)]
    if d == 1:
        sides, nodes = shape.edges, gmsh.model.mesh.getElementEdgeNodes(kind, entity, False)
    else:
        sides, vertices = shape.facets, len(shape.facets[0])
        nodes = gmsh.model.mesh.getElementFaceNodes(kind, vertices, entity, False)
    rows = number * len(sides)
    return np.reshape(nodes, (rows, -1)) if number else np.empty((0, 0), dtype=np.uint64)


def boundary_facets(gmsh: Any, d: int, solid: list[int], kind: int) -> Ints:
    """Node numbers (k, nodes) of the facets that belong to one cell only."""
    sides = [rows for entity in solid if len(rows := cell_sides(gmsh, entity, kind, d - 1))]
    rows = np.concatenate(sides)
    vertices = len(SHAPES[straight_kind(gmsh, kind)].facets[0])
    first, _, count = distinct(rows[:, :vertices])
    return rows[first[count == 1]]


def straight_kind(gmsh: Any, kind: int) -> int:
    """The straight kind of the same shape, or 0."""
    _, d, _, _, _, vertices = gmsh.model.mesh.getElementProperties(kind)
    return STRAIGHT.get((d, vertices), 0)


def straight_places(gmsh: Any, kind: int, cells: Floats) -> Floats:
    """The places (c, nodes, d) of the nodes of cells of a kind, if the cells were straight."""
    _, d, _, _, reference, vertices = gmsh.model.mesh.getElementProperties(kind)
    local = np.pad(np.reshape(reference, (-1, d)), ((0, 0), (0, 3 - d)))
    straight = STRAIGHT[d, vertices]
    _, weights, _ = gmsh.model.mesh.getBasisFunctions(straight, local.ravel(), "Lagrange")
    return np.einsum("pn,cnj->cpj", np.reshape(weights, (-1, vertices)), cells[:, :vertices])


def add_elements(gmsh: Any, d: int, kind: int, elements: Ints, tags: Ints) -> None:
    """Add elements of a kind to the model, in one physical group for each tag."""
    for tag in np.unique(tags):
        entity = gmsh.model.addDiscreteEntity(d)
        gmsh.model.mesh.addElementsByType(entity, kind, [], elements[tags == tag].ravel())
        gmsh.model.addPhysicalGroup(d, [entity], int(tag))

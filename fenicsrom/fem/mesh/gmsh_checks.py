"""Checks of the cells and facets in an open gmsh, before they become a dolfinx mesh."""

from typing import Any

import numpy as np

from fenicsrom.errors import ErrorKind, refuse
from fenicsrom.fem.mesh.gmsh_queries import (
    QUADRATIC,
    Floats,
    elements_of,
    fits,
    model_nodes,
    straight_places,
)
from fenicsrom.formats.mesh_file import unsupported
from fenicsrom.formats.shapes import STRAIGHT as STRAIGHT_KINDS
from fenicsrom.scene import Geometry
from fenicsrom.scene.base.rules import Where
from fenicsrom.words import are, counted

DEGENERATE = 1e-12
"""Smaller Jacobian determinants, relative to the cell size to the power d, count as zero."""

STRAIGHT = 1e-6
"""Accepted distance of a node from its place in the straight cell, relative to the cell."""

PLANAR = 1e-9
"""Smaller variations of z in a 2D mesh, relative to the extent, count as zero."""


def check_cells(
    gmsh: Any, geometry: Geometry, solid: list[int]
) -> tuple[int, int, tuple[str, ...]]:
    """Check kind, shape and orientation of the cells.

    Args:
        gmsh: the open gmsh.
        geometry: the [geometry] of the scene.
        solid: the entities of the cells.

    Returns:
        The kind of the cells, the kind of the straight cell, and warnings.

    Raises:
        SceneError: the cells cannot be used.
    """
    source, d = str(geometry.mesh), geometry.dimension
    given, kind = _cell_kinds(gmsh, geometry, solid)
    numbers, points = model_nodes(gmsh)
    cells = [
        points[np.searchsorted(numbers, elements_of(gmsh, d, [entity], given))] for entity in solid
    ]
    cells = [x for x in cells if len(x)]
    spread = np.ptp([[x.min(axis=(0, 1)), x.max(axis=(0, 1))] for x in cells], axis=(0, 1))
    if d == 2 and spread[2] > PLANAR * spread.max():
        reason = f"z differs by {spread[2]:g} m, but it must be constant in 2D"
        raise refuse(source, reason, ErrorKind.MESH, "geometry.dimension")
    moved = _check_shapes(gmsh, geometry, given, kind, [x[:, :, :d] for x in cells])
    warnings = [
        f"{source}: {line[9:]}" for line in gmsh.logger.get() if line.startswith("Warning: ")
    ]
    if not geometry.curved and moved > STRAIGHT:
        warnings.append(
            f"{source}: curved cells are made straight, which moves a node by up to "
            f"{100 * moved:.2g} % of the size of its cell; "
            "set geometry.curved = true to keep the curves"
        )
    return given, kind, tuple(warnings)


def _cell_kinds(gmsh: Any, geometry: Geometry, solid: list[int]) -> tuple[int, int]:
    """Find the one kind of the cells and the kind of the straight cell.

    Raises:
        SceneError: the kinds are mixed, unsupported, or not the ones that the scene asks for.
    """
    source, d = str(geometry.mesh), geometry.dimension

    types = sorted(
        {int(kind) for entity in solid for kind in gmsh.model.mesh.getElementTypes(d, entity)}
    )
    properties = [gmsh.model.mesh.getElementProperties(kind) for kind in types]
    names = ", ".join(entry[0] for entry in properties)
    if not types:
        raise refuse(source, f"there are no cells of dimension {d}", ErrorKind.MESH)
    if len(types) != 1:
        reason = f"the cells must be of one type, but they are {names}"
        raise refuse(source, reason, ErrorKind.MESH)
    given, vertices = types[0], properties[0][5]
    kind = STRAIGHT_KINDS.get((d, vertices))
    if kind is None:
        raise refuse(source, unsupported(f"cells of type {names}"), ErrorKind.MESH)
    if geometry.cells is not None and (geometry.cells == "simplex") != (vertices == d + 1):
        where = Where(source, "geometry.cells")
        raise where.refuse(geometry.cells, f"the cells are {names}", ErrorKind.CONFLICT)
    if geometry.curved and given != QUADRATIC[kind]:
        curved = gmsh.model.mesh.getElementProperties(QUADRATIC[kind])[0]
        where = Where(source, "geometry.curved")
        raise where.refuse(True, f"needs {curved}, but the cells are {names}", ErrorKind.CONFLICT)
    return given, kind


def _check_shapes(
    gmsh: Any, geometry: Geometry, given: int, kind: int, cells: list[Floats]
) -> float:
    """Check that no cell is inverted or degenerate.

    Args:
        gmsh: the open gmsh.
        geometry: the [geometry] of the scene.
        given: kind of the cells.
        kind: kind of the straight cell.
        cells: coordinates (c, nodes, d) of the nodes of the cells of each entity, m.

    Returns:
        The largest distance of a node from its place in the straight cell, relative to the cell.

    Raises:
        SceneError: a Jacobian determinant is zero, or its sign differs from the others.
    """
    source, d = str(geometry.mesh), geometry.dimension
    reference = np.reshape(gmsh.model.mesh.getElementProperties(given)[4], (-1, d))
    local = np.pad(reference, ((0, 0), (0, 3 - d)))
    moved = 0.0
    for x in cells:
        size = np.ptp(x, axis=1).max(axis=1)
        det = determinants(gmsh, given if geometry.curved else kind, local, x)
        bad = np.flatnonzero((det * np.sign(det.sum())).min(axis=1) <= DEGENERATE * size**d)
        if len(bad):
            where = ", ".join(f"{value:.6g}" for value in x[bad[0]].mean(axis=0))
            reason = f"{counted(len(bad), 'cell')} {are(len(bad))} inverted or degenerate, one at "
            reason += f"({where}): must have a Jacobian determinant of one sign"
            raise refuse(source, reason, ErrorKind.MESH)
        off = np.linalg.norm(straight_places(gmsh, given, x) - x, axis=2)
        moved = max(moved, (off.max(axis=1) / size).max())
    return moved


def check_facets(gmsh: Any, source: str, d: int, groups: dict[str, list[int]], kind: int) -> None:
    """Check that the facets of each group are of the kind that these cells have.

    Raises:
        SceneError: the facets of a group are of another kind.
    """
    for name, entities in groups.items():
        types = [t for entity in entities for t in gmsh.model.mesh.getElementTypes(d, entity)]
        for given in types:
            if not fits(gmsh, given, kind):
                have, need = (gmsh.model.mesh.getElementProperties(k)[0] for k in (given, kind))
                reason = f"has facets of type {have}, but the cells have facets of type {need}"
                raise refuse(source, f"group {name!r} {reason}", ErrorKind.MESH)


def determinants(gmsh: Any, kind: int, local: Floats, cells: Floats) -> Floats:
    """Jacobian determinants of cells at their own nodes.

    Args:
        gmsh: the open gmsh.
        kind: gmsh type of the cells, with p nodes.
        local: reference nodes, shape (at least p, 3).
        cells: coordinates of the nodes in m, shape (c, at least p, d).

    Returns:
        Determinants, shape (c, p).
    """
    p, d = gmsh.model.mesh.getElementProperties(kind)[3], cells.shape[2]
    _, gradients, _ = gmsh.model.mesh.getBasisFunctions(kind, local[:p].ravel(), "GradLagrange")
    gradients = np.reshape(gradients, (p, p, 3))[:, :, :d]
    parts = np.array_split(cells[:, :p], 1 + len(cells) // 10_000)
    return np.concatenate(
        [np.linalg.det(np.einsum("pni,cnj->cpij", gradients, part)) for part in parts]
    )

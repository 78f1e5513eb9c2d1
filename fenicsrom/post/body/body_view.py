"""The surface of a body as triangles, and the parallel projection that looks at its broad side."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from fenicsrom.arrays import Array
from fenicsrom.post.paraview.vtk import Grid, grid_of, in_space, unknowns_of

if TYPE_CHECKING:
    from dolfinx.fem import Function, FunctionSpace

PolyData = Any  # of pyvista, which is imported only where a body is drawn

BROAD = 1.5
"""Ratio of the areas seen from two sides from which one of them is the broad side."""

PLATE = 3.0
"""The same ratio from which the body is a plate, whose modes are seen face-on."""

SLENDER = 8.0
"""Ratio of the length to the height of the box around a straight slender body.

The sections of such a body move like points of its axis."""

Way = tuple[float, float, float]

OBLIQUE: Way = (0.72, 0.15, 0.66)
"""Direction to the viewer: parts along the broad side's normal, the long axis, and across both."""

SIDEWAYS: tuple[Way, ...] = ((0.45, 0.15, 0.88), (0.88, 0.15, 0.45))
"""Other directions: they look across a displacement along the normal, or across the narrow side."""

END_ON: Way = (0.65, 0.45, 0.60)
"""The same, so that an end of the body is seen as well."""

FACE_ON: Way = (1.0, 0.0, 0.0)
"""The direction to the viewer of the broad side."""


@dataclass(frozen=True, eq=False)
class View:
    """A parallel projection that looks at the broad side of a body.

    Attributes:
        right, up, towards: (3,) unit vectors of the picture; `towards` points to the viewer.
        length: largest extent of the body, m.
    """

    right: Array
    up: Array
    towards: Array
    length: float

    def project(self, points: Array) -> Array:
        """(n, 2) places in the picture, m."""
        return points @ np.column_stack([self.right, self.up])


def view_of(
    surface: PolyData,
    facing: Array | None = None,
    oblique: Way = OBLIQUE,
    moved: Array | None = None,
) -> View:
    """Look at the broad side of a body; its longest axis lies across the picture.

    The broad side is the direction from which most of the surface is seen, perpendicular to the
    longest axis. A body along z stands upright.

    Args:
        surface: the surface of the body.
        facing: (3,) normal of a place that must be seen: the viewer moves to the other side,
            below the body or to its other end, if the place is not seen otherwise.
        oblique: direction to the viewer, such as `OBLIQUE`.
        moved: (3,) the largest displacement that is shown: of `oblique` and `SIDEWAYS`, that
            direction is taken that looks across it.
    """
    length = float(np.ptp(surface.points, axis=0).max())
    if is_flat(surface.points):
        x, y, z = np.eye(3)
        return View(x, y, z, length)
    axes, _ = _axes(surface)
    if moved is not None:
        oblique = min((oblique, *SIDEWAYS), key=lambda way: abs(float(way @ axes @ moved)))
    towards = np.asarray(oblique @ axes)
    if facing is not None and facing @ towards < 0.0:
        sides = sorted(_sides(oblique) @ axes, key=lambda way: -float(facing @ way))
        upright = [way for way in sides if way @ axes[1] > 0.0 and facing @ way > 0.0]
        towards = np.asarray((upright or sides)[0])
    return _looking(axes, towards, length)


def view_at(surface: PolyData, place: int) -> tuple[View, bool]:
    """Look at a point of a body that neither lies behind nor is hidden by another part of it.

    Args:
        surface: the surface of the body.
        place: number of the point.

    Returns:
        The projection, and whether the point is seen in it.
    """
    first = view_of(surface)
    if is_flat(surface.points):
        return first, True
    axes, _ = _axes(surface)
    ways = [way for kind in (OBLIQUE, *SIDEWAYS, END_ON) for way in _sides(kind)]
    options = [_looking(axes, way @ axes, first.length) for way in ways]
    around = np.any(surface.regular_faces == place, axis=1)
    normal = areas(surface)[around].sum(axis=0)
    options.sort(key=lambda view: -float(np.sign(normal @ view.towards)))
    seen = (view for view in options if is_seen(surface, surface.points[place], view))
    found = next(seen, None)
    return found or options[0], found is not None


def is_seen(surface: PolyData, place: Array, view: View) -> bool:
    """Whether nothing of the body lies between the viewer and a place (3,) on its surface."""
    start = place + 1e-3 * view.length * view.towards
    end = place + 4.0 * view.length * view.towards
    return not len(surface.ray_trace(start, end)[0])


def face_on(surface: PolyData) -> View | None:
    """The projection that sees the broad side of a plate, such as a blade; None of other bodies."""
    if is_flat(surface.points) or is_slender(surface.points):
        return None
    axes, ratio = _axes(surface)
    deep, _, wide = np.ptp(surface.points @ axes.T, axis=0)  # a bracket is deep
    return view_of(surface, oblique=FACE_ON) if ratio >= PLATE and deep < wide else None


def is_slender(points: Array) -> bool:
    """Whether the box around points (n, d) is `SLENDER` times as long as high."""
    extent = np.sort(np.ptp(points, axis=0))
    return bool(extent[-1] >= SLENDER * extent[-2])


def _axes(surface: PolyData) -> tuple[Array, float]:
    """The broad side's normal, the long axis and the third axis as rows.

    Also the ratio of the areas that are seen from the broad and from the narrow side.
    """
    extent = np.ptp(surface.points, axis=0)
    thin, middle, along = np.eye(3)[np.argsort(extent, kind="stable")]
    normal = areas(surface)
    sizes = np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-300)
    plane = np.array([middle, thin])
    seen, turn = np.linalg.eigh(plane @ (normal.T @ (normal / sizes)) @ plane.T)
    broad = turn[:, 1] @ plane if seen[1] > BROAD * seen[0] else middle
    broad = broad * (-1.0 if np.cross(broad, along) @ [0.0, 0.6, 1.0] < 0.0 else 1.0)
    return np.array([broad, along, np.cross(broad, along)]), float(seen[1] / max(seen[0], 1e-300))


def _sides(way: Way) -> Array:
    """The direction (8, 3) from all sides of the body."""
    return np.multiply(way, list(itertools.product((1.0, -1.0), repeat=3)))


def _looking(axes: Array, towards: Array, length: float) -> View:
    """The projection with this direction to the viewer."""
    _, along, third = axes
    up = along if along[2] else third
    towards = np.asarray(towards / np.linalg.norm(towards))
    up = np.asarray(up - (up @ towards) * towards)
    up = np.asarray(up / np.linalg.norm(up))
    return View(np.asarray(np.cross(up, towards)), up, towards, length)


def largest_of(displacement: Array) -> Array:
    """The largest of displacements (n, 3), (3,) m."""
    return np.asarray(displacement[int(np.argmax(np.linalg.norm(displacement, axis=1)))])


class Frame(NamedTuple):
    """The part of a picture that is shown.

    Attributes:
        view: the projection.
        low: (2,) lower left corner, m.
        high: (2,) upper right corner, m.
    """

    view: View
    low: Array
    high: Array


def frame_of(view: View, points: Sequence[Array]) -> Frame:
    """The part of a picture with points (n, 3), and with the triad below."""
    places = np.concatenate([view.project(found) for found in points])
    spare = 0.03 * view.length
    return Frame(view, places.min(axis=0) - [spare, 0.16 * view.length], places.max(axis=0) + spare)


Ints = NDArray[np.int64]

FEATURE_ANGLE = 40.0
"""Smallest angle between two triangles, in degrees, at which their common edge is drawn."""

NODE = "node"
"""The point array of a surface with the numbers of its points in the grid."""


def gathered_grid(
    space: FunctionSpace, fields: Mapping[str, Array | Function]
) -> tuple[Grid, dict[str, Array]] | None:
    """Collect the mesh of a body and fields on it on the first rank. Collective.

    Args:
        space: vector Lagrange space of degree 1 or 2.
        fields: label -> nodal values, as an array of the local and ghost unknowns or a Function.

    Returns:
        The grid, and the values (n, 3) at its points; None on the other ranks.
    """
    comm, numbering, d = space.mesh.comm, space.dofmap.index_map, space.dofmap.index_map_bs
    grid, nodes = grid_of(space)
    owned = numbering.size_local
    cells = numbering.local_to_global(nodes.astype(np.int32))[grid.cells]
    mine = space.tabulate_dof_coordinates()[:owned]
    values = {
        label: in_space(unknowns_of(field).reshape(-1, d)[:owned])
        for label, field in fields.items()
    }
    found = comm.gather((cells, mine, values))
    if found is None:
        return None
    cells, points = (np.concatenate([part[k] for part in found]) for k in range(2))
    joined = {label: np.concatenate([part[2][label] for part in found]) for label in fields}
    return Grid(points, cells, grid.cell_type), joined


def surface_of(grid: Grid, values: Mapping[str, Array] | None = None) -> PolyData:
    """The boundary of a grid of solid cells, or all cells of a plane grid, as triangles.

    Args:
        grid: the grid.
        values: label -> values (n, ...) at its points.

    Returns:
        The triangles, counter-clockwise seen from outside, with the values as point arrays.
    """
    return _boundary(grid, 1, values).triangulate()


def _boundary(grid: Grid, divisions: int, values: Mapping[str, Array] | None = None) -> PolyData:
    """The boundary of a grid; quadratic faces are divided so often, and their nodes are used."""
    import pyvista

    count = np.full((len(grid.cells), 1), grid.cells.shape[1])
    types = np.full(len(grid.cells), grid.cell_type, dtype=np.uint8)
    solid = pyvista.UnstructuredGrid(np.hstack([count, grid.cells]).ravel(), types, grid.points)
    for label, found in (values or {}).items():
        solid.point_data[label] = found
    solid.point_data[NODE] = np.arange(len(grid.points))
    return solid.extract_surface(nonlinear_subdivision=divisions, algorithm="dataset_surface")


def form_edges(surface: PolyData) -> PolyData:
    """The edges that show the form of a surface: its rim and its sharp edges.

    Each edge has its own two points: bodies that touch have two nodes at one place.
    """
    import pyvista
    from vtkmodules.vtkCommonDataModel import vtkNonMergingPointLocator
    from vtkmodules.vtkFiltersCore import vtkFeatureEdges

    edges = vtkFeatureEdges()
    edges.SetInputData(surface)
    edges.SetFeatureAngle(FEATURE_ANGLE)
    edges.NonManifoldEdgesOff()
    edges.ManifoldEdgesOff()
    edges.ColoringOff()
    edges.SetLocator(vtkNonMergingPointLocator())
    edges.Update()
    return pyvista.wrap(edges.GetOutput())


def cell_edges(grid: Grid) -> PolyData:
    """The edges of the cells on the boundary of a grid, straight between their corners."""
    return _boundary(grid, 0).extract_all_edges()


def is_flat(points: Array) -> bool:
    """Whether points (n, 3) lie in the plane of x and y."""
    return not np.ptp(points[:, 2])


def areas(surface: PolyData) -> Array:
    """(k, 3) normals of the triangles of a surface, as long as their areas, m²."""
    a, b, c = (surface.points[surface.regular_faces[:, k]].astype(float) for k in range(3))
    return np.asarray(0.5 * np.cross(b - a, c - a))


def faces_on(surface: PolyData, on: Any) -> Any:
    """(k,) whether all corners of the triangles are among the flagged points (n,)."""
    return on[surface.regular_faces].all(axis=1)

"""The content of a mesh file, read without a scene and without dolfinx."""

from collections import Counter
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from fenicsrom.errors import SceneError
from fenicsrom.fem.mesh import gmsh_cad
from fenicsrom.fem.mesh.gmsh_files import SUFFIXES, load_file, merge_file, open_gmsh
from fenicsrom.fem.mesh.gmsh_model import CleanModel, apart, clean_model, ends_of, pieces_of
from fenicsrom.fem.mesh.sector import Sector
from fenicsrom.formats.mesh_file import Floats, Ints, Physics
from fenicsrom.formats.shapes import SHAPES, STRAIGHT, facet_kind
from fenicsrom.scene import Geometry
from fenicsrom.words import brief

CELLS_ALONG = 20
"""Cells along a body from a .step file whose cell size is not given."""

LARGE = 20.0
"""Longer bodies, in m, may be files in another unit than metres."""

RULE = "Gauss4"
"""Quadrature for volumes and areas: exact for hexahedra with straight edges."""


@dataclass(frozen=True, eq=False)
class Group:
    """A group of cells, facets or nodes.

    Attributes:
        name: its name.
        kind: "cells", "facets" or "nodes".
        number: number of cells, facets or nodes.
        size: volume, area or length, in m to the power of the dimension; None for nodes.
        low: the lowest coordinates (d,), m.
        high: the highest coordinates (d,), m.
        members: corners of facets (k, corners), or nodes (k,), as indices of `Inspection.points`;
            None for cells.
    """

    name: str
    kind: str
    number: int
    size: float | None
    low: Floats
    high: Floats
    members: Ints | None = None


@brief()
@dataclass(frozen=True, eq=False, repr=False)
class Inspection:
    """What a mesh file holds.

    Attributes:
        path: the file.
        geometry: keys of the [geometry] of a scene with this mesh.
        cells: number of cells by their type.
        nodes: number of nodes.
        low: the lowest coordinates (d,), m.
        high: the highest coordinates (d,), m.
        pieces: number of pieces of the mesh that share no node; 0 if the mesh cannot be used.
        volume: volume in m³, in 2D area in m²; 0 if the mesh cannot be used.
        quality: smallest quality of a cell, from below 0 (inside out) to 1 (equal sides): the
            inverse condition number of its Jacobian.
        worst: coordinates (3,) of the middle of this cell, m.
        curved: whether `geometry.curved = true` works, in words.
        bulge: relative change of the volume with curved cells; 0 if they do not work.
        groups: the groups, largest dimension first.
        warnings: sentences for the user; one of them names the parts that are not read.
        points: coordinates of the corners (n, 3), m.
        boundary: corners of the facets (2D: of the cells) that a picture shows (k, corners).
        refusal: why the mesh cannot be used; None if it can.
        physics: materials, supports, masses and loads of a finite-element model.
        sector: set if the body is likely one sector of a disk.
    """

    path: Path
    geometry: Geometry
    cells: dict[str, int]
    nodes: int
    low: Floats
    high: Floats
    pieces: int = 0
    volume: float = 0.0
    quality: float = 0.0
    worst: Floats = field(default_factory=lambda: np.zeros(3))
    curved: str = ""
    bulge: float = 0.0
    groups: tuple[Group, ...] = ()
    warnings: tuple[str, ...] = ()
    points: Floats | None = None
    boundary: Ints | None = None
    refusal: SceneError | None = None
    physics: Physics = field(default_factory=Physics)
    sector: Sector | None = None

    @property
    def extent(self) -> float:
        """The largest extent, m."""
        return float(np.max(self.high - self.low))


def inspect(path: Path, scale: float = 1.0, size: float | None = None) -> Inspection:
    """Read a mesh file, or mesh a geometry, and describe it.

    Args:
        path: the file.
        scale: length in m of the unit of the coordinates in a mesh file.
        size: cell size in m for a .step file; by default a twentieth of the body.

    Raises:
        SceneError: the file cannot be read. A mesh that can be read but not be used is described,
            with the reason.
        RuntimeError: gmsh is in use in this process.
    """
    with open_gmsh() as gmsh:
        geometry = _geometry(gmsh, path, scale, size)
        gmsh.model.remove()
        loaded = load_file(gmsh, geometry)
        cells, low, high = _cells(gmsh, geometry)
        nodes = len(gmsh_cad.model_nodes(gmsh)[0])
        found = Inspection(path, geometry, cells, nodes, low, high, physics=loaded.physics)
        try:
            clean = clean_model(gmsh, geometry, loaded.node_sets)
        except SceneError as error:
            return replace(found, warnings=loaded.warnings, refusal=error)
        described = _described(gmsh, found, clean, loaded.warnings)
        curved, bulge = _curved(gmsh, described)
        return replace(described, curved=curved, bulge=bulge)


def _curved(gmsh: Any, found: Inspection) -> tuple[str, float]:
    """Say whether the cells may be curved, and by how much the volume then changes.

    The model of the file changes.
    """
    geometry, d = replace(found.geometry, curved=True), found.geometry.dimension
    gmsh.model.setCurrent("file")
    straight = {SHAPES[kind].name for kind in STRAIGHT.values()}
    if SUFFIXES.get(found.path.suffix.lower()) in ("geo", "step"):
        number = gmsh_cad.make_curved(gmsh, d)
        note = f"; {gmsh_cad.straightened(number)}" if number else ""
    elif found.cells.keys() & straight:
        return "does not work: the cells of the file have straight edges", 0.0
    else:
        gmsh.model.remove()
        loaded, note = load_file(gmsh, geometry), ""
        try:
            clean_model(gmsh, geometry, loaded.node_sets)
        except SceneError as error:
            return f"does not work: {error}", 0.0
        gmsh.model.setCurrent("file")
    tags = np.concatenate(gmsh.model.mesh.getElements(d)[1])
    worst = np.min(gmsh.model.mesh.getElementQualities(tags, "minSJ"))
    factor = geometry.scale**d
    volume = factor * sum(_measure(gmsh, d, tag) for _, tag in gmsh.model.getEntities(d))
    change = volume / found.volume - 1.0
    what = "volume" if d == 3 else "area"
    return (
        f"works, with scaled Jacobians of at least {worst:.2g}, and changes the {what} by "
        f"{round(100 * change, 2) + 0.0:+.2g} %{note}"
    ), change


def _geometry(gmsh: Any, path: Path, scale: float, size: float | None) -> Geometry:
    """The [geometry] of a scene with this file; 2D bodies are 1 m thick."""
    is_step = SUFFIXES.get(path.suffix.lower()) == "step"
    draft = Geometry(mesh=path, dimension=3, scale=1.0 if is_step else scale, size=size)
    merge_file(gmsh, draft)
    dimension = gmsh.model.getDimension()
    if is_step and size is None:
        box = np.reshape(gmsh.model.getBoundingBox(-1, -1), (2, 3))
        size = float(f"{np.ptp(box, axis=0).max() / CELLS_ALONG:.2g}")
    thickness = 1.0 if dimension == 2 else None
    return replace(draft, dimension=dimension, size=size, thickness=thickness)


def _cells(gmsh: Any, geometry: Geometry) -> tuple[dict[str, int], Floats, Floats]:
    """Number of cells by type, and the lowest and highest coordinates of their nodes."""
    numbers, points = gmsh_cad.model_nodes(gmsh)
    count: Counter[str] = Counter()
    used = [np.empty(0, dtype=np.int64)]
    for _, entity in gmsh.model.getEntities(geometry.dimension):
        found = gmsh.model.mesh.getElements(geometry.dimension, entity)
        for kind, elements, nodes in zip(*found, strict=True):
            name = gmsh.model.mesh.getElementProperties(kind)[0]
            count[SHAPES[int(kind)].name if int(kind) in SHAPES else name] += len(elements)
            used.append(np.searchsorted(numbers, nodes))
    x = geometry.scale * points[np.unique(np.concatenate(used)), : geometry.dimension]
    if not len(x):
        x = np.zeros((1, geometry.dimension))
    return dict(count), x.min(axis=0), x.max(axis=0)


def _described(
    gmsh: Any, found: Inspection, clean: CleanModel, warnings: tuple[str, ...]
) -> Inspection:
    """Add volume, groups and boundary from the clean model, which is the current one."""
    d = found.geometry.dimension
    numbers, points = gmsh_cad.model_nodes(gmsh)
    entities = [entity for _, entity in gmsh.model.getEntities(d)]
    given = next(int(k) for e in entities for k in gmsh.model.mesh.getElementTypes(d, e))
    kind = gmsh_cad.straight_kind(gmsh, given)
    cells = np.searchsorted(numbers, gmsh_cad.elements_of(gmsh, d, entities, kind))
    groups = []
    for dim, names in ((d, clean.cell_groups), (d - 1, clean.facet_groups)):
        element = kind if dim == d else facet_kind(kind)
        for name, tags in names.items():
            on = [e for tag in tags for e in gmsh.model.getEntitiesForPhysicalGroup(dim, tag)]
            rows = np.searchsorted(numbers, gmsh_cad.elements_of(gmsh, dim, on, element))
            size = sum(_measure(gmsh, dim, entity) for entity in on)
            members = None if dim == d else rows
            what = "cells" if dim == d else "facets"
            groups.append(_group(name, what, points[rows], d, size, members))
    for name, (nodes, _) in clean.nodes.items():
        groups.append(_group(name, "nodes", points[nodes][:, None], d, None, nodes))
    if d == 3:
        shown, _ = gmsh_cad.boundary_facets(gmsh, d, entities, given)
        shown = shown[:, : SHAPES[facet_kind(kind)].corners]
    else:
        shown = gmsh_cad.elements_of(gmsh, d, entities, kind)
    tags = np.concatenate(gmsh.model.mesh.getElements(d)[1])
    quality = np.asarray(gmsh.model.mesh.getElementQualities(tags, "minSICN"))
    low, high = _pieces(cells, points[:, :d])
    said = [] if clean.sector is None else [clean.sector.note]
    if len(low) > 1 + len(found.physics.joints):
        said.insert(0, apart(low, high))
    return replace(
        found,
        pieces=len(low),
        volume=sum(_measure(gmsh, d, entity) for entity in entities),
        quality=float(quality.min()),
        worst=points[cells[quality.argmin()]].mean(axis=0),
        groups=tuple(groups),
        warnings=(*warnings, *clean.warnings, *said),
        points=points,
        boundary=np.searchsorted(numbers, shown),
        sector=clean.sector if clean.sector is not None and clean.sector.is_likely else None,
    )


def _pieces(cells: Ints, points: Floats) -> Floats:
    """Lowest and highest coordinates (2, p, d) of the connected pieces of cells (k, corners)."""
    used, rows = np.unique(cells, return_inverse=True)
    piece = pieces_of(rows.reshape(cells.shape), len(used))
    return ends_of(piece, points[used], 1 + piece.max())


def _group(
    name: str, kind: str, x: Floats, d: int, size: float | None, members: Ints | None
) -> Group:
    """A group of elements with corners x (k, corners, 3)."""
    low, high = x.min(axis=(0, 1), initial=np.inf)[:d], x.max(axis=(0, 1), initial=-np.inf)[:d]
    return Group(name, kind, len(x), size, low, high, members)


def _measure(gmsh: Any, d: int, entity: int) -> float:
    """Volume, area or length of the elements of an entity."""
    total = 0.0
    for kind in gmsh.model.mesh.getElementTypes(d, entity):
        local, weights = gmsh.model.mesh.getIntegrationPoints(kind, RULE)
        _, determinants, _ = gmsh.model.mesh.getJacobians(kind, local, entity)
        total += float(np.abs(determinants).reshape(-1, len(weights)).sum(axis=0) @ weights)
    return total

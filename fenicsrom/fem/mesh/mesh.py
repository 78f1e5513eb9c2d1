"""Meshes with named groups.

`build_mesh` makes or reads the mesh of a scene, `mesh_from_gmsh_model` takes the model of an open
gmsh, and `mesh_from_dolfinx` a dolfinx mesh with tags. Rank 0 checks the cells of a file in gmsh,
and dolfinx distributes a clean model. An error on rank 0 is raised on every rank.
"""

from collections.abc import Callable, Iterable, Mapping
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from typing import Any

import dolfinx.mesh
import numpy as np
import ufl
from dolfinx import fem
from mpi4py import MPI

from fenicsrom.errors import ErrorKind, refuse
from fenicsrom.fem.base import compat
from fenicsrom.fem.base.forms import compiled_form
from fenicsrom.fem.mesh.gmsh_files import load_file, open_gmsh
from fenicsrom.fem.mesh.gmsh_model import CleanModel, clean_model
from fenicsrom.fem.mesh.mesh_data import Ints, Mesh
from fenicsrom.scene import Geometry
from fenicsrom.scene.base.rules import Where, choice, number

VOLUME_TOLERANCE = 1e-6
"""Largest relative difference of the two volumes of a mesh whose cells do not overlap.

A cell that is inside out adds twice its volume. The tolerance allows for the quadrature of curved
cells; a mesh of more than a million cells may hide one small cell that is inside out.
"""

QUADRATURE_DEGREE = 6
"""Exact for the volumes of straight cells."""


def check_dolfinx_mesh(domain: dolfinx.mesh.Mesh, source: str) -> None:
    """Check that a body can be made of a mesh. Collective.

    The divergence theorem gives the volume of the body by its boundary,

        V = 1/d ∮ x · n ds,

    which equals the sum of the volumes of the cells only if no cell is inside out.

    Raises:
        SceneError: on every rank, if the mesh is not plane or solid, its coordinates are not finite
            numbers of float64, or its cells overlap.
    """
    d, gdim, x = domain.topology.dim, domain.geometry.dim, domain.geometry.x
    if d not in (2, 3) or d != gdim:
        reason = f"cells of dimension {d} in {gdim} dimensions: must be 2 in 2D or 3 in 3D"
        raise refuse(source, reason, ErrorKind.MESH)
    if x.dtype != np.float64:
        raise refuse(source, f"coordinates of {x.dtype}: must be float64", ErrorKind.MESH)
    if not domain.comm.allreduce(bool(np.all(np.isfinite(x))), MPI.LAND):
        raise refuse(source, "a node has coordinates that are not finite", ErrorKind.MESH)
    metadata = {"quadrature_degree": QUADRATURE_DEGREE}
    dx, ds = ufl.dx(domain, metadata=metadata), ufl.ds(domain, metadata=metadata)
    place, normal = ufl.SpatialCoordinate(domain), ufl.FacetNormal(domain)
    inside, around = (
        domain.comm.allreduce(float(fem.assemble_scalar(compiled_form(form))))
        for form in (fem.Constant(domain, 1.0) * dx, ufl.dot(place, normal) / d * ds)
    )
    if not abs(inside - around) <= VOLUME_TOLERANCE * inside:
        reason = f"cells overlap or are inside out: their volumes add up to {inside:.6g}, and the "
        raise refuse(source, f"{reason}boundary encloses {around:.6g}", ErrorKind.MESH)


def check_tags(
    domain: dolfinx.mesh.Mesh, tags: Any, dimension: int, name: str, source: str
) -> None:
    """Check that tags belong to the entities of this dimension of a mesh. Collective.

    Raises:
        SceneError: on every rank, if they do not.
    """
    kind = "facets" if dimension < domain.topology.dim else "cells"
    reason = ""
    if not isinstance(tags, dolfinx.mesh.MeshTags):
        reason = f"must be the tags of the {kind}, not {type(tags).__name__}"
    elif tags.dim != dimension:
        reason = f"tags of dimension {tags.dim}: the {kind} have dimension {dimension}"
    else:
        entities = domain.topology.index_map(dimension)
        number = entities.size_local + entities.num_ghosts
        if tags.indices.size and tags.indices.max() >= number:
            reason = f"tags of another mesh: this mesh has {number} {kind}"
    reasons = sorted(filter(None, domain.comm.allgather(reason)))
    if reasons:
        raise refuse(source, reasons[0], ErrorKind.MESH, name)


def group_tags(name: str, tags: Any, present: set[int], source: str) -> tuple[int, ...]:
    """Give the tags of a group, which must be tags of facets.

    Args:
        name: name of the group.
        tags: an integer or some integers, also of numpy.
        present: the tags of the facets of all ranks.
        source: name of the mesh, for messages.

    Raises:
        SceneError: a tag is not an integer, or no facet has it.
    """
    wanted = np.atleast_1d(list(tags) if isinstance(tags, Iterable) else tags)
    key = f"groups.{name}"
    if wanted.dtype.kind not in "iu" or not wanted.size:
        allowed = "must be an integer tag or a list of them"
        raise Where(source, key).refuse(tags, allowed, ErrorKind.TYPE)
    found = tuple(map(int, wanted))
    missing = sorted({*found} - present)
    if missing:
        reason = f"no facet has the tag {missing[0]}; the facets have the tags {sorted(present)}"
        raise refuse(source, reason, ErrorKind.PLACE, key)
    return found


def build_mesh(geometry: Geometry, comm: MPI.Comm) -> Mesh:
    """Make or read the mesh of a scene. Collective.

    In a .geo file, `geometry.parameters` sets the names in its `DefineConstant`. If `structured` is
    one of these names, `geometry.cells` sets it to 1 or 0. The file may refuse values with
    `Error("...")`. A .msh file may have any version that gmsh reads. The groups of both formats are
    the physical groups, by their names or numbers.

    A .step file is converted to metres and meshed with simplices of `geometry.size`; its faces are
    groups by their names or numbers. Bodies that touch are glued there: a face keeps its name on
    the surface, and its part inside is a group of both names, such as "6+11". The groups of other
    files are: node sets, element sets and surfaces in .inp; the elements of each property, by its
    number, in .bdf; components in .cdb; and in .vtu each integer field of cells or points that is 0
    or 1, and `name:value` for each value of the other integer fields. If a node set contains all
    nodes of some boundary facets, these facets are a facet group of the same name. A group of cells
    may have the name of a group of facets.

    Args:
        geometry: the [geometry] of the scene.
        comm: communicator to distribute the mesh on.

    Returns:
        The mesh, with the same groups on every rank.

    Raises:
        SceneError: on every rank, if the file cannot be read or meshed; a parameter is unknown or
            refused; cells are mixed, inverted, overlapping, or of another dimension or kind than
            those of the scene; a node hangs; a group is empty; or meshio is missing.
        RuntimeError: gmsh is in use in this process.
    """
    with ExitStack() as stack:

        def draft() -> tuple[CleanModel, Any]:
            gmsh = stack.enter_context(open_gmsh())
            loaded = load_file(gmsh, geometry)
            clean = clean_model(gmsh, geometry, loaded.node_sets)
            warnings = (*loaded.warnings, *clean.warnings)
            return replace(clean, warnings=warnings, glued=loaded.glued), gmsh.model

        return _distributed(draft, geometry, comm)


def mesh_from_gmsh_model(
    dimension: int,
    *,
    comm: MPI.Comm = MPI.COMM_WORLD,
    curved: bool = False,
    scale: float = 1.0,
    source: str = "the gmsh model",
) -> Mesh:
    """Take the mesh of the current model of the open gmsh on rank 0. Collective.

    Groups are the physical groups, by their names or numbers. The cells are those of the group
    "solid" or, without this group, all cells of this dimension. The model is not changed.

    Args:
        dimension: 2 or 3.
        comm: communicator to distribute the mesh on.
        curved: keep quadratic cells curved; otherwise they are made straight.
        scale: length in m of the unit of the coordinates.
        source: name of the mesh, for messages.

    Returns:
        The mesh, with the same groups on every rank.

    Raises:
        SceneError: on every rank, if an argument is not allowed, gmsh is not initialised on rank 0,
            or the mesh cannot be used, as in `build_mesh`.
    """
    choice(2, 3)(dimension, Where(source, "dimension"))
    number(above=0.0)(scale, Where(source, "scale"))
    geometry = Geometry(mesh=Path(source), dimension=dimension, curved=curved, scale=scale)
    with ExitStack() as stack:

        def draft() -> tuple[CleanModel, Any]:
            import gmsh

            if not gmsh.isInitialized():
                raise refuse(source, "gmsh is not initialised on rank 0", ErrorKind.MESH)
            current = gmsh.model.getCurrent()
            found = clean_model(gmsh, geometry, {})
            stack.callback(gmsh.model.setCurrent, current)
            stack.callback(gmsh.model.remove)
            return found, gmsh.model

        return _distributed(draft, geometry, comm)


def mesh_from_dolfinx(
    domain: dolfinx.mesh.Mesh,
    facet_tags: dolfinx.mesh.MeshTags,
    groups: Mapping[str, int | Iterable[int]],
    cell_tags: dolfinx.mesh.MeshTags | None = None,
    source: str = "the dolfinx mesh",
) -> Mesh:
    """Name the groups of a dolfinx mesh. Collective.

    Args:
        domain: the mesh in 2D or 3D, with coordinates of float64 in m.
        facet_tags: tags of the facets.
        groups: tag, or tags, of the facets of each group.
        cell_tags: tags of the cells, or None.
        source: name of the mesh, for messages.

    Returns:
        The mesh with these groups.

    Raises:
        SceneError: on every rank, if the coordinates are not finite or the cells overlap, the tags
            are not those of the facets or cells of this mesh, or no facet has a tag of a group.
    """
    d = domain.topology.dim
    check_dolfinx_mesh(domain, source)
    domain.topology.create_entities(d - 1)
    check_tags(domain, facet_tags, d - 1, "facet_tags", source)
    if cell_tags is not None:
        check_tags(domain, cell_tags, d, "cell_tags", source)
    present = set().union(*domain.comm.allgather(set(facet_tags.values.tolist())))
    named = {name: group_tags(name, tags, present, source) for name, tags in groups.items()}
    if cell_tags is None:
        cells = np.arange(domain.topology.index_map(d).size_local, dtype=np.int32)
        cell_tags = dolfinx.mesh.meshtags(domain, d, cells, np.ones_like(cells))
    return Mesh(domain, cell_tags, facet_tags, named, {}, source)


def _distributed(
    draft: Callable[[], tuple[CleanModel, Any]], geometry: Geometry, comm: MPI.Comm
) -> Mesh:
    """Distribute the clean model that rank 0 makes.

    Args:
        draft: function called on rank 0; returns the description of the clean model, and gmsh.
        geometry: the dimension, and the name of the mesh for messages.
        comm: communicator to distribute the mesh on.

    Raises:
        Exception: on every rank, the exception that `draft` raised on rank 0.
    """
    source = str(geometry.mesh)
    model, clean, failure = None, None, None
    if comm.rank == 0:
        try:
            clean, model = draft()
        except UnicodeDecodeError:
            failure = refuse(source, "the names in the file must be UTF-8 text")
        except Exception as error:
            failure = error
    failure, clean = comm.bcast((failure, clean))
    if failure is not None:
        raise failure
    domain, cell_tags, facet_tags = compat.model_to_mesh(model, comm, geometry.dimension)
    domain.topology.create_entities(geometry.dimension - 1)
    facet_groups, warnings = _facet_groups_on_cells(source, clean, facet_tags, domain)
    nodes = _local_node_groups(clean.nodes, domain)
    found = domain, cell_tags, facet_tags, facet_groups, clean.cell_groups, source, warnings
    of = clean.node_sets, clean.glued, clean.sector, clean.has_middles
    return Mesh(*found, nodes, *of)


def _local_node_groups(
    nodes: dict[str, tuple[Ints, Ints]], domain: dolfinx.mesh.Mesh
) -> dict[str, tuple[Ints, Ints]]:
    """Find the vertices and edges of the node groups on this rank.

    Args:
        nodes: numbers in the model of the vertices, shape (n,), and of the ends of the edges, shape
        (k, 2).
        domain: the mesh.

    Returns:
        The local vertices and edges of each group.
    """
    if not nodes:
        return {}
    topology = domain.topology
    for pair in ((0, topology.dim), (1, 0), (1, topology.dim)):
        topology.create_entities(pair[0])
        topology.create_connectivity(*pair)
    number = [topology.index_map(k).size_local + topology.index_map(k).num_ghosts for k in (0, 1)]
    vertices = np.arange(number[0], dtype=np.int32)
    places = compat.entity_nodes(domain, 0, vertices).reshape(-1)
    model = np.asarray(domain.geometry.input_global_indices)[places]
    ends = np.sort(model[topology.connectivity(1, 0).array].reshape(number[1], 2), axis=1)
    found = {}
    for name, (points, pairs) in nodes.items():
        marks = np.isin(model, points), np.isin(_keys(ends), _keys(np.sort(pairs, axis=1)))
        found[name] = tuple(np.flatnonzero(mark).astype(np.int32) for mark in marks)
    return found


def _keys(pairs: Ints) -> Ints:
    """One number for each pair of node numbers, shape (k, 2)."""
    return pairs[:, 0].astype(np.int64) * 2**31 + pairs[:, 1].astype(np.int64)


def _facet_groups_on_cells(
    source: str, clean: CleanModel, facet_tags: dolfinx.mesh.MeshTags, domain: dolfinx.mesh.Mesh
) -> tuple[dict[str, tuple[int, ...]], tuple[str, ...]]:
    """Leave out facets that do not belong to a cell; give groups and warnings. Collective."""
    below = domain.topology.dim - 1
    tags = facet_tags.values[facet_tags.indices < domain.topology.index_map(below).size_local]
    highest = max((max(tags) for tags in clean.facet_groups.values()), default=0)
    number = domain.comm.allreduce(np.bincount(tags, minlength=1 + highest))
    groups, warnings = dict(clean.facet_groups), list(clean.warnings)
    for name, size in clean.facets.items():
        lost = size - int(number[list(groups[name])].sum())
        if lost:
            what = f"{lost} of {size} facets are not facets of a cell and are left out"
            warnings.append(f"{source}: group {name!r}: {what}")
        if lost == size:
            del groups[name]
    return groups, tuple(warnings)

"""The mesh of several parts in gmsh: the bodies of several files, and the sectors of a disk."""

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from fenicsrom import formats
from fenicsrom.errors import ErrorKind, refuse
from fenicsrom.fem.mesh.gmsh_cad import boundary_facets, group_entities, model_nodes
from fenicsrom.fem.mesh.gmsh_files import Loaded, add_mesh, load_file, mesh_of_model
from fenicsrom.fem.mesh.gmsh_model import SOLID
from fenicsrom.fem.mesh.picking import picking
from fenicsrom.formats import MeshFile
from fenicsrom.formats.mesh_file import Block, Floats, Ints
from fenicsrom.formats.shapes import SHAPES
from fenicsrom.scene import Cyclic, Geometry, Region
from fenicsrom.scene.base.rules import Where

SAME_NODE = 1e-5
"""Nodes of two cut faces at smaller distances, relative to the body, are one node of the disk."""


def load_files(gmsh: Any, geometry: Geometry) -> Loaded:
    """Read the files and put their bodies, which share no node, into one model.

    Raises:
        SceneError: as `load_file`; or groups of two files have one name.
    """
    if not geometry.also:
        return load_file(gmsh, geometry)
    parts, warnings, glued = [], [], set[str]()
    for path in geometry.files:
        before = f"{path.stem}." if path in geometry.also else ""
        own = _part(geometry, path, before)
        loaded = load_file(gmsh, own)
        file = mesh_of_model(gmsh, loaded.node_sets)
        points = file.points * own.scale / geometry.scale
        parts.append(_named(replace(file, points=points), before, own.dimension))
        warnings += loaded.warnings
        glued |= {before + name for name in loaded.glued}
        gmsh.model.remove()
    _check_names(geometry, parts)
    whole = add_mesh(gmsh, str(geometry.mesh), formats.divided(_together(parts)))
    return replace(whole, warnings=(*warnings, *whole.warnings), glued=glued)


def make_disk(
    gmsh: Any, geometry: Geometry, cyclic: Cyclic, picks: Mapping[str, Region], loaded: Loaded
) -> Loaded:
    """Put all sectors of a disk into one model, in place of that of its loaded sector.

    Args:
        gmsh: the open gmsh.
        geometry: the [geometry] of the scene.
        cyclic: how the sector makes the disk.
        picks: boxes and planes of the sector, by the names of the groups that the disk has of them.
        loaded: what the files of the sector hold.

    Raises:
        SceneError: the nodes of the cut faces do not match.
    """
    sector = _named(mesh_of_model(gmsh, loaded.node_sets), "", geometry.dimension)
    if picks:
        block = _picked(gmsh, geometry, picks)
        cuts = (
            _nodes_below(sector, name, geometry.dimension) for name in (cyclic.left, cyclic.right)
        )
        outside = ~np.any([np.isin(block.nodes, cut).all(axis=1) for cut in cuts], axis=0)
        groups = {name: marks & outside for name, marks in block.groups.items()}
        sector = replace(sector, blocks=(*sector.blocks, replace(block, groups=groups)))
    gmsh.model.remove()
    whole = add_mesh(gmsh, str(geometry.mesh), _sectors(sector, geometry, cyclic))
    return replace(loaded, node_sets=whole.node_sets)


def _picked(gmsh: Any, geometry: Geometry, picks: Mapping[str, Region]) -> Block:
    """The facets of the boundary of a sector, with a group for each box and plane."""
    d, (numbers, points) = geometry.dimension, model_nodes(gmsh)
    every = [entity for _, entity in gmsh.model.getEntities(d)]
    solid = group_entities(gmsh, str(geometry.mesh), d).get(SOLID, every)
    given = next(int(kind) for one in solid for kind in gmsh.model.mesh.getElementTypes(d, one))
    rows = np.searchsorted(numbers, boundary_facets(gmsh, d, solid, given)[0])
    width = d - 1, rows.shape[1]
    kind = next(k for k, shape in SHAPES.items() if (shape.dimension, shape.nodes) == width)
    x = geometry.scale * points
    corners, extent = x[rows[:, : SHAPES[kind].corners]], float(np.ptp(x, axis=0).max())
    inside = {name: picking(region, extent)[0] for name, region in picks.items()}
    groups = {
        name: is_inside(corners.reshape(-1, 3).T).reshape(corners.shape[:2]).all(axis=1)
        for name, is_inside in inside.items()
    }
    return Block(kind, rows, groups)


def sector_turn(cyclic: Cyclic, j: int) -> Rotation:
    """The turn of sector 0 to sector j, by j 360°/N about the axis."""
    axis = np.array(cyclic.axis or (0.0, 0.0, 1.0))
    return Rotation.from_rotvec(2.0 * np.pi * j / cyclic.sectors * axis)


def _sectors(file: MeshFile, geometry: Geometry, cyclic: Cyclic) -> MeshFile:
    """All sectors of a disk with common nodes; "tip@3" is the group "tip" of sector 3, "@3" all.

    Raises:
        SceneError: the nodes of the cut faces do not match.
    """
    number, sectors = _common_nodes(file, geometry, cyclic), []
    for j in range(cyclic.sectors):
        blocks = []
        for block in file.blocks:
            own = {f"{name}@{j}": marks for name, marks in block.groups.items()}
            if block.shape.dimension == geometry.dimension:
                own[f"@{j}"] = np.ones(len(block.nodes), dtype=bool)
            blocks.append(replace(block, groups=block.groups | own))
        own_sets = {f"{name}@{j}": nodes for name, nodes in file.node_groups.items()}
        points = _turned(file.points, geometry, cyclic, j)
        sectors.append(MeshFile(points, tuple(blocks), file.node_groups | own_sets))
    whole = _together(sectors)
    joined = [replace(block, nodes=number[block.nodes]) for block in whole.blocks]
    sets = {name: np.unique(number[nodes]) for name, nodes in whole.node_groups.items()}
    first = np.unique(number, return_index=True)[1]
    return MeshFile(whole.points[first], tuple(joined), sets)


def _common_nodes(file: MeshFile, geometry: Geometry, cyclic: Cyclic) -> Ints:
    """The number (N n,) in the disk of each node of one sector after the other.

    Raises:
        SceneError: the nodes of the cut faces do not match.
    """
    d, n, every = geometry.dimension, len(file.points), np.arange(cyclic.sectors)
    left, right = (_nodes_below(file, name, d) for name in (cyclic.left, cyclic.right))
    tree, face = cKDTree(file.points[left]), file.points[right]
    near = {sense: tree.query(_turned(face, geometry, cyclic, -sense)) for sense in (1, -1)}
    sense = min(near, key=lambda s: float(near[s][0].max()))
    distance, opposite = near[sense]
    away = int(np.sum(distance > SAME_NODE * np.ptp(file.points, axis=0).max()))
    if away or len({*opposite}) < len(left):
        reason = f"must have the nodes of {cyclic.right!r}, turned, to join the sectors of the "
        reason += f"whole disk in finite elements: {len(left)} nodes meet {len(right)}, of which "
        reason += f"{away} lie elsewhere; mesh both cut faces alike"
        where = Where(str(geometry.mesh), "cyclic.left")
        raise where.refuse(cyclic.left, reason, ErrorKind.MESH)
    pairs = np.add.outer(every * n, right), np.add.outer((every + sense) % len(every) * n, left)
    rows, columns = pairs[0].ravel(), pairs[1][:, opposite].ravel()
    graph = coo_array((np.ones(rows.size), (rows, columns)), shape=(n * len(every),) * 2)
    labels = connected_components(graph, directed=False)[1]
    return np.asarray(np.unique(labels, return_inverse=True)[1])


def _turned(x: Floats, geometry: Geometry, cyclic: Cyclic, j: int) -> Floats:
    """Points (n, 3) of sector 0, in the unit of the file, in sector j."""
    point = np.pad(np.array(cyclic.point), (0, 3 - geometry.dimension)) / geometry.scale
    return np.asarray(point + sector_turn(cyclic, j).apply(x - point))


def _nodes_below(file: MeshFile, name: str, dimension: int) -> Ints:
    """The nodes of a group of facets, edges or nodes."""
    found = [file.node_groups.get(name, np.empty(0, dtype=np.int64))]
    for block in file.blocks:
        if block.shape.dimension < dimension and name in block.groups:
            found.append(block.nodes[block.groups[name]].ravel())
    return np.unique(np.concatenate(found))


def _part(geometry: Geometry, path: Path, before: str) -> Geometry:
    """What the geometry says of one file, with the names of groups in this file."""
    others = tuple(f"{file.stem}." for file in geometry.also)

    def names(given: tuple[str, ...]) -> tuple[str, ...]:
        if before:
            return tuple(name.removeprefix(before) for name in given if name.startswith(before))
        return tuple(name for name in given if not name.startswith(others))

    apart = tuple(pair for pair in map(names, geometry.apart) if len(pair) == 2)
    glue, near = geometry.glue, geometry.meshing.near or ()
    near = tuple(replace(one, group=names((one.group,))[0]) for one in near if names((one.group,)))
    if isinstance(glue, tuple):
        glue = tuple(filter(None, map(names, glue)))
    found = replace(geometry, mesh=path, also=(), glue=glue, apart=apart)
    found = replace(found, meshing=replace(geometry.meshing, near=near))
    if not found.has_mesh:
        found = replace(found, scale=1.0)
    return replace(found, cells=None, parameters={}) if before else found


def _named(file: MeshFile, before: str, dimension: int) -> MeshFile:
    """The file with its solid and its groups only, whose names begin with the text `before`."""
    solid = any("solid" in block.groups for block in file.blocks)
    blocks = []
    for block in file.blocks:
        if block.shape.dimension == dimension:
            kept = block.groups.get("solid", np.full(len(block.nodes), not solid))
            groups = {name: marks[kept] for name, marks in block.groups.items() if name != "solid"}
            block = replace(block, nodes=block.nodes[kept], groups=groups)
            if before:
                groups[""] = np.ones(len(block.nodes), dtype=bool)
        elif not block.groups:
            continue
        groups = {(before + name).rstrip("."): marks for name, marks in block.groups.items()}
        blocks.append(replace(block, groups=groups))
    sets = {before + name: nodes for name, nodes in file.node_groups.items()}
    return replace(file, blocks=tuple(blocks), node_groups=sets)


def _check_names(geometry: Geometry, files: Sequence[MeshFile]) -> None:
    """Check that each group is in one file.

    Raises:
        SceneError: groups of two files have one name.
    """
    taken = set[str]()
    for path, file in zip(geometry.files, files, strict=True):
        own = {name for block in file.blocks for name in block.groups} | file.node_groups.keys()
        if both := sorted(taken & own):
            reason = f"has a group of the name {both[0]}, which another file has; rename the file"
            raise refuse(path, reason, ErrorKind.MESH, "geometry.also")
        taken |= own


def _together(files: Sequence[MeshFile]) -> MeshFile:
    """Several meshes, which share no node, as one; node sets of one name become one set."""
    starts = np.cumsum([0, *(len(file.points) for file in files[:-1])])
    blocks, sets = [], defaultdict[str, list[Ints]](list)
    for start, file in zip(starts, files, strict=True):
        blocks += [replace(block, nodes=block.nodes + start) for block in file.blocks]
        for name, nodes in file.node_groups.items():
            sets[name].append(nodes + start)
    points = np.concatenate([file.points for file in files])
    groups = {name: np.concatenate(nodes) for name, nodes in sets.items()}
    return MeshFile(points, tuple(blocks), groups)

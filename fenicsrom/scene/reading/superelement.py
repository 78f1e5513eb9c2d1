"""Scenes of a superelement: interface nodes instead of a mesh and a material.

Such a scene has the tables [superelement] and [[nodes]] beside the usual ones. Loads, contacts, the
probe and supports name interface nodes by `group`, `node` or `nearest`. The matrices hold the
shape, the material and the supports of the body.
"""

import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

from fenicsrom.errors import ErrorKind, refuse
from fenicsrom.scene.base import rules
from fenicsrom.scene.base.rules import Problem, Problems, Where, choice, integer, list_of, number
from fenicsrom.scene.base.tables import read_table, require_none, tables_of
from fenicsrom.scene.keys.schema import Scene
from fenicsrom.scene.reading.reading import parse_scene, read_toml

LARGEST_NUMBER = 2_000_000_000
"""Largest number of a coordinate or of a node."""

EXCLUDED = (
    "geometry material materials attachments bolts ties rotation basis reference compare campbell "
    "map statics"
).split()
"""Tables that describe a body with a mesh, or that need the matrices of the body at every speed."""

SUPPORTED = "supports of the superelement"
"""Name of the support of a superelement whose matrices are clamped already."""


@dataclass(frozen=True, kw_only=True)
class Superelement:
    """The table [superelement].

    Attributes:
        dimension: dimension of space.
        mass_damping: factor α of the damping matrix α M, added to the damping in the file.
    """

    dimension: Annotated[int, choice(2, 3)]
    mass_damping: Annotated[float, number(least=0.0, unit="1/s")] = 0.0


_COORDINATES = list_of(integer(0, LARGEST_NUMBER), least=0, distinct=False)


@dataclass(frozen=True, kw_only=True)
class InterfaceNode:
    """A table [[nodes]]: a point of the body that loads, contacts and the probe can name.

    Attributes:
        name: name of the node; several nodes may share a name, and form a region.
        position: place of the node on the undeformed body.
        coordinates: numbers, from 1, of the coordinates that move the node along the axes; 0 stands
            for an axis along which the node does not move. If the file has a matrix of interface
            rows, these are the numbers of the rows.
        grid: number of the node in a file that names its coordinates by node and direction.
        offset: displacement of the node at rest.
        area: area, length or number of nodes that the node stands for in a contact with
            at = "nodes", in the units of the scene.
    """

    name: Annotated[str, rules.name]
    position: Annotated[tuple[float, ...], rules.point]
    coordinates: Annotated[tuple[int, ...] | None, _COORDINATES] = None
    grid: Annotated[int | None, integer(1, LARGEST_NUMBER)] = None
    offset: Annotated[tuple[float, ...] | None, rules.point] = None
    area: Annotated[float, number(above=0.0)] = 1.0


@dataclass(frozen=True, kw_only=True)
class _Nodes:
    """The list of the interface nodes.

    Attributes:
        nodes: the nodes.
    """

    nodes: Annotated[tuple[InterfaceNode, ...], tables_of(InterfaceNode, least=1)]


@dataclass(frozen=True)
class SuperelementScene:
    """A scene of a superelement.

    Attributes:
        scene: the scene. Its geometry names the file of the matrices, and its material holds the
            damping; the other values of both are 1 or 0, and nothing reads them.
        nodes: the interface nodes.
        clamped: whether the scene clamps interface nodes.
    """

    scene: Scene
    nodes: tuple[InterfaceNode, ...]
    clamped: bool


def read_superelement_scene(path: str | os.PathLike[str], matrices: Path) -> SuperelementScene:
    """Read a scene of a superelement from a TOML file.

    Args:
        path: the file.
        matrices: the file of the matrices.

    Raises:
        SceneError: the file cannot be read, or does not describe such a scene.
    """
    return parse_superelement_scene(
        read_toml(os.fspath(path)), os.fspath(path), Path(path).parent, matrices
    )


def parse_superelement_scene(
    table: Mapping[str, Any], source: str, folder: Path, matrices: Path
) -> SuperelementScene:
    """Make a scene of a superelement from plain data.

    Args:
        table: the data.
        source: name of the data in messages.
        folder: folder to which the paths of tables are relative.
        matrices: the file of the matrices.

    Raises:
        SceneError: a key or value is not allowed.
    """
    where = Where(source)
    allowed = "not allowed in the scene of a superelement"
    require_none((Problem(name, allowed) for name in EXCLUDED if name in table), table, where)
    body = read_table(Superelement, table.get("superelement", {}), where.at("superelement"))
    nodes = read_table(_Nodes, {"nodes": table.get("nodes", [])}, where).nodes
    for index, node in enumerate(nodes):
        place = where.at("nodes").at(index)
        require_none(_node_problems(node, body.dimension), node, place)
        if (node.coordinates is None) == (node.grid is None):
            reason = "one of coordinates and grid must be given"
            raise refuse(source, reason, ErrorKind.CONFLICT, f"{place.key}.coordinates")
    rest = {key: value for key, value in table.items() if key not in ("superelement", "nodes")}
    geometry: dict[str, Any] = {"mesh": matrices.name, "dimension": body.dimension}
    if body.dimension == 2:
        geometry["thickness"] = 1.0
    material = {"young": 1.0, "poisson": 0.0, "density": 1.0, "mass_damping": body.mass_damping}
    clamped = "supports" in rest
    full = {
        "supports": [{"group": SUPPORTED}],
        **rest,
        "geometry": geometry,
        "material": material,
        "geometrically_nonlinear": False,
    }
    scene = parse_scene(full, source, folder, mesh=False)
    require_none(_problems(scene), scene, where)
    return SuperelementScene(scene, nodes, clamped)


def _problems(scene: Scene) -> Problems:
    """Yield what a superelement cannot do."""
    for k, load in enumerate(scene.loads):
        if load.kind != "force":
            yield Problem(f"loads[{k}].{load.kind}", "must be a force on interface nodes")
    for k, contact in enumerate(scene.contacts):
        if contact.against is not None:
            allowed = "not allowed in the scene of a superelement, which is one body"
            yield Problem(f"contacts[{k}].against", allowed)
    for k, support in enumerate(scene.supports):
        for name in ("components", "normal"):
            if getattr(support, name) is not None:
                allowed = "not allowed in the scene of a superelement, whose nodes are clamped"
                yield Problem(f"supports[{k}].{name}", allowed)
    if scene.output.stresses != "none":
        yield Problem("output.stresses", 'must be "none"')


def _node_problems(node: InterfaceNode, dimension: int) -> Problems:
    """Yield lists of a node with another length, and coordinates that occur twice."""
    for key in ("position", "coordinates", "offset"):
        value = getattr(node, key)
        if value is not None and len(value) != dimension:
            allowed = f"must have {dimension} entries with superelement.dimension = {dimension}"
            yield Problem(key, allowed)
    coordinates = node.coordinates or ()
    for index, entry in enumerate(coordinates):
        if entry and entry in coordinates[:index]:
            allowed = "must occur only once in the list"
            yield Problem(f"coordinates[{index}]", allowed, ErrorKind.RANGE)

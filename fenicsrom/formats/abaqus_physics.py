"""Materials, supports, point masses, springs and static loads of an Abaqus or CalculiX file."""

from collections import defaultdict
from dataclasses import dataclass, field, replace

import numpy as np

from fenicsrom.formats import abaqus_joints
from fenicsrom.formats.abaqus_couplings import KEYWORDS, Reader
from fenicsrom.formats.abaqus_sets import Keyword, Resolver, by_block, fields
from fenicsrom.formats.cells import faces
from fenicsrom.formats.collector import Collector
from fenicsrom.formats.mesh_file import Block, DeckLoad, Ints, MeshFile, axes_of
from fenicsrom.formats.reasons import said
from fenicsrom.words import counted

TAKEN_ELEMENTS = ("MASS", "SPRING1")
"""Elements that are no cells, but masses and springs."""

TYPED = {
    "ENCASTRE": set(range(6)),
    "PINNED": {0, 1, 2},
    "XSYMM": {0, 4, 5},
    "YSYMM": {1, 3, 5},
    "ZSYMM": {2, 3, 4},
    "XASYMM": {1, 2, 3},
    "YASYMM": {0, 2, 4},
    "ZASYMM": {0, 1, 5},
}
"""Components (0 to 5) that the names of boundary conditions hold."""

LOADS = ("CLOAD", "DLOAD", "DSLOAD")

MATERIAL_DATA = ("ELASTIC", "DENSITY", "HYPERELASTIC", "HYPERFOAM", "USER MATERIAL")

OF_PLANE = ("SHELL SECTION", "MEMBRANE SECTION")
"""Sections with a thickness, of a plane body."""

FIRST = ("ELEMENT", "TRANSFORM")
"""Keywords to which others refer, also from above."""


@dataclass(eq=False)
class _State:
    """What is known between two keywords.

    Attributes:
        found: what was collected.
        nodes: finds nodes.
        cells: finds elements.
        mesh: the mesh.
        starts: index of the first element of each block, and the number of all elements.
        points: finds mass and spring elements, as indices in `at`.
        at: the node of each of them.
        gravity: the cells under each acceleration (3,).
        materials: the spelling of each material by its name in capitals.
        material: name of the material whose data follow.
        couplings: reads what couples nodes.
        joints: reads what joins surfaces.
        solids: indices of the cells of the body.
        renewed: whether the first step has forgotten the supports before it.
        step: number of the step, 0 before the first one.
        static: whether it is a linear or nonlinear static step.
        turning: whether its pressures turn with the body.
        is_plane: whether the body is plane.
        unread: keywords that are not read, in their order.
    """

    found: Collector
    nodes: Resolver
    cells: Resolver
    mesh: MeshFile
    starts: Ints
    couplings: Reader
    joints: abaqus_joints.Reader
    solids: Ints
    points: Resolver
    at: list[int] = field(default_factory=list)
    gravity: dict[tuple[float, ...], list[int]] = field(default_factory=lambda: defaultdict(list))
    materials: dict[str, str] = field(default_factory=dict)
    material: str = ""
    renewed: bool = False
    step: int = 0
    static: bool = False
    turning: bool = False
    is_plane: bool = False
    unread: dict[str, None] = field(default_factory=dict)


def with_physics(
    mesh: MeshFile,
    keywords: list[tuple[Keyword, tuple[str, ...]]],
    nodes: Resolver,
    cells: Resolver,
) -> tuple[MeshFile, tuple[str, ...]]:
    """Add what the file says besides its mesh.

    Args:
        mesh: the mesh.
        keywords: the keywords that say more, each with the instances of the part in which it
            stands.
        nodes: finds nodes.
        cells: finds elements.

    Returns:
        The mesh with its physics, and the keywords that are not read.

    Raises:
        SceneError: a set is missing.
    """
    starts = np.cumsum(
        [0] + [len(block.nodes) for block in mesh.blocks if block.labels is not None]
    )
    found = Collector()
    couplings = Reader(found.couplings, mesh.points)
    solid = max((block.shape.dimension for block in mesh.blocks), default=0)
    dimensions = [
        np.full(len(block.nodes), block.shape.dimension)
        for block in mesh.blocks
        if block.labels is not None
    ]
    solids = np.flatnonzero(np.concatenate([np.empty(0), *dimensions]) == solid)
    joints, points = abaqus_joints.Reader(found), replace(cells, numbers={})
    state = _State(found, nodes, cells, mesh, starts, couplings, joints, solids, points)
    state.is_plane = solid == 2
    for block in mesh.blocks:
        state.found.strain |= block.name.startswith("CPE")
    for keyword, _ in keywords:
        if keyword.name == "MATERIAL":
            material = keyword.parameters.get("NAME", "")
            state.materials.setdefault(material.upper(), material)
    for keyword, scope in sorted(keywords, key=lambda given: given[0].name not in FIRST):
        rows = [fields(line) for line in keyword.lines]
        one_by_one = keyword.name in ("BOUNDARY", "MPC", *LOADS)
        for part in [[row] for row in rows] if one_by_one else [rows]:
            try:
                taken = _take(state, keyword, part, scope)
            except (ValueError, IndexError, KeyError):
                shown = ", ".join(part[0] if part else ())
                is_support = keyword.name == "BOUNDARY"
                state.found.leave(f"*{keyword.name}: {shown!r} cannot be read", is_support)
                continue
            if not taken:
                state.unread[said(f"*{keyword.name}", keyword.name)] = None
    found.joints = joints.finished()
    _pull(state)
    return found.finished(mesh), tuple(state.unread)


def _take(state: _State, keyword: Keyword, rows: list[list[str]], scope: tuple[str, ...]) -> bool:
    """Take what a keyword, or one row of it, says; whether it was understood."""
    name = keyword.name
    if name == "STEP":
        state.step, state.static = state.step + 1, False
        state.turning = keyword.parameters.get("NLGEOM", "NO").upper() != "NO"
    elif name == "STATIC":
        state.static = True
    elif name == "MATERIAL":
        state.material = state.materials[keyword.parameters.get("NAME", "").upper()]
    elif name in MATERIAL_DATA and rows:
        return _material(state, keyword, rows)
    elif name == "SOLID SECTION" or (name in OF_PLANE and state.is_plane):
        _section(state, keyword, rows, scope)
    elif name == "BOUNDARY":
        _boundary(state, keyword, rows[0], scope)
    elif name == "TRANSFORM":
        of = state.nodes.found(scope, keyword.parameters.get("NSET", ""))
        state.found.turned |= set(of.tolist())
    elif name in KEYWORDS:
        return state.couplings.take(keyword, rows, lambda text: _nodes_of(state, text, scope))
    elif name in abaqus_joints.KEYWORDS:
        return state.joints.take(
            keyword,
            rows,
            group_of=lambda text: _group_of(state, text),
            nodes_of=lambda text: _nodes_of(state, text, scope),
        )
    elif name == "ELEMENT":
        if keyword.parameters.get("TYPE", "").upper() in TAKEN_ELEMENTS:
            for instance in scope:
                known = state.points.numbers.setdefault(instance, {})
                for label, text, *_ in rows:
                    for node in state.nodes.found((instance,), text).tolist():
                        known[int(label)] = len(state.at)
                        state.at.append(node)
    elif name == "MASS":
        for node in _points_of(state, keyword, scope):
            state.found.masses[node] += float(rows[0][0])
    elif name == "SPRING":
        _springs(state, keyword, rows, scope)
    elif name in LOADS:
        if not (state.static and state.step == 1):
            state.found.leave(f"*{name} of a step that is not static, or not the first one")
        else:
            _load(state, keyword, rows[0], scope)
    else:
        return name in ("END STEP", "ELEMENT")
    return True


def _material(state: _State, keyword: Keyword, rows: list[list[str]]) -> bool:
    constants = state.found.constants[state.material]
    if keyword.name == "DENSITY":
        constants["rho"] = float(rows[0][0])
        return True
    kind = keyword.parameters.get("TYPE", "ISO").upper()
    if keyword.name != "ELASTIC" or kind[:3] != "ISO":
        return False
    constants["E"], constants["nu"] = float(rows[0][0]), float(rows[0][1])
    if len(rows) > 1:
        state.found.leave(f"the temperatures of the material {state.material} after the first one")
    return True


def _points_of(state: _State, keyword: Keyword, scope: tuple[str, ...]) -> list[int]:
    """The nodes of the mass or spring elements of a keyword.

    Raises:
        SceneError: there is no such set.
    """
    return [state.at[k] for k in state.points.found(scope, keyword.parameters.get("ELSET", ""))]


def _springs(
    state: _State, keyword: Keyword, rows: list[list[str]], scope: tuple[str, ...]
) -> None:
    """Take the stiffness of elements SPRING1; other springs are named as elements."""
    own = _points_of(state, keyword, scope)
    if own and ({"NONLINEAR", "ORIENTATION"} & set(keyword.parameters) or int(rows[0][0]) > 3):
        state.found.leave("*SPRING that is nonlinear, oriented or rotational")
        return
    for node in own:
        state.found.springs[node, int(rows[0][0]) - 1] += float(rows[1][0])


def _nodes_of(state: _State, text: str, scope: tuple[str, ...]) -> Ints:
    """The nodes of a number, a set or a surface.

    Raises:
        SceneError: there is no such set.
    """
    if (name := _surface(state, text)) is None:
        return state.nodes.found(scope, text)
    rows = [block.nodes[block.groups[name]].ravel() for block in _facets(state, name)]
    return np.unique(np.concatenate(rows))


def _facets(state: _State, name: str) -> list[Block]:
    """The blocks of facets of an element-based surface."""
    blocks = [block for block in state.mesh.blocks if block.labels is None]
    return [block for block in blocks if name in block.groups]


def _surface(state: _State, text: str) -> str | None:
    """The group of an element-based surface, which data lines may call "instance.surface"."""
    every = {name for b in state.mesh.blocks if b.labels is None for name in b.groups}
    for wanted in (text, text.rpartition(".")[2]):
        for name in every:
            if name.upper() == wanted.upper():
                return name
    return None


def _group_of(state: _State, text: str) -> str | None:
    """The group of a surface of elements, or of nodes."""
    found = _surface(state, text)
    names = [text.upper(), text.rpartition(".")[2].upper()]
    nodes = {group.upper(): group for group in state.mesh.node_groups}
    return found or next((nodes[name] for name in names if name in nodes), None)


def _section(
    state: _State, keyword: Keyword, rows: list[list[str]], scope: tuple[str, ...]
) -> None:
    chosen = state.cells.found(scope, keyword.parameters.get("ELSET", ""))
    name = keyword.parameters.get("MATERIAL", "")
    marks = state.found.cells_of(state.materials.get(name.upper(), name), state.mesh)
    for mark, of in zip(marks, by_block(chosen, state.starts), strict=False):
        mark[of] = True
    if rows and rows[0]:
        thickness = float(rows[0][0])
        if state.found.thickness not in (None, thickness):
            state.found.leave(f"the thickness {thickness:g} of a second section")
        state.found.thickness = state.found.thickness or thickness


def _boundary(state: _State, keyword: Keyword, row: list[str], scope: tuple[str, ...]) -> None:
    if state.step > 1:
        state.found.leave("*BOUNDARY of the second and later steps", True)
        return
    if state.step == 1 and keyword.parameters.get("OP", "").upper() == "NEW" and not state.renewed:
        state.found.release()
        state.renewed = True
    if _tensioned(state, row[0], scope):
        return  # keeps the length of the bolt
    nodes = state.nodes.found(scope, row[0])
    if row[1].upper() in TYPED:
        components = TYPED[row[1].upper()]
    else:
        first = int(row[1])
        last = int(row[2]) if len(row) > 2 and row[2] else first
        components = set(range(first - 1, last))
        if len(row) > 3 and float(row[3] or 0.0):
            state.found.leave(f"*BOUNDARY: the displacement {row[3]} of {row[0]}", True)
            return
    name = row[0].rpartition(".")[2]
    if name.isdigit():
        name = f"boundary {axes_of(components)}".strip()
    known = (group for group in state.mesh.node_groups if group.upper() == name.upper())
    state.found.hold(next(known, name), nodes.tolist(), components)


def _pull(state: _State) -> None:
    """Take gravity, which each set of cells may have by itself."""
    for vector, pulled in state.gravity.items():
        state.found.others.append(DeckLoad("acceleration", vector))
        if free := len(np.setdiff1d(state.solids, pulled)):
            shown = ", ".join(f"{x:g}" for x in vector)
            without = counted(free, "cell")
            what = f"the gravity ({shown}) of a part of the body, {without} of which lie outside it"
            state.found.leave(f"{what}: it acts on the whole body")


def _tensioned(state: _State, text: str, scope: tuple[str, ...]) -> str | None:
    """The surface of the pre-tension section whose node a data line names."""
    known = state.joints.tensioned
    nodes = state.nodes.found(scope, text).tolist() if known else []
    return next((known[node] for node in nodes if node in known), None)


def _load(state: _State, keyword: Keyword, row: list[str], scope: tuple[str, ...]) -> None:
    name, found, kind = keyword.name, state.found, row[1].upper()
    if surface := _tensioned(state, row[0], scope):
        what = f"the pre-tension {row[2]} of the section {surface}, which cuts a meshed bolt"
        found.leave(f"{what}; give [[bolts]] with the faces under its head and nut")
        return
    if "AMPLITUDE" in keyword.parameters:
        found.leave(f"the amplitude of *{name}: the load is static, with the factor 1")
    if "FOLLOWER" in keyword.parameters and name == "CLOAD":
        found.leave("*CLOAD, FOLLOWER: the force keeps its direction")
    if kind[:1] == "P" and state.turning:
        found.leave("NLGEOM of pressures, which keep their direction without follower = true")
    if name == "CLOAD":
        nodes = state.nodes.found(scope, row[0]).tolist()
        if int(kind) > 3:
            found.leave(f"*CLOAD: the moment {row[2]} at {row[0]}")
        elif turned := found.turned & set(nodes):
            found.leave(f"*CLOAD at {counted(len(turned), 'node')} with axes of *TRANSFORM")
        else:
            for node in nodes:
                found.forces[node][int(kind) - 1] += float(row[2])
    elif name == "DLOAD" and kind == "GRAV":
        direction = np.array([float(word) for word in row[3:6]])
        vector = float(row[2]) * direction / np.linalg.norm(direction)
        pulled = state.cells.found(scope, row[0]) if row[0] else state.solids
        state.gravity[tuple(vector.tolist())] += pulled.tolist()
    elif name == "DLOAD" and kind[:1] == "P" and kind[1:].isdigit():
        chosen = by_block(state.cells.found(scope, row[0]), state.starts)
        blocks = [block for block in state.mesh.blocks if block.labels is not None]
        members = [
            np.isin(np.arange(len(block.nodes)), of)
            for block, of in zip(blocks, chosen, strict=True)
        ]
        if pressed := faces(blocks, members, int(kind[1:]) - 1):
            found.pressures[float(row[2])] += pressed
        else:
            found.leave(f"*{name} {', '.join(row[:2])}: the elements have no such face")
    elif name == "DSLOAD" and kind == "P" and (surface := _surface(state, row[0])):
        found.others.append(DeckLoad("pressure", (float(row[2]),), group=surface))
    else:
        found.leave(said(f"*{name} {', '.join(row[:2])}", f"{name} {kind}"))

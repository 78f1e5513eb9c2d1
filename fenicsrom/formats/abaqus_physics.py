"""Materials, supports, point masses, springs and static loads of an Abaqus or CalculiX file."""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass, field

import numpy as np

from fenicsrom.formats.abaqus_keywords import Keyword, fields
from fenicsrom.formats.abaqus_sets import Resolver, by_block
from fenicsrom.formats.collector import Collector
from fenicsrom.formats.mesh_file import DeckLoad, Ints, MeshFile, axes_of

TAKEN_ELEMENTS = ("MASS", "SPRING1")
"""Elements that are no cells, but masses and springs."""

TYPED = {
    "ENCASTRE": {0, 1, 2},
    "PINNED": {0, 1, 2},
    "XSYMM": {0},
    "YSYMM": {1},
    "ZSYMM": {2},
}
"""Components that the names of boundary conditions hold at a solid."""

LOADS = ("CLOAD", "DLOAD", "DSLOAD")

MATERIAL_DATA = ("ELASTIC", "DENSITY")


@dataclass(eq=False)
class _State:
    """What is known between two keywords.

    Attributes:
        found: what was collected.
        nodes: finds nodes.
        cells: finds elements.
        mesh: the mesh.
        starts: index of the first element of each block, and the number of all elements.
        points: nodes of the mass and spring elements of each set.
        material: name of the material whose data follow.
        step: number of the step, 0 before the first one.
        static: whether it is a linear or nonlinear static step.
        unread: keywords that are not read, in their order.
    """

    found: Collector
    nodes: Resolver
    cells: Resolver
    mesh: MeshFile
    starts: Ints
    points: dict[str, list[Ints]] = field(default_factory=lambda: defaultdict(list))
    material: str = ""
    step: int = 0
    static: bool = False
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
    state = _State(Collector(), nodes, cells, mesh, starts)
    for keyword, scope in sorted(keywords, key=lambda given: given[0].name != "ELEMENT"):
        try:
            taken = _take(state, keyword, scope)
        except (ValueError, IndexError):
            state.found.leave(f"*{keyword.name}: {', '.join(keyword.lines[:1])!r} cannot be read")
            taken = True
        if not taken:
            state.unread[f"*{keyword.name}"] = None
    return state.found.finished(mesh), tuple(state.unread)


def _take(state: _State, keyword: Keyword, scope: tuple[str, ...]) -> bool:
    """Take what a keyword says; whether it was understood."""
    name, rows = keyword.name, [fields(line) for line in keyword.lines]
    if name == "STEP":
        state.step, state.static = state.step + 1, False
    elif name == "STATIC":
        state.static = True
    elif name == "MATERIAL":
        state.material = keyword.parameters.get("NAME", "")
    elif name in MATERIAL_DATA and rows:
        return _material(state, keyword, rows)
    elif name == "SOLID SECTION":
        _section(state, keyword, scope)
    elif name == "BOUNDARY":
        _boundary(state, keyword, rows, scope)
    elif name == "ELEMENT":
        if keyword.parameters.get("TYPE", "").upper() in TAKEN_ELEMENTS:
            at = [state.nodes.found(scope, row[1]) for row in rows]
            state.points[keyword.parameters.get("ELSET", "").upper()] += at
    elif name == "MASS":
        for nodes in state.points[keyword.parameters.get("ELSET", "").upper()]:
            for node in nodes:
                state.found.masses[int(node)] += float(rows[0][0])
    elif name == "SPRING":
        _springs(state, keyword, rows)
    elif name in LOADS:
        if not (state.static and state.step == 1):
            state.found.leave(f"*{name} of a step that is not static, or not the first one")
        else:
            _load(state, name, rows, scope)
    else:
        return name in ("END STEP", "ELEMENT")
    return True


def _material(state: _State, keyword: Keyword, rows: list[list[str]]) -> bool:
    constants = state.found.constants[state.material]
    if keyword.name == "DENSITY":
        constants["rho"] = float(rows[0][0])
        return True
    if keyword.parameters.get("TYPE", "ISO").upper()[:3] != "ISO":
        return False
    constants["E"], constants["nu"] = float(rows[0][0]), float(rows[0][1])
    if len(rows) > 1:
        state.found.leave(f"the temperatures of the material {state.material} after the first one")
    return True


def _springs(state: _State, keyword: Keyword, rows: list[list[str]]) -> None:
    """Take the stiffness of elements SPRING1; other springs are named as elements."""
    own = state.points[keyword.parameters.get("ELSET", "").upper()]
    if own and ({"NONLINEAR", "ORIENTATION"} & set(keyword.parameters) or int(rows[0][0]) > 3):
        state.found.leave("*SPRING that is nonlinear, oriented or rotational")
        return
    for nodes in own:
        for node in nodes:
            state.found.springs[int(node), int(rows[0][0]) - 1] += float(rows[1][0])


def _section(state: _State, keyword: Keyword, scope: tuple[str, ...]) -> None:
    chosen = state.cells.found(scope, keyword.parameters.get("ELSET", ""))
    name = keyword.parameters.get("MATERIAL", "")
    known = next((k for k in state.found.constants if k.upper() == name.upper()), name)
    marks = state.found.cells_of(known, state.mesh)
    for mark, of in zip(marks, by_block(chosen, state.starts), strict=False):
        mark[of] = True


def _boundary(
    state: _State, keyword: Keyword, rows: list[list[str]], scope: tuple[str, ...]
) -> None:
    if state.step > 1:
        state.found.leave("*BOUNDARY of the second and later steps")
        return
    for row in rows:
        nodes = state.nodes.found(scope, row[0])
        if row[1].upper() in TYPED:
            components = TYPED[row[1].upper()]
        else:
            first = int(row[1])
            last = int(row[2]) if len(row) > 2 and row[2] else first
            components = set(range(first - 1, last))
            if len(row) > 3 and float(row[3] or 0.0):
                state.found.leave(f"*BOUNDARY: the displacement {row[3]} of {row[0]}")
                continue
        name = row[0].rpartition(".")[2]
        if row[0].isdigit():
            name = f"boundary {axes_of(components)}"
        state.found.hold(name, nodes, components)


def _load(state: _State, name: str, rows: list[list[str]], scope: tuple[str, ...]) -> None:
    for row in rows:
        if name == "CLOAD":
            for node in state.nodes.found(scope, row[0]):
                if 1 <= int(row[1]) <= 3:
                    state.found.forces[int(node)][int(row[1]) - 1] += float(row[2])
        elif name == "DLOAD" and row[1].upper() == "GRAV":
            direction = np.array([float(word) for word in row[3:6]])
            vector = float(row[2]) * direction / np.linalg.norm(direction)
            state.found.others.append(DeckLoad("acceleration", tuple(vector.tolist())))
        elif name == "DSLOAD" and row[1].upper() == "P":
            state.found.others.append(DeckLoad("pressure", (float(row[2]),), group=row[0]))
        else:
            state.found.leave(f"*{name} {', '.join(row[:2])}")

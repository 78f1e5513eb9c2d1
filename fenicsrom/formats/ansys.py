"""ANSYS archives (.cdb): NBLOCK, EBLOCK and CMBLOCK, as CDWRITE writes them.

Other commands are listed as not read.
"""

import re
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from fenicsrom.errors import refuse
from fenicsrom.formats.cells import with_middles
from fenicsrom.formats.collector import Collector, numbers_between, read_lines
from fenicsrom.formats.mesh_file import (
    NEVER_SLIPS,
    Block,
    DeckJoint,
    DeckLoad,
    Ints,
    MeshFile,
    axes_of,
)
from fenicsrom.formats.reasons import said
from fenicsrom.formats.shapes import from_vtk
from fenicsrom.words import counted

SOLIDS = {45, 185, 64, 95, 186, 92, 187, 285, 72, 73, 5, 62}
"""Numbers of element types that are solids with 4 to 20 nodes."""

TETRAHEDRA = {72, 92, 187, 285}
"""Numbers of the solids that have 4 or 10 nodes; the others have 8 or 20."""

PLANES = {42, 182, 82, 183, 2, 25, 63, 181, 281, 93, 43, 143, 152, 154, 200}
"""Numbers of element types with the nodes of a plane cell or of a facet."""

PLANE_SOLIDS = {2, 42, 82, 182, 183}
"""Those of PLANES whose KEYOPT(3) says what is plane, and whose first real constant may be the
thickness."""

CONTACT = range(169, 179)
"""Numbers of element types of contact pairs, by which remote points act as well."""

SURFACES = {170: "target", 173: "contact", 174: "contact"}
"""Element types on the two surfaces of a contact pair, which one set of real constants joins."""

BONDED, ROUGH, NO_SEPARATION = {3, 5, 6}, {1}, {2, 4}
"""KEYOPT(12) of contacts that are tied, that never slip, and that never part."""

CONSTANTS = {
    "EX": "E",
    "EY": "Ey",
    "EZ": "Ez",
    "NUXY": "nu",
    "PRXY": "nu",
    "DENS": "rho",
    "MU": "mu",
}
"""Constants by the names of MP."""

COMPONENTS = {name: k for k, name in enumerate(("UX", "UY", "UZ", "ROTX", "ROTY", "ROTZ"))}
"""Components (0 to 5) by their labels."""

SILENT = re.compile(
    r"/|!|\*|NUMOFF|ET(BLOCK)?,|N,R5|SHPP|EXTOPT|FINISH|KEYOPT?,|ERESX|TYPE|MAT,|REAL|ESYS|SECNUM|"
    r"TSHAP|MPTEMP|DOF,|TOFFST|EBLOCK|NBLOCK|CMBLOCK|CM,|-1|ANTYPE|OUTRES|TIME|KUSE|LSWRITE|ALLSEL|\(|"
    r"AUTOTS|NSUBST|CMGRP|MOD(OPT|CONTROL)|QRDOPT|EQSLV|NCNV|NEQIT|CRPLIM|MXPAND|LUMPM|SOLVE|ESEL|EN,",
    flags=re.I,
)
"""Lines that are read, or that have no effect on the physics."""


@dataclass(eq=False)
class Archive:
    """The content of a file.

    Attributes:
        path: the file.
        types: number of the element type of each type in the file, such as 186.
        nodes: coordinates of each node by its number.
        elements: number, type in the file, and nodes of each element.
        components: kind (NODE or ELEM) and numbers of each component by its name.
        other: number of the commands that are not read.
        materials: number of the material of each element.
        reals: set of real constants of each element.
        constants: constants of each material by its number.
        real_constants: real constants of each set.
        real: those of the last command R, which RMORE continues.
        options: the options KEYOPT of each type in the file, by their numbers.
        physics: supports and loads, by the numbers of the nodes.
        turned: nodes with axes of their own.
        equations: terms of each constraint equation: number of the node, component, factor.
    """

    path: Path
    types: dict[int, int] = field(default_factory=dict)
    nodes: dict[int, tuple[float, ...]] = field(default_factory=dict)
    elements: list[tuple[int, int, list[int]]] = field(default_factory=list)
    components: dict[str, tuple[str, list[int]]] = field(default_factory=dict)
    other: Counter[str] = field(default_factory=Counter)
    materials: dict[int, int] = field(default_factory=dict)
    reals: dict[int, int] = field(default_factory=dict)
    constants: dict[int, dict[str, float]] = field(default_factory=dict)
    real_constants: dict[int, list[float]] = field(default_factory=dict)
    real: list[float] = field(default_factory=list)
    options: dict[int, dict[int, int]] = field(default_factory=dict)
    physics: list[tuple[str, int, str, float]] = field(default_factory=list)
    acceleration: tuple[float, ...] = (0.0, 0.0, 0.0)
    turned: list[int] = field(default_factory=list)
    equations: list[list[tuple[int, str, float]]] = field(default_factory=list)


def read_ansys(path: Path) -> MeshFile:
    """Read an archive.

    Raises:
        SceneError: the file is damaged, or has no blocks of nodes and elements.
    """
    archive, lines = Archive(path), iter(read_lines(path))
    for line in lines:
        _read(archive, line.strip(), lines)
    if not archive.nodes or not archive.elements:
        raise refuse(path, "the file has no NBLOCK and EBLOCK; write it with CDWRITE,DB")
    return _mesh(path, archive)


def _read(archive: Archive, line: str, lines: Iterator[str]) -> None:
    """Read one command and its block."""
    words = [word.strip() for word in line.split(",")]
    command = words[0].upper()
    if command == "NBLOCK":
        _nodes(archive, lines)
    elif command == "EBLOCK" and words[2:3] and words[2].upper() == "SOLID":
        _elements(archive, lines)
    elif command == "EBLOCK":
        reason = "only EBLOCK,19,SOLID is supported; write the file with CDWRITE,DB"
        raise refuse(archive.path, f"{line}: {reason}")
    elif command == "CMBLOCK":
        widths = _widths(next(lines))
        members: list[int] = []
        while len(members) < int(words[3].split("!")[0]):
            members += map(int, _cut(next(lines), widths))
        archive.components[words[1]] = (words[2].upper(), _expanded(members))
    elif command == "ET":
        archive.types[int(words[1])] = int(re.sub(r"\D", "", words[2]))
        archive.options[int(words[1])] = {k: int(w) for k, w in enumerate(words[3:9], 1) if w}
    elif command == "ETBLOCK":
        widths = _widths(next(lines))
        while (row := [int(word) for word in _cut(next(lines), widths)])[0] > 0:
            archive.types[row[0]] = row[1]
            archive.options[row[0]] = dict(enumerate(row[2:], 1))
    elif command in ("MP", "MPDATA"):
        _material(archive, words)
    elif command == "RLBLOCK":
        next(lines), next(lines)
        for _ in range(int(words[1])):
            row = next(lines).split()
            for _ in range(max(0, -(-(int(row[1]) - 6) // 7))):
                row += next(lines).split()
            archive.real_constants[int(row[0])] = [float(word) for word in row[2:]]
    elif command == "R" and len(words) > 2 and words[1].isdigit():
        archive.real = [float(word or 0.0) for word in words[2:]]
        archive.real_constants[int(words[1])] = archive.real
    elif command == "RMORE":
        archive.real += [0.0] * (-len(archive.real) % 6)
        archive.real += [float(word or 0.0) for word in words[1:]]
    elif command in ("KEYOP", "KEYOPT") and len(words) > 3:
        archive.options.setdefault(int(words[1]), {})[int(words[2])] = int(words[3])
    elif command in ("D", "F") and words[1:2] and words[1].isdigit() and len(words) > 2:
        value = float(words[3]) if len(words) > 3 and words[3] else 0.0
        archive.physics.append((command, int(words[1]), words[2].upper(), value))
    elif command in ("DBLOCK", "FBLOCK"):
        next(lines)
        while match := re.match(r"\s*(\d+)\s*([A-Z]+)\s+(\S+)", next(lines), flags=re.I):
            value = float(match[3].upper().replace("D", "E"))
            archive.physics.append((command[0], int(match[1]), match[2].upper(), value))
    elif command == "CE":
        _equation(archive, words)
    elif command == "TB" and words[2:3] and words[2].isdigit():
        archive.constants.setdefault(int(words[2]), {})
        archive.other[f"TB,{words[1].upper()}"] += 1
    elif command == "ACEL":
        given = [float(word or 0.0) for word in words[1:4]]
        archive.acceleration = (*given, 0.0, 0.0, 0.0)[:3]
    elif command[:1].isalpha() and not SILENT.match(line) and not _is_zero(words):
        archive.other[command] += 1


def _equation(archive: Archive, words: list[str]) -> None:
    """Read CE, number, constant, terms; or CE, R5.0, DEFI and then CE, R5.0, NODE, terms."""
    is_archive = words[1].upper().startswith("R5")
    if not is_archive or words[2].upper().startswith("DEF"):
        archive.equations.append([])
        constant = words[5] if is_archive and len(words) > 5 else words[2]
        if float(constant or 0.0):
            archive.other["CE with a constant"] += 1
    rest = words[3:]
    if is_archive and words[2].upper().startswith("DEF"):
        rest = []
    for node, label, factor in zip(rest[::3], rest[1::3], rest[2::3], strict=False):
        if node and int(node):
            archive.equations[-1].append((int(node), label.upper(), float(factor)))


def _is_zero(words: list[str]) -> bool:
    """Whether a command sets values of zero only, as CDWRITE does for every load there is."""
    numbers = [word for word in words[1:] if re.fullmatch(r"[-+.0-9E]+", word, flags=re.I)]
    return bool(numbers) and not any(map(float, numbers))


def _nodes(archive: Archive, lines: Iterator[str]) -> None:
    """Read NBLOCK: number, two other integers, x, y, z; zeros at the end may be left out."""
    widths = _widths(next(lines))
    integers = sum(kind == "i" for kind, _ in widths)
    while not re.match(r"\s*(-1|N\s*,)", line := next(lines), flags=re.I):
        words = _cut(line, widths)
        place = [float(word.upper().replace("D", "E")) for word in words[integers : integers + 3]]
        number, coordinates = int(words[0]), (*place, 0.0, 0.0, 0.0)[:3]
        if any(float(word.upper().replace("D", "E")) for word in words[integers + 3 :]):
            archive.turned.append(number)
        if archive.nodes.setdefault(number, coordinates) != coordinates:
            raise refuse(archive.path, f"node {number} is given twice, at different places")


def _elements(archive: Archive, lines: Iterator[str]) -> None:
    """Read EBLOCK: type in field 1, number of nodes in field 8, number in field 10, then nodes."""
    widths = _widths(next(lines))
    while int((row := _cut(next(lines), widths))[0]) >= 0 or len(row) > 1:
        count, nodes = int(row[8]), [int(word) for word in row[11:]]
        while len(nodes) < count:
            nodes += map(int, _cut(next(lines), widths))
        label = int(row[10])
        archive.elements.append((label, int(row[1]), nodes[:count]))
        archive.materials[label], archive.reals[label] = int(row[0]), int(row[2])


def _widths(form: str) -> list[tuple[str, int]]:
    """Kind and width of each field of a Fortran format such as (3i9,6e21.13e3)."""
    found = []
    for count, kind, width in re.findall(r"(\d*)([iefg])(\d+)", form.lower()):
        found += [(kind, int(width))] * int(count or 1)
    if not found:
        raise ValueError
    return found


def _cut(line: str, widths: list[tuple[str, int]]) -> list[str]:
    """The fields of a line that are not behind its end."""
    found, at, line = [], 0, line.rstrip()
    for _, width in widths:
        if at >= len(line):
            break
        found.append(line[at : at + width].strip())
        at += width
    return found


def _expanded(members: list[int]) -> list[int]:
    """The numbers of a component, in which a negative one ends a range."""
    found: list[int] = []
    for member in members:
        found += numbers_between(found[-1] + 1, -member) if member < 0 else [member]
    return found


def _mesh(path: Path, archive: Archive) -> MeshFile:
    """The mesh, with a block for each shape, and a group for each component."""
    numbers = {number: k for k, number in enumerate(archive.nodes)}
    found: dict[tuple[int, int, int], list[tuple[int, list[int]]]] = {}
    left: Counter[str] = Counter()
    for label, type_, nodes in archive.elements:
        number = archive.types.get(type_, 0)
        allowed = range(4, 11) if number in TETRAHEDRA else range(8, 21)
        if number in SOLIDS and len(nodes) not in allowed:
            reason = f"has {counted(len(nodes), 'node')}; the file may be damaged"
            raise refuse(path, f"element {label} of type {number} {reason}")
        if number in PLANE_SOLIDS and archive.options.get(type_, {}).get(3) == 1:
            archive.other[f"axis of type {number} elements, which are read as plane cells"] = 1
        kind, own = _shape(154 if number in SURFACES else number, nodes)
        if kind:
            real = archive.reals[label] if number in SURFACES else 0
            found.setdefault((kind, number, real), []).append((label, own))
        else:
            contact = " (contact or remote point)" if number in CONTACT else ""
            contact = " (pre-tension: give [[bolts]])" if number == 179 else contact
            left[f"type {number}{contact} element"] += 1
    points = np.array(list(archive.nodes.values()), dtype=np.float64)
    blocks = []
    for (kind, number, real), entries in found.items():
        if missing := {node for _, row in entries for node in row if node} - numbers.keys():
            raise refuse(path, f"an element refers to node {min(missing)}, not in the file")
        rows = np.array([[numbers.get(node, -1) for node in row] for _, row in entries])
        labels = np.array([label for label, _ in entries])
        every, side = np.full(len(rows), True), SURFACES.get(number)
        groups = {} if side is None else {f"{side} {real}": every}
        blocks.append(Block(kind, from_vtk(kind, rows), groups, f"type {number}", labels))
    node_groups: dict[str, Ints] = {}
    for name, (what, members) in archive.components.items():
        if what.startswith("NODE"):
            node_groups[name] = np.array([numbers[m] for m in members if m in numbers], dtype=int)
        for block in blocks:
            if what.startswith("ELEM") and np.isin(block.labels, members).any():
                block.groups[name] = np.isin(block.labels, members)
    points, notes = with_middles(blocks, points)
    unread = [counted(n, name) for name, n in left.items() if name not in ATTACHED]
    unread += [said(f"{n} {name}", name) for name, n in archive.other.items()]
    groups = {name: nodes for name, nodes in node_groups.items() if len(nodes)}
    mesh = MeshFile(points, tuple(blocks), groups, tuple(unread), notes)
    return _physics(archive, mesh, numbers)


ATTACHED = ("type 14 element", "type 21 element", "type 184 element")
"""Springs, point masses and rigid beams, which are no cells."""


def _material(archive: Archive, words: list[str]) -> None:
    """Read MP, name, number, value, or MPDATA, R5.0, 1, name, number, first, values."""
    is_table = words[0].upper() == "MPDATA"  # values at temperatures
    name, number, value, *more = words[3:5] + words[6:] if is_table else words[1:4]
    key = CONSTANTS.get(name.upper())
    if key is None or {float(word) for word in more if word} - {float(value)}:
        archive.other[f"MP,{name.upper()}"] += 1
    else:
        archive.constants.setdefault(int(number), {})[key] = float(value)


def _physics(archive: Archive, mesh: MeshFile, numbers: dict[int, int]) -> MeshFile:
    """Add the materials, supports, point masses and static loads."""
    found = Collector()
    for number, constants in archive.constants.items():
        if {constants.pop(key, None) for key in ("Ey", "Ez")} - {None, constants.get("E")}:
            constants.pop("E", None)  # it is orthotropic
        found.constants[f"material {number}"] = constants
    for k, block in enumerate(mesh.blocks):
        own = np.array([archive.materials[int(label)] for label in np.atleast_1d(block.labels)])
        for number in np.unique(own):
            found.cells_of(f"material {number}", mesh)[k] = own == number
    found.turned.update(numbers[node] for node in archive.turned if node in numbers)
    for terms in archive.equations:
        own = [(numbers[n], COMPONENTS[label]) for n, label, factor in terms if factor]
        found.couplings.add("CE", "CE", own)
    held: dict[int, set[int]] = {}
    for command, node, name, value in archive.physics:
        components = {COMPONENTS[name]} if name in COMPONENTS else set()
        if name == "ALL":
            components = set(COMPONENTS.values())
        if command == "D" and value:
            found.leave(f"D,{node},{name},{value:g}: a displacement", True)
        elif command == "D":
            held.setdefault(node, set()).update(components)
        elif name in ("FX", "FY", "FZ") and numbers.get(node) in found.turned:
            found.leave(f"F,{node},{name}: the node has axes of its own")
        elif name in ("FX", "FY", "FZ") and node in numbers:
            found.forces[numbers[node]]["XYZ".index(name[1])] = value
        elif value:
            found.leave(f"F,{node},{name}")
    for components in {frozenset(entry) for entry in held.values()}:
        nodes = [numbers[n] for n, entry in held.items() if entry == components and n in numbers]
        found.hold(f"held {axes_of(set(components))}".strip(), nodes, set(components))
    for label, type_, nodes in archive.elements:
        if archive.types.get(type_) == 21 and nodes[0] in numbers:
            constants = archive.real_constants.get(archive.reals[label], [0.0])
            found.masses[numbers[nodes[0]]] += constants[0]
        elif archive.types.get(type_) == 184 and set(nodes) <= numbers.keys():
            ends = [numbers[node] for node in nodes[:2]]
            is_beam = archive.options.get(type_, {}).get(1, 0) == 1
            components = set(COMPONENTS.values()) if is_beam else set()
            other = np.array(ends[1:])
            found.couplings.rigid("MPC184", "MPC184", ends[0], other, components, mesh.points)
            if not is_beam:
                found.leave("MPC184 that are no rigid beams")
        elif archive.types.get(type_) == 14:
            component = _component(archive, type_, nodes)
            stiffness, damping, *_ = [*archive.real_constants.get(archive.reals[label], []), 0, 0]
            ends = [numbers.get(node, -1) for node in nodes]
            if damping or not found.spring(ends, [component] * len(ends), stiffness):
                found.leave("springs (type 14) but those along x, y or z to a held node")
    _joints(archive, mesh, found)
    for type_, real in {(of, archive.reals[label]) for label, of, _ in archive.elements}:
        option = archive.options.get(type_, {}).get(3, 0)
        if archive.types.get(type_) in PLANE_SOLIDS and option:
            found.strain |= option in (2, 5)
            if option == 3:
                found.thickness = archive.real_constants.get(real, [None])[0]
    if any(archive.acceleration):  # ANSYS gives that of the frame: the body is pressed against it
        vector = tuple(-value for value in archive.acceleration)
        found.others.append(DeckLoad("acceleration", vector))
    return found.finished(mesh)


def _joints(archive: Archive, mesh: MeshFile, found: Collector) -> None:
    """Take the contact pairs; of a symmetric pair its first half."""
    taken: list[list[set[int]]] = []
    last = {}  # element of the contact surface of each pair, and its type
    for label, type_, _ in archive.elements:
        if SURFACES.get(archive.types.get(type_, 0)) == "contact":
            last[archive.reals[label]] = label, type_
    for real, (label, type_) in last.items():
        pair = f"contact {real}", f"target {real}"
        ends = [_corners(mesh, name) for name in pair]
        if not all(ends):
            found.leave(f"contact pair {real} without facets on both sides, as of a remote point")
            continue
        if ends[::-1] in taken:
            continue
        taken.append(ends)
        options, constants = archive.options.get(type_, {}), archive.real_constants.get(real, [])
        behaviour = options.get(12, 0)
        if behaviour in NO_SEPARATION:
            found.leave(f"no separation of the contact pair {real}: the surfaces can part")
        friction = archive.constants.get(archive.materials[label], {}).get("mu", 0.0)
        constants = constants + [0.0] * 12
        if constants[9]:
            found.leave(f"the offset CNOF = {constants[9]:g} of the contact pair {real}: give gap")
        joint = DeckJoint(
            f"contact pair {real}",
            *pair,
            tied=behaviour in BONDED,
            shut=options.get(9) == 1 or options.get(5) in (1, 3),
            friction=NEVER_SLIPS if behaviour in ROUGH else friction,
            normal=-constants[2] if constants[2] < 0.0 else None,
            tangential=-constants[11] if constants[11] < 0.0 else None,
        )
        found.joints.append(joint)


def _corners(mesh: MeshFile, group: str) -> set[int]:
    """The corners of the facets of a group."""
    facets = [block for block in mesh.blocks if group in block.groups]
    nodes = [of.nodes[of.groups[group], : of.shape.corners].ravel() for of in facets]
    return {int(node) for of in nodes for node in of}


def _component(archive: Archive, type_: int, nodes: list[int]) -> int:
    """The component of a COMBIN14: KEYOPT(2), from 1, or 0 for that along the line of its nodes.

    Returns:
        -1 if the line is not along x, y or z.
    """
    option = archive.options.get(type_, {}).get(2, 0)
    if option or not set(nodes) <= archive.nodes.keys():
        return option - 1
    along = np.flatnonzero(np.ptp([archive.nodes[node] for node in nodes], axis=0))
    return int(along[0]) if len(along) == 1 else -1


def _shape(number: int, nodes: list[int]) -> tuple[int, list[int]]:
    """Kind and nodes, in VTK's order, of an element; kind 0 if it is left out.

    Hexahedra and quadrilaterals with repeated corners are tetrahedra, wedges, pyramids or
    triangles. Nodes on edges that are 0 are left out.
    """
    if number in SOLIDS:
        corners, middles = nodes[:8], nodes[8:20]
        if number in TETRAHEDRA:
            return (11, (nodes + [0] * 10)[:10]) if len(nodes) > 4 else (4, nodes[:4])
        if len(set(corners)) == 8:
            full = any(middles)
            return (17, (nodes + [0] * 20)[:20]) if full else (5, corners)
        m = (middles + [0] * 12)[:12]
        if len(set(corners[4:])) == 1 and corners[2] == corners[3]:
            tetra = [*corners[:3], corners[4]]
            return (11, [*tetra, m[0], m[1], m[3], *m[8:11]]) if any(middles) else (4, tetra)
        if len(set(corners[4:])) == 1:
            return (19, [*corners[:5], *m[:4], *m[8:]]) if all(m) else (7, corners[:5])
        wedge = list(dict.fromkeys(corners))[:6]  # two edges have no length
        straight = not all(m) or corners[2] != corners[3] or corners[6] != corners[7]
        return (6, wedge) if straight else (18, [*wedge, *m[:2], *m[3:6], *m[7:11]])
    if number in PLANES and len(nodes) in (3, 4, 6, 8):
        width = 4 if len(nodes) in (4, 8) else 3
        corners, middles = nodes[:width], nodes[width:]
        if len(set(corners)) == 3 and width == 4 and corners[2] == corners[3]:
            corners, middles = corners[:3], [m for k, m in enumerate(middles) if k != 2]
        if len(set(corners)) == len(corners):
            straight, curved = {3: (2, 9), 4: (3, 16)}[len(corners)]
            return (curved, corners + middles) if any(middles) else (straight, corners)
    return 0, []

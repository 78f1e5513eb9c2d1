"""Abaqus and CalculiX files (.inp): nodes, cells, sets and element-based surfaces.

A file holds its nodes and elements itself, or in parts with instances. The rest of a file is listed
as not read.
"""

from collections import Counter
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from fenicsrom.errors import refuse
from fenicsrom.formats import abaqus_sets
from fenicsrom.formats.abaqus_physics import TAKEN_ELEMENTS, with_physics
from fenicsrom.formats.mesh_file import Floats, MeshFile, unsupported
from fenicsrom.formats.shapes import SHAPES
from fenicsrom.words import counted

GENERATORS = {"NGEN", "NFILL", "NCOPY", "NMAP", "ELGEN", "ELCOPY", "SYSTEM", "PARAMETER"}
"""Keywords that make or move nodes and elements, which are refused."""

SILENT = {
    *("", "HEADING", "PREPRINT", "RESTART", "ASSEMBLY", "FREQUENCY", "OUTPUT", "MONITOR"),
    "AMPLITUDE",  # matters to the loads that have it, which say so
}
REQUESTS = (" OUTPUT", " PRINT", " FILE", " FORMAT")
"""Keywords, and ends of keywords, without an effect on the physics, which are left out silently."""


@dataclass(eq=False)
class Model:
    """The content of a file.

    Attributes:
        path: the file.
        root: nodes, elements and sets outside of parts, such as those of the assembly.
        parts: the parts by their name in capitals.
        instances: name, part and placement of each instance.
        left_out: numbers of the elements of each type that is not read.
        not_read: keywords that are not read, in their order.
        notes: sentences for the user, in their order.
    """

    path: Path
    root: abaqus_sets.Part = field(default_factory=abaqus_sets.Part)
    parts: dict[str, abaqus_sets.Part] = field(default_factory=dict)
    instances: list[tuple[str, abaqus_sets.Part, Floats]] = field(default_factory=list)
    left_out: Counter[str] = field(default_factory=Counter)
    not_read: dict[str, None] = field(default_factory=dict)
    notes: dict[str, None] = field(default_factory=dict)


def read_abaqus(path: Path) -> MeshFile:
    """Read an Abaqus or CalculiX file.

    Raises:
        SceneError: the file is damaged, or has content that changes the mesh and is not supported.
    """
    model, current = Model(path), None
    more: list[tuple[abaqus_sets.Keyword, abaqus_sets.Part]] = []
    for keyword in abaqus_sets.read_keywords(path):
        name = keyword.name
        if name == "PART":
            current = model.parts.setdefault(
                keyword.parameters.get("NAME", "").upper(), abaqus_sets.Part()
            )
        elif name == "INSTANCE":
            current = _instance(model, keyword)
        elif name in ("END PART", "END INSTANCE"):
            current = None
        if not _read(model, current or model.root, keyword) or name in ("ELEMENT", "END STEP"):
            more.append((keyword, current or model.root))
    mesh, nodes, cells = abaqus_sets.assembled(path, model.root, model.instances)
    places = {
        id(part): tuple(n for n, own, _ in model.instances if own is part) for _, part in more
    }
    scoped = [(keyword, places[id(part)] or ("",)) for keyword, part in more]
    mesh, unread = with_physics(mesh, scoped, nodes, cells)
    kept = [name for name in model.left_out if name not in TAKEN_ELEMENTS]
    left = [counted(model.left_out[name], f"{name} element") for name in kept]
    not_read = (*left, *model.not_read, *unread)
    return replace(mesh, not_read=not_read, notes=(*mesh.notes, *model.notes))


def _instance(model: Model, keyword: abaqus_sets.Keyword) -> abaqus_sets.Part:
    """Add an instance of a part; an instance may have nodes and elements of its own.

    Raises:
        SceneError: there is no such part.
    """
    name, of = keyword.parameters.get("NAME", ""), keyword.parameters.get("PART", "").upper()
    if of not in model.parts:
        raise refuse(model.path, f"*INSTANCE {name}: there is no part {of!r} before it")
    part = model.parts[of]
    if not part.nodes and not part.elements:
        part = abaqus_sets.Part()
    model.instances.append((name, part, abaqus_sets.placed(model.path, keyword)))
    return part


def _read(model: Model, part: abaqus_sets.Part, keyword: abaqus_sets.Keyword) -> bool:
    """Read one keyword into a part; return whether it was read or has no effect on the physics."""
    name, path = keyword.name, model.path
    if name in GENERATORS and (keyword.lines or name not in ("SYSTEM", "PARAMETER")):
        reason = "is not supported; write all nodes and elements with their coordinates"
        raise refuse(path, f"*{name} {reason}")
    if name == "NODE":
        _nodes(path, part, keyword)
    elif name == "ELEMENT":
        _elements(model, part, keyword)
    elif name in ("NSET", "ELSET"):
        _set(path, part, keyword)
    elif name == "SURFACE":
        return _surface(part, keyword)
    else:
        silent = name in SILENT or name.startswith("END ") or name.endswith(REQUESTS)
        return silent or name in ("PART", "INSTANCE") or name in GENERATORS
    return True


def _nodes(path: Path, part: abaqus_sets.Part, keyword: abaqus_sets.Keyword) -> None:
    """Read *NODE.

    Raises:
        SceneError: a line is damaged, the coordinates are spherical, or a number is given twice.
    """
    system = keyword.parameters.get("SYSTEM", "R").upper() or "R"
    if system not in ("R", "C"):
        raise refuse(path, f"*NODE, SYSTEM={system}: must be R or C")
    numbers = []
    for line in keyword.lines:
        words = abaqus_sets.fields(line)
        try:
            number = int(words[0])
            place = [float(word.upper().replace("D", "E") or 0) for word in words[1:4]]
        except (ValueError, IndexError):
            reason = "cannot be read; the file may be damaged"
            raise refuse(path, f"*NODE: {line!r} {reason}") from None
        x, y, z = place + [0.0] * (3 - len(place))
        if system == "C":
            x, y = x * np.cos(np.radians(y)), x * np.sin(np.radians(y))
        if not np.isfinite([x, y, z]).all():
            raise refuse(path, f"node {number}: a coordinate is not a finite number")
        if part.nodes.setdefault(number, (x, y, z)) != (x, y, z):
            raise refuse(path, f"node {number} is given twice, at different places")
        numbers.append(number)
    if name := keyword.parameters.get("NSET"):
        abaqus_sets.add_to_set(part.node_sets, name, abaqus_sets.Entry("", tuple(numbers)))


def _elements(model: Model, part: abaqus_sets.Part, keyword: abaqus_sets.Keyword) -> None:
    """Read *ELEMENT.

    Raises:
        SceneError: the elements would leave a hole in the body, or a line is damaged.
    """
    path, name = model.path, keyword.parameters.get("TYPE", "").upper()
    if what := abaqus_sets.refused(name) if abaqus_sets.kind_of(name) is None else None:
        raise refuse(path, unsupported(f"elements of type {name} ({what})"))
    kind = abaqus_sets.kind_of(name)
    of = keyword.parameters.get("ELSET")
    if kind is None:
        model.left_out[name] += sum(not line.endswith(",") for line in keyword.lines)
        if of:
            labels = keyword.lines if name in TAKEN_ELEMENTS else ()
            numbers = tuple(int(abaqus_sets.fields(line)[0]) for line in labels)
            abaqus_sets.add_to_set(part.element_sets, of, abaqus_sets.Entry("", numbers))
        return
    if abaqus_sets.is_axisymmetric(name):
        model.not_read[f"the axis of the {name} elements (they are read as plane cells)"] = None
    size = 1 + SHAPES[kind].nodes
    elements, numbers = part.elements.setdefault(name, {}), []
    row: list[str] = []
    for line in (*keyword.lines, ""):
        words = abaqus_sets.fields(line)
        if not row and len(words) > size:
            model.notes[f"elements of type {name} have only their first {size - 1} nodes"] = None
            words = words[:size]
        row += words
        if len(row) > size or (row and not line):
            given = f"element {row[0]} of type {name} has {len(row) - 1} nodes"
            reason = f"but must have {size - 1}; the file may be truncated or damaged"
            raise refuse(path, f"{given}, {reason}")
        if len(row) < size:
            continue
        try:
            number, *nodes = map(int, row)
        except ValueError:
            raise refuse(path, f"*ELEMENT: {line!r} cannot be read; it may be damaged") from None
        if elements.setdefault(number, tuple(nodes)) != tuple(nodes):
            raise refuse(path, f"element {number} is given twice, with different nodes")
        numbers.append(number)
        row = []
    if of:
        abaqus_sets.add_to_set(part.element_sets, of, abaqus_sets.Entry("", tuple(numbers)))


def _set(path: Path, part: abaqus_sets.Part, keyword: abaqus_sets.Keyword) -> None:
    """Read *NSET or *ELSET; a node set may be that of the nodes of an element set."""
    is_node_set = keyword.name == "NSET"
    sets = part.node_sets if is_node_set else part.element_sets
    name = keyword.parameters.get(keyword.name, "")
    instance = keyword.parameters.get("INSTANCE", "")
    if "INTERNAL" not in keyword.parameters:
        part.internal.discard((keyword.name, name.upper()))
    elif abaqus_sets.known_name(sets, name) not in sets:
        part.internal.add((keyword.name, name.upper()))
    if is_node_set and "ELSET" in keyword.parameters:
        items: tuple[int | str, ...] = (abaqus_sets.OF_ELEMENTS + keyword.parameters["ELSET"],)
        abaqus_sets.add_to_set(sets, name, abaqus_sets.Entry(instance, items))
    else:
        abaqus_sets.add_to_set(
            sets, name, abaqus_sets.Entry(instance, abaqus_sets.read_set(path, keyword))
        )


def _surface(part: abaqus_sets.Part, keyword: abaqus_sets.Keyword) -> bool:
    """Read *SURFACE; return whether the whole surface was read."""
    name, kind = keyword.parameters.get("NAME", ""), keyword.parameters.get("TYPE", "ELEMENT")
    rows = [abaqus_sets.fields(line) for line in keyword.lines]
    if kind.upper() == "NODE":
        for row in rows:
            items = tuple(int(word) if word.isdigit() else word for word in row[:1])
            if name.upper() in (str(item).upper() for item in items):
                continue  # the node set of this name
            abaqus_sets.add_to_set(part.node_sets, name, abaqus_sets.Entry("", items))
        return True
    whole = kind.upper() == "ELEMENT"
    sides = part.surfaces.setdefault(abaqus_sets.known_name(part.surfaces, name), [])
    for row in rows:
        if len(row) == 2 and row[1].upper()[:1] == "S" and row[1][1:].isdigit():
            sides.append(
                abaqus_sets.Side(int(row[0]) if row[0].isdigit() else row[0], int(row[1][1:]) - 1)
            )
        else:
            whole = False
    return whole

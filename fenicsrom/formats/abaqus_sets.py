"""Abaqus and CalculiX files: keywords, types of elements, parts with their sets, instances."""

import re
from collections.abc import Callable
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

import numpy as np

from fenicsrom.errors import refuse
from fenicsrom.formats.cells import faces
from fenicsrom.formats.collector import included, numbers_between, read_lines
from fenicsrom.formats.mesh_file import Block, Floats, Ints, MeshFile
from fenicsrom.formats.shapes import from_vtk
from fenicsrom.notes import Note, NoteKind


@dataclass(frozen=True)
class Keyword:
    """A keyword with its data.

    Attributes:
        name: its name in capitals, such as "NODE".
        parameters: parameters by their name in capitals; "" for one without a value.
        lines: the data lines, without comments and empty lines.
    """

    name: str
    parameters: dict[str, str]
    lines: list[str] = field(default_factory=list)


def read_keywords(path: Path, depth: int = 0) -> list[Keyword]:
    """Read the keywords of a file and of the files that it includes.

    Raises:
        SceneError: a file that it includes is not there.
    """
    found: list[Keyword] = []
    lines = _lines(path)[::-1]
    while lines:
        line = lines.pop()
        if not line.startswith("*"):
            if found:
                found[-1].lines.append(line)
            continue
        while line.endswith(",") and lines and lines[-1][0].isalpha():
            line += lines.pop()
        keyword = _keyword(line)
        if keyword.name == "INCLUDE":
            name = keyword.parameters.get("INPUT", "")
            found += read_keywords(included(path, name, "*INCLUDE", depth), depth + 1)
            continue
        found.append(keyword)
        if "INPUT" in keyword.parameters:
            name = keyword.parameters["INPUT"]
            other = included(path, name, f"*{keyword.name}, INPUT =", depth)
            keyword.lines.extend(_lines(other))
    return found


def _lines(path: Path) -> list[str]:
    """The lines of a file without comments and empty lines."""
    return [line for line in map(str.strip, read_lines(path)) if line and line[:2] != "**"]


def _keyword(line: str) -> Keyword:
    """Parse a keyword line."""
    name, *rest = re.findall(r'(?:[^,"]|"[^"]*")+', line[1:]) or [""]
    parameters = {}
    for part in rest:
        key, _, value = part.partition("=")
        if key.strip():
            parameters[key.strip().upper()] = unquoted(value)
    return Keyword(" ".join(name.upper().split()), parameters)


def unquoted(text: str) -> str:
    """A name without the blanks and quotes around it."""
    return text.strip().strip('"')


def fields(line: str) -> list[str]:
    """The fields of a data line without quotes; a comma at the end counts for nothing."""
    found = [unquoted(field) for field in line.split(",")]
    while found and not found[-1]:
        found.pop()
    return found


_VARIANT = "(?:R|I|H|RH|IH|M|MH|HS|S|T|RT|HT|MT|MHT|RHT|P|PH|MP|MPH|RP|RPH|PT|RPT)?"
"""Letters for integration, hybrid formulation and other fields; the nodes are the same."""

_FAMILIES: dict[str, int] = {
    rf"C3D4{_VARIANT}": 4,
    rf"C3D10{_VARIANT}": 11,
    rf"C3D5{_VARIANT}": 7,
    rf"C3D6{_VARIANT}": 6,
    rf"C3D13{_VARIANT}": 19,
    rf"C3D15{_VARIANT}": 18,
    rf"C3D8{_VARIANT}": 5,
    rf"C3D20{_VARIANT}": 17,
    rf"(CPS|CPE|CPEG|CAX|M3D)3{_VARIANT}|S3R?S?|STRI3|SFM3D3|DS3|R3D3": 2,
    rf"(CPS|CPE|CPEG|CAX|M3D)4{_VARIANT}|S4R?S?W?|S4R5|SFM3D4R?|DS4|R3D4": 3,
    rf"(CPS|CPE|CPEG|CAX|M3D)6{_VARIANT}|S6|STRI65|SFM3D6|DS6": 9,
    rf"(CPS|CPE|CPEG|CAX|M3D)8{_VARIANT}|S8R?T?|S8R5|SFM3D8R?|DS8": 16,
    r"S9R5|M3D9R?": 10,
    r"(B2|B3)1H?|(B2|B3)1OS|T[23]D2T?|(B2|B3)3H?": 1,
    r"(B2|B3)2[HR]?|(B2|B3)2OS|T[23]D3T?": 8,
}
"""Kinds by the types of elements with the nodes of a cell, a facet or an edge."""

_TYPES = [(re.compile(pattern), kind) for pattern, kind in _FAMILIES.items()]

_NAMES = {"3D18": "wedges of 18 nodes", "3D27": "hexahedra of variable nodes"}
"""Solids that this program cannot use, which would leave a hole in the body."""


def kind_of(name: str) -> int | None:
    """The kind of an element type in capitals; None for a type that is left out."""
    return next((kind for pattern, kind in _TYPES if pattern.fullmatch(name)), None)


def refused(name: str) -> str | None:
    """Describe an element type that would leave a hole in the body; None for other types."""
    match = re.match(r"C(3D\d+)", name)
    if match:
        return _NAMES.get(match[1], "solid elements")
    if re.match(r"SC[68]|CSS8|CCL|CIN3D", name):
        return "continuum shells, cylindrical or infinite elements"
    return None


def is_axisymmetric(name: str) -> bool:
    """Whether elements of this type stand for rings."""
    return name.startswith("CAX")


OF_ELEMENTS = "*ELSET="
"""Prefix of an item of a node set: all nodes of the element set of this name."""


class Entry(NamedTuple):
    """A part of a set.

    Attributes:
        instance: the instance whose numbers and sets are meant, or "".
        items: numbers, and names of sets.
    """

    instance: str
    items: tuple[int | str, ...]


class Side(NamedTuple):
    """A part of a surface: the elements, by number or set, and the number of the face from 0."""

    item: int | str
    face: int


@dataclass(eq=False)
class Part:
    """A part, or the file itself if it has no parts.

    Attributes:
        nodes: coordinates of each node by its number.
        elements: nodes of each element by its number, by the type of the element.
        node_sets: entries of each node set by its name.
        element_sets: entries of each element set by its name.
        surfaces: sides of each surface by its name.
        internal: keyword and name of the sets that Abaqus/CAE made for itself, which are no groups.
    """

    nodes: dict[int, tuple[float, float, float]] = field(default_factory=dict)
    elements: dict[str, dict[int, tuple[int, ...]]] = field(default_factory=dict)
    node_sets: dict[str, list[Entry]] = field(default_factory=dict)
    element_sets: dict[str, list[Entry]] = field(default_factory=dict)
    surfaces: dict[str, list[Side]] = field(default_factory=dict)
    internal: set[tuple[str, str]] = field(default_factory=set)

    def names(self, keyword: str) -> list[str]:
        """The names of the node sets, element sets or surfaces, by their keyword."""
        sets = {"NSET": self.node_sets, "ELSET": self.element_sets, "SURFACE": self.surfaces}
        return [name for name in sets[keyword] if (keyword, name.upper()) not in self.internal]


def add_to_set(sets: dict[str, list[Entry]], name: str, entry: Entry) -> None:
    """Add an entry to a set, whose name may have been written in other letters before."""
    sets.setdefault(known_name(sets, name), []).append(entry)


def known_name(names: dict[str, list[Entry]] | dict[str, list[Side]], name: str) -> str:
    """The spelling of a name that was used first: capitals and small letters are the same."""
    return next((known for known in names if known.upper() == name.upper()), name)


def read_set(path: Path, keyword: Keyword) -> tuple[int | str, ...]:
    """The numbers and names of the data lines of *NSET or *ELSET.

    Raises:
        SceneError: a range is wrong.
    """
    if "GENERATE" not in keyword.parameters:
        words = [word for line in keyword.lines for word in fields(line) if word]
        return tuple(_number_or_name(word) for word in words)
    found: list[int] = []
    for line in keyword.lines:
        try:
            first, last, step = ([int(word) for word in fields(line)] + [1])[:3]
            found += numbers_between(first, last, step)
        except ValueError:
            reason = "must be first, last and step (1 if left out)"
            raise refuse(path, f"*{keyword.name}, GENERATE: {line!r}: {reason}") from None
    return tuple(found)


def _number_or_name(word: str) -> int | str:
    return int(word) if word.lstrip("+-").isdigit() else word


def by_block(chosen: Ints, starts: Ints) -> list[Ints]:
    """The indices inside each block of some elements, which are counted over all blocks.

    Args:
        chosen: indices of elements.
        starts: index of the first element of each block, and the number of all elements.
    """
    return [chosen[(chosen >= a) & (chosen < b)] - a for a, b in pairwise(starts)]


@dataclass(frozen=True, eq=False)
class Resolver:
    """Finds the nodes or elements of a set of a model.

    Attributes:
        path: the file, for messages.
        keyword: "NSET" or "ELSET".
        sets: the sets of the model itself.
        instances: the sets of each instance by its name.
        numbers: index of each node or element by its number, in each instance by its name; "" is
            the model itself.
        nodes_of: gives the nodes of an element set by instance and name.
    """

    path: Path
    keyword: str
    sets: dict[str, list[Entry]]
    instances: dict[str, dict[str, list[Entry]]]
    numbers: dict[str, dict[int, int]]
    nodes_of: Callable[[str, str], Ints] | None = None

    def indices(self, instance: str, name: str, seen: tuple[str, ...] = ()) -> Ints:
        """Sorted indices of a set of an instance, or of the model itself if instance is "".

        Numbers that the file does not define, such as the numbers of elements that are left out,
        are ignored.

        Raises:
            SceneError: there is no such set, or it contains itself.
        """
        sets = self.instances.get(instance, {}) if instance else self.sets
        known, key = known_name(sets, name), f"{instance}.{name}".upper()
        if known not in sets:
            where, _, rest = name.partition(".")
            if not instance and rest and self._instance(where):
                return self.indices(self._instance(where), rest, seen)
            raise refuse(self.path, f"*{self.keyword}: there is no set {name!r}")
        if key in seen:
            raise refuse(self.path, f"*{self.keyword}: the set {name!r} contains itself")
        found: set[int] = set()
        for entry in sets[known]:
            where = instance
            # a file without parts may keep the names of the instances it was made from
            named = entry.instance and self.instances
            if named and not (where := self._instance(entry.instance)):
                reason = f"*{self.keyword} {name}: there is no instance {entry.instance!r}"
                raise refuse(self.path, reason)
            for item in entry.items:
                found.update(self._item(where, item, (*seen, key)))
        return np.array(sorted(found), dtype=np.int64)

    def found(self, scope: tuple[str, ...], text: str) -> Ints:
        """Sorted indices of a number or a set, as a data line names it.

        Args:
            scope: instances of the part in which the line stands, or ("",).
            text: the number or name.

        Raises:
            SceneError: there is no such set.
        """
        item: int | str = int(text) if text.isdigit() else text
        every = [index for instance in scope for index in self._item(instance, item, ())]
        return np.array(sorted(set(every)), dtype=np.int64)

    def _item(self, instance: str, item: int | str, seen: tuple[str, ...]) -> list[int]:
        """Indices of a number, of a number with its instance, or of a set."""
        if isinstance(item, str):
            where, _, number = item.rpartition(".")
            if where and number.isdigit() and self._instance(where):
                return self._item(self._instance(where), int(number), seen)
            if item.startswith(OF_ELEMENTS) and self.nodes_of is not None:
                return list(map(int, self.nodes_of(instance, item.removeprefix(OF_ELEMENTS))))
            return list(map(int, self.indices(instance, item, seen)))
        index = self.numbers.get(instance, {}).get(item)
        return [] if index is None else [index]

    def _instance(self, name: str) -> str:
        """The instance of a name in any letters, or ""."""
        return next((known for known in self.instances if known.upper() == name.upper()), "")


Placements = list[tuple[str, Part, Floats]]
"""Name, part and placement (3, 4) of each instance."""


def placed(path: Path, keyword: Keyword) -> Floats:
    """Read the placement of *INSTANCE: a translation, then a rotation about an axis.

    Returns:
        The matrix (3, 4) that places a point (x, y, z, 1).

    Raises:
        SceneError: a data line is wrong.
    """
    try:
        rows = [[float(word or 0) for word in fields(line)] for line in keyword.lines[:2]]
        shift = np.array((rows[0] if rows else []) + [0.0] * 3)[:3]
        if len(rows) < 2:
            return np.column_stack([np.eye(3), shift])
        start, end, angle = np.array(rows[1][:3]), np.array(rows[1][3:6]), np.radians(rows[1][6])
        length = float(np.linalg.norm(end - start))
        if not 0.0 < length < np.inf:
            raise ValueError
    except (ValueError, IndexError):
        reason = f"{keyword.lines[:2]} must be a translation and a rotation"
        raise refuse(path, f"*INSTANCE: {reason}") from None
    across = np.cross(np.eye(3), (end - start) / length)  # across @ x = axis × x
    turn = np.eye(3) + np.sin(angle) * across + (1.0 - np.cos(angle)) * across @ across  # Rodrigues
    return np.column_stack([turn, turn @ (shift - start) + start])


def assembled(path: Path, root: Part, instances: Placements) -> tuple[MeshFile, Resolver, Resolver]:
    """Put the nodes, elements and sets of a model together.

    Returns:
        The mesh, and the reader of node and element sets by their names.

    Args:
        path: the file, for messages.
        root: nodes, elements and sets outside of parts.
        instances: name, part and placement of each instance.

    Raises:
        SceneError: an element has a node that is not there, or a set is wrong.
    """
    identity = np.eye(3, 4)
    placements = [("", root, identity), *instances]
    points, node_numbers = _points(placements)
    blocks, element_numbers = _blocks(path, placements, node_numbers)
    starts = np.cumsum([0] + [len(block.nodes) for block in blocks])

    in_cells = {name: part.element_sets for name, part, _ in instances}
    in_nodes = {name: part.node_sets for name, part, _ in instances}
    cells = Resolver(path, "ELSET", root.element_sets, in_cells, element_numbers)

    def nodes_of(instance: str, name: str) -> Ints:
        chosen = by_block(cells.indices(instance, name), starts)
        rows = [block.nodes[of].ravel() for block, of in zip(blocks, chosen, strict=True)]
        return np.unique(np.concatenate(rows)) if rows else np.empty(0, dtype=np.int64)

    nodes = Resolver(path, "NSET", root.node_sets, in_nodes, node_numbers, nodes_of)
    notes: list[str] = []
    for instance, name, shown in _names(placements, "ELSET", notes):
        chosen = by_block(cells.indices(instance, name), starts)
        for block, of in zip(blocks, chosen, strict=True):
            marks = np.zeros(len(block.nodes), dtype=bool)
            marks[of] = True
            if marks.any():
                block.groups[shown] = marks
    groups = {
        shown: nodes.indices(instance, name)
        for instance, name, shown in _names(placements, "NSET", notes)
    }
    groups = {name: members for name, members in groups.items() if len(members)}
    surfaces = _surfaces(placements, blocks, starts, cells, notes)
    mesh = MeshFile(points, (*blocks, *surfaces), groups, notes=tuple(notes))
    return mesh, nodes, cells


def _points(placements: Placements) -> tuple[Floats, dict[str, dict[int, int]]]:
    """Coordinates (n, 3) of all nodes, and the index of each node by instance and number."""
    points, numbers, start = [np.empty((0, 3))], {}, 0
    for name, part, matrix in placements:
        place = np.array(list(part.nodes.values()), dtype=np.float64).reshape(-1, 3)
        exact = np.array_equal(matrix, np.eye(3, 4))
        points.append(place if exact else place @ matrix[:, :3].T + matrix[:, 3])
        numbers[name] = {number: start + k for k, number in enumerate(part.nodes)}
        start += len(place)
    return np.concatenate(points), numbers


def _blocks(
    path: Path, placements: Placements, node_numbers: dict[str, dict[int, int]]
) -> tuple[list[Block], dict[str, dict[int, int]]]:
    """The cells of each instance and type, and the index of each by instance and number."""
    blocks: list[Block] = []
    numbers: dict[str, dict[int, int]] = {}
    start = 0
    for name, part, _ in placements:
        known = numbers.setdefault(name, {})
        for type_, elements in part.elements.items():
            kind = kind_of(type_)
            if kind is None or not elements:
                continue
            if twice := known.keys() & elements.keys():
                raise refuse(path, f"element {min(twice)} is given twice, with different types")
            try:
                index = node_numbers[name]
                rows = np.array([[index[node] for node in row] for row in elements.values()])
            except KeyError as error:
                reason = f"refer to node {error}, which is not in the file"
                raise refuse(path, f"elements of type {type_} {reason}") from None
            labels = np.array(list(elements))
            known |= {int(label): start + k for k, label in enumerate(labels)}
            blocks.append(Block(kind, from_vtk(kind, rows), {}, type_, labels))
            start += len(rows)
    return blocks, numbers


def _names(placements: Placements, keyword: str, notes: list[str]) -> list[tuple[str, str, str]]:
    """For each set the instance, the name, and the name that this program gives.

    Where a set of an instance has the name of another set, it is called "instance.set", as Abaqus
    calls it.
    """
    every = [(instance, name) for instance, part, _ in placements for name in part.names(keyword)]
    found = []
    for instance, name in every:
        shown = name
        if instance and sum(other.upper() == name.upper() for _, other in every) > 1:
            shown = f"{instance}.{name}"
            text = f"the {keyword} {name} of {instance} has the group name {shown}"
            notes.append(Note(NoteKind.REMARK, text))
        found.append((instance, name, shown))
    return found


def _surfaces(
    placements: Placements, blocks: list[Block], starts: Ints, cells: Resolver, notes: list[str]
) -> list[Block]:
    """The facets of the surfaces, on the cells of the highest dimension."""
    highest = max((block.shape.dimension for block in blocks), default=0)
    parts = {instance: part for instance, part, _ in placements}
    found = []
    for instance, name, shown in _names(placements, "SURFACE", notes):
        surfaces = parts[instance].surfaces
        for side in surfaces[known_name(surfaces, name)]:
            if isinstance(side.item, int):
                index = cells.numbers.get(instance, {}).get(side.item)
                chosen = np.array([] if index is None else [index], dtype=np.int64)
            else:
                chosen = cells.indices(instance, side.item)
            members = [
                np.isin(np.arange(a, b), chosen) & (block.shape.dimension == highest)
                for block, (a, b) in zip(blocks, pairwise(starts), strict=True)
            ]
            for facets in faces(blocks, members, side.face):
                facets.groups[shown] = np.ones(len(facets.nodes), dtype=bool)
                found.append(facets)
    return found

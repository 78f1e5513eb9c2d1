"""Nastran files (.bdf, .nas, .dat): grid points, elements, and groups by property.

`nastran_physics` takes materials, supports, masses and loads. The rest of the bulk data is listed
as not read, and the executive and case control are passed over.

The bulk data of a Nastran file: its entries in small, large and free field format.
"""

import re
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from fenicsrom.errors import refuse
from fenicsrom.formats.cells import with_middles
from fenicsrom.formats.collector import included, read_lines
from fenicsrom.formats.mesh_file import Block, Floats, Ints, MeshFile, unsupported
from fenicsrom.formats.nastran_physics import TAKEN, held_grids, with_physics
from fenicsrom.formats.nastran_systems import KINDS as SYSTEMS
from fenicsrom.formats.nastran_systems import Systems, read_systems
from fenicsrom.formats.reasons import said
from fenicsrom.formats.shapes import SHAPES, TETRA_FROM_VTK


@dataclass(frozen=True)
class Card:
    """An entry of the bulk data.

    Attributes:
        name: its name in capitals, without an asterisk.
        fields: its data fields; field 2 of the entry is number 0. Fields are 8 to a line (4 to a
            line in large field format), with "" for blank ones.
    """

    name: str
    fields: list[str] = field(default_factory=list)

    def text(self, index: int) -> str:
        """A field, or "" behind the last one."""
        return self.fields[index] if index < len(self.fields) else ""

    def integer(self, index: int, default: int = 0) -> int:
        """A field as an integer, or a default if it is blank."""
        text = self.text(index)
        return int(text) if text else default

    def real(self, index: int, default: float = 0.0) -> float:
        """A field as a real number, which may lack the E: 1.5-3 is 0.0015."""
        text = re.sub("[dD]", "E", self.text(index))
        return float(re.sub(r"(?<=[0-9.])([+-])", r"E\1", text)) if text else default


def read_cards(path: Path, whole: bool = True) -> list[Card]:
    """Read the entries of the bulk data of a file and of the files that it includes.

    Args:
        path: the file.
        whole: whether the file must end with ENDDATA; a file of matrices need not.

    Raises:
        SceneError: the file does not end with ENDDATA, a continuation belongs to no entry, or an
            included file is not there.
    """
    lines = _bulk_lines(path, 0)
    if whole and not any(re.match(r"ENDDATA", line.strip(), flags=re.I) for line in lines):
        raise refuse(path, "the file does not end with ENDDATA; it may be truncated")
    cards: list[Card] = []
    mark = ""
    for line in lines:
        if re.match(r"ENDDATA", line.strip(), flags=re.I):
            break
        name, data, own, following = _split(path, line)
        if own is not None:
            if not cards or (own and mark and own != mark):
                reason = "the line continues no entry above it; continuations must follow in order"
                raise refuse(path, f"{line.strip()!r}: {reason}")
            cards[-1].fields.extend(data)
        else:
            cards.append(Card(name, data))
        mark = following
    return cards


def _bulk_lines(path: Path, depth: int) -> list[str]:
    """The lines of the bulk data, without comments and empty lines, included files in place."""
    found: list[str] = []
    lines = [line.partition("$")[0].rstrip().expandtabs(8) for line in read_lines(path)]
    begin = [k for k, line in enumerate(lines) if re.match(r"\s*BEGIN +(BULK|SUPER)", line, re.I)]
    start = begin[0] + 1 if begin else 0
    if len(begin) > 1:
        raise refuse(path, f"{lines[begin[1]].strip()!r}: superelements are not supported")
    index = 0
    while index < len(lines):
        line = lines[index]
        match = re.match(r"\s*INCLUDE\b\s*(.*)", line, flags=re.I)
        if match and index >= start:
            name = match[1]
            while name.count("'") == 1 and index + 1 < len(lines):  # a name on several lines
                index += 1
                name += lines[index].strip()
            found += _bulk_lines(included(path, name, "INCLUDE", depth), depth + 1)
        elif index >= start and line.strip():
            found.append(line)
        index += 1
    return found


def _split(path: Path, line: str) -> tuple[str, list[str], str | None, str]:
    """Split a line of bulk data.

    Returns:
        The name of the entry; its data fields; the mark by which the line continues an entry, or
        None; and the mark of the line that continues this line.
    """
    if "," in line:
        words = [word.strip() for word in line.split(",")]
        head = words[0]
        long = "*" in head
        width = 4 if long else 8
        if head[:1].isdigit():  # some programs leave out the empty first field
            return "", words, "", ""
        data, following = words[1 : 1 + width], "".join(words[1 + width : 2 + width])
        if any(words[2 + width :]):
            raise refuse(path, f"{line.strip()!r}: more than {2 + width} fields on a line")
    else:
        head = line[:8].strip()
        long = "*" in head
        size, width = (16, 4) if long else (8, 8)
        data = [line[8 + k * size : 8 + (k + 1) * size].strip() for k in range(width)]
        following = line[72:80]  # its first column says nothing
    if head.startswith("="):
        raise refuse(path, f"{line.strip()!r}: replication of entries is not supported")
    data += [""] * (width - len(data))
    if not head or head[0] in "+*":
        return "", data, head[1:].strip(), following[1:].strip()
    # meshio writes CTETRA_ and CHEXA_ for the quadratic elements
    return head.strip("*_ ").upper(), data, None, following[1:].strip()


CUBE_FROM_NASTRAN = (*range(9), 11, 12, 9, 13, 10, 14, 15, 16, 19, 17, 18)
"""Gmsh's order of the nodes of a hexahedron of 20 nodes, as indices in Nastran's order.

Nastran numbers the nodes on the edges at the bottom, then those upright, then those at the top.
"""

_NAMES: dict[tuple[int, ...], tuple[str, ...]] = {
    (4, 11): ("CTETRA",),
    (5, 17): ("CHEXA",),
    (6, 18): ("CPENTA",),
    (7, 19): ("CPYRAM", "CPYRA"),
    (2,): ("CTRIA3", "CTRIAR", "CPLSTS3", "CPLSTN3"),
    (9,): ("CTRIA6",),
    (3,): ("CQUAD4", "CQUADR", "CPLSTS4", "CPLSTN4"),
    (16,): ("CQUAD8",),
    (10,): ("CQUAD9",),
    (1,): ("CROD", "CONROD", "CTUBE", "CBAR", "CBEAM"),
}
ELEMENTS = {name: kinds for kinds, names in _NAMES.items() for name in names}
"""Kinds by the name of an element, with few or many nodes."""

HOLES = {
    "CHEXCZ": "cohesive solids",
    **dict.fromkeys(("CIHEX1", "CIHEX2", "CHEXA1", "CHEXA2"), "solids of an old kind"),
    "CWEDGE": "wedges",
}
"""Solids that this program cannot use, which would leave a hole in the body."""

SILENT = {"GRID", "GRDSET", "ENDDATA", "BEGIN", "EIGR", "EIGRL", *SYSTEMS, *TAKEN}
"""Entries that are read, or are no data."""


def read_nastran(path: Path) -> MeshFile:
    """Read a Nastran file.

    Raises:
        SceneError: the file is damaged, or has content that changes the mesh and is not supported.
    """
    cards = read_cards(path)
    numbers, points, systems = _points(path, cards)
    blocks, not_read = _blocks(path, cards, numbers)
    points, notes = with_middles(blocks, points)
    mesh = MeshFile(points, blocks, _constrained(cards, numbers), not_read, notes)
    return with_physics(path, mesh, cards, numbers, systems)


def _points(path: Path, cards: list[Card]) -> tuple[dict[int, int], Floats, Systems]:
    """The index of each grid point by its number, the coordinates (n, 3), and the systems.

    Raises:
        SceneError: a grid point is given twice, or its coordinate system is not in the file.
    """
    default = next((card.integer(1) for card in cards if card.name == "GRDSET"), 0)
    grids: dict[int, tuple[int, tuple[float, float, float]]] = {}
    for card in cards:
        if card.name == "GRID":
            place = (card.real(2), card.real(3), card.real(4))
            if not np.isfinite(place).all():
                raise refuse(path, f"GRID {card.text(0)}: a coordinate is not a finite number")
            given = (card.integer(1, default), place)
            if grids.setdefault(card.integer(0), given) != given:
                raise refuse(path, f"GRID {card.text(0)} is given twice, at different places")
    systems = Systems(path, grids, read_systems(cards))
    points = [systems.basic(*given) for given in grids.values()]
    numbers = {number: k for k, number in enumerate(grids)}
    return numbers, np.array(points).reshape(-1, 3), systems


def _blocks(
    path: Path, cards: list[Card], numbers: dict[int, int]
) -> tuple[tuple[Block, ...], tuple[str, ...]]:
    """The elements of each name and kind, and what is not read, each in a few words.

    A node on an edge that the file leaves out has the index -1.
    """
    found: dict[tuple[str, int], list[tuple[int, str, list[int]]]] = {}
    given: dict[int, list[int]] = {}
    other: Counter[str] = Counter()
    for card in cards:
        if card.name in HOLES:
            raise refuse(path, unsupported(f"{card.name} elements ({HOLES[card.name]})"))
        if card.name not in ELEMENTS:
            if card.name not in SILENT:
                other[card.name] += 1
            continue
        label, kind, grids = _element(card)
        if given.setdefault(label, grids) != grids:
            raise refuse(path, f"element {label} is given twice, with different nodes")
        if unknown := [number for number in grids if number and number not in numbers]:
            reason = f"refers to GRID {unknown[0]}, which is not in the file"
            raise refuse(path, f"{card.name} {label} {reason}")
        rows = [numbers.get(number, -1) for number in grids]
        group = "" if card.name == "CONROD" else card.text(1) or str(label)
        found.setdefault((card.name, kind), []).append((label, group, rows))
    blocks = []
    for (name, kind), entries in found.items():
        rows_ = np.array([row for *_, row in entries])
        groups = np.array([group for _, group, _ in entries])
        marks = {str(group): groups == group for group in np.unique(groups) if group}
        labels = np.array([label for label, *_ in entries])
        blocks.append(Block(kind, rows_[:, _order(kind)], marks, name, labels))
    return tuple(blocks), tuple(said(f"{count} {name}", name) for name, count in other.items())


def _element(card: Card) -> tuple[int, int, list[int]]:
    """Number, kind and grid points of an element; 0 for a mid-edge point that the file leaves out.

    Raises:
        ValueError: the entry lacks corners.
    """
    kinds, first = ELEMENTS[card.name], 1 if card.name == "CONROD" else 2
    most = SHAPES[kinds[-1]].nodes
    grids = [int(text or 0) for text in card.fields[first : first + most]]
    kind = kinds[-1] if any(grids[SHAPES[kinds[0]].corners :]) or len(kinds) == 1 else kinds[0]
    shape = SHAPES[kind]
    grids = (grids + [0] * shape.nodes)[: shape.nodes]
    if not all(grids[: shape.corners]):
        raise ValueError(f"{card.name} {card.text(0)} lacks a corner")
    return card.integer(0), kind, grids


def _order(kind: int) -> list[int]:
    """Gmsh's order of the nodes of a kind, as indices in Nastran's order."""
    orders = {11: TETRA_FROM_VTK, 17: CUBE_FROM_NASTRAN}
    return list(orders.get(kind, range(SHAPES[kind].nodes)))


def _constrained(cards: list[Card], numbers: dict[int, int]) -> dict[str, Ints]:
    """Node groups of the grid points of each set of SPC and SPC1 entries, such as "SPC1".

    Only the places are read, not the components that the entries constrain.
    """
    found: dict[str, set[int]] = {}
    for card in cards:
        for _, grids in held_grids(card) if card.name in ("SPC", "SPC1") else ():
            found.setdefault(f"SPC {card.text(0)}", set()).update(grids)
    groups = {}
    for name, members in found.items():
        nodes = np.array(sorted(numbers[grid] for grid in members if grid in numbers), dtype=int)
        if len(nodes):
            groups[name] = nodes
    return groups

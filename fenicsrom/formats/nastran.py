"""Nastran files (.bdf, .nas, .dat): grid points, elements, and groups by property.

`nastran_physics` takes materials, supports, masses and loads. The rest of the bulk data is listed
as not read, and the executive and case control are passed over.
"""

from collections import Counter
from pathlib import Path

import numpy as np

from fenicsrom.errors import refuse
from fenicsrom.formats.cells import with_middles
from fenicsrom.formats.mesh_file import Block, Floats, Ints, MeshFile, unsupported
from fenicsrom.formats.nastran_cards import Card, read_cards
from fenicsrom.formats.nastran_physics import TAKEN, held_grids, listed, with_physics
from fenicsrom.formats.nastran_systems import KINDS as SYSTEMS
from fenicsrom.formats.nastran_systems import Systems, read_systems
from fenicsrom.formats.reasons import said
from fenicsrom.formats.shapes import SHAPES, TETRA_FROM_VTK

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
    """Node groups of the grid points of each set of SPC and SPC1 entries, such as "SPC 1".

    Only the places are read, not the components that the entries constrain. The sides of CYJOIN
    entries are groups, too, such as "CYJOIN 1".
    """
    found: dict[str, set[int]] = {}
    for card in cards:
        for _, grids in held_grids(card) if card.name in ("SPC", "SPC1") else ():
            found.setdefault(f"SPC {card.text(0)}", set()).update(grids)
        if card.name == "CYJOIN":
            found.setdefault(f"CYJOIN {card.text(0)}", set()).update(listed(card.fields[2:]))
    groups = {}
    for name, members in found.items():
        nodes = np.array(sorted(numbers[grid] for grid in members if grid in numbers), dtype=int)
        if len(nodes):
            groups[name] = nodes
    return groups

"""Materials, supports, point masses, springs and static loads of a Nastran file."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from fenicsrom.formats.collector import Collector
from fenicsrom.formats.mesh_file import DeckLoad, Ints, MeshFile, axes_of
from fenicsrom.formats.nastran_cards import Card
from fenicsrom.formats.text import numbers_between, read_lines

SELECTED = {"SPC": "SPC", "SPC1": "SPC", "FORCE": "LOAD", "GRAV": "LOAD"}
"""The command of the case control that selects the sets of an entry."""

TAKEN = (
    *("MAT1", "PSOLID", "PELAS", "SPC", "SPC1", "CONM2", "CELAS1", "CELAS2", "FORCE", "GRAV"),
    "PARAM",
)
"""Entries from which something is taken."""


LEFT = {
    "CELAS1": " between two points that move, or about an axis",
    "CELAS2": " between two points that move, or about an axis",
    "CONM2": " with an offset or moments of inertia",
    "SPC": " with a displacement",
    "FORCE": " in another coordinate system",
    "GRAV": " in another coordinate system",
}
"""What is not taken of some entries."""


def with_physics(
    path: Path, mesh: MeshFile, cards: list[Card], numbers: Mapping[int, int]
) -> MeshFile:
    """Add what the entries say besides the mesh.

    Args:
        path: the file, whose case control selects sets.
        mesh: the mesh, whose groups of cells have the numbers of the properties.
        cards: the entries.
        numbers: index of each grid point by its number.
    """
    found, selected = Collector(), _selected(path)
    factor = next(
        (card.real(1, 1.0) for card in cards if card.name == "PARAM" and card.text(0) == "WTMASS"),
        1.0,
    )
    sets: dict[str, set[str]] = {"SPC": set(), "LOAD": set()}
    for card in cards:
        if card.name in SELECTED:
            sets[SELECTED[card.name]].add(card.text(0))
    material_of = {card.text(0): card.text(1) for card in cards if card.name == "PSOLID"}
    _sections(found, mesh, material_of)
    elastic = {
        card.text(k): card.real(k + 1)
        for card in cards
        for k in (0, 4)
        if card.name == "PELAS" and card.text(k)
    }
    left: Counter[str] = Counter()
    for card in sorted(cards, key=lambda card: not card.name.startswith("SPC")):
        command = SELECTED.get(card.name)
        if command and len(sets[command]) > 1 and selected.get(command) != card.text(0):
            left[f"{card.name} of the set {card.text(0)}"] += 1
            continue
        try:
            taken = _take(found, card, numbers, factor, elastic)
        except ValueError:
            taken = False
        if not taken:
            left[card.name + LEFT.get(card.name, "")] += 1
    for name, count in left.items():
        found.leave(f"{count} {name}")
    return found.finished(mesh)


def _selected(path: Path) -> dict[str, str]:
    """The sets that the case control selects, by command."""
    head = []
    for line in read_lines(path):
        if re.match(r"\s*BEGIN +BULK", line, flags=re.I):
            break
        head.append(line)
    pairs = re.findall(r"^\s*(SPC|LOAD)\s*=\s*(\d+)", "\n".join(head), flags=re.M | re.I)
    return {name.upper(): number for name, number in pairs}


def _sections(found: Collector, mesh: MeshFile, material_of: dict[str, str]) -> None:
    """Note which cells have which material, by the number of their property."""
    for number, block in enumerate(mesh.blocks):
        for group, cells in block.groups.items():
            if group in material_of:
                found.cells_of(f"MAT1 {material_of[group]}", mesh)[number] |= cells


def _take(
    found: Collector,
    card: Card,
    numbers: Mapping[int, int],
    factor: float,
    elastic: Mapping[str, float],
) -> bool:
    """Take what an entry says; whether all of it was understood."""
    if card.name == "MAT1":
        young, shear, poisson = (card.real(k) for k in (1, 2, 3))
        if not card.text(1):
            young = 2.0 * shear * (1.0 + poisson)
        elif not card.text(3) and shear:
            poisson = 0.5 * young / shear - 1.0
        found.constants[f"MAT1 {card.text(0)}"] = {"E": young, "nu": poisson}
        if card.text(4):
            found.constants[f"MAT1 {card.text(0)}"]["rho"] = factor * card.real(4)
    elif card.name in ("SPC", "SPC1"):
        return _support(found, card, numbers)
    elif card.name == "CONM2":
        found.masses[numbers.get(card.integer(1), -1)] += factor * card.real(3)
        return not any(card.real(k) for k in range(4, 15))
    elif card.name in ("CELAS1", "CELAS2"):
        ends = [k for k in (2, 4) if card.integer(k)]
        nodes = [numbers.get(card.integer(k), -1) for k in ends]
        components = [card.integer(k + 1) - 1 for k in ends]
        stiffness = elastic.get(card.text(1)) if card.name == "CELAS1" else card.real(1)
        return found.spring(nodes, components, stiffness)
    elif card.name in ("FORCE", "GRAV"):
        return _load(found, card, numbers)
    return True


def held_grids(card: Card) -> list[tuple[set[int], list[int]]]:
    """The components (0 to 5) and grid points that an SPC or SPC1 holds.

    Raises:
        ValueError: the entry is damaged.
    """
    if card.name == "SPC":
        held = [(card.text(k + 1), [card.integer(k)]) for k in (1, 4) if card.text(k)]
    else:
        words = [word for word in card.fields[2:] if word]
        if len(words) == 3 and words[1].upper() == "THRU":
            held = [(card.text(1), list(numbers_between(int(words[0]), int(words[2]))))]
        else:
            held = [(card.text(1), [int(word) for word in words])]
    return [({int(digit) - 1 for digit in digits}, grids) for digits, grids in held]


def _support(found: Collector, card: Card, numbers: Mapping[int, int]) -> bool:
    """Take an SPC or SPC1 without a displacement."""
    if card.name == "SPC" and (card.real(3) or card.real(6)):
        return False
    for components, grids in held_grids(card):
        name = f"SPC {card.text(0)} {axes_of(components)}"
        nodes: Ints = np.array([numbers[grid] for grid in grids if grid in numbers], dtype=int)
        found.hold(name, nodes, components)
    return True


def _load(found: Collector, card: Card, numbers: Mapping[int, int]) -> bool:
    """Take a force or gravity in the basic coordinate system."""
    is_force = card.name == "FORCE"
    first = 3 if is_force else 2
    system = card.integer(2 if is_force else 1)
    if system:
        return False
    vector = card.real(first) * np.array([card.real(first + 1 + k) for k in range(3)])
    if is_force:
        found.forces[numbers.get(card.integer(1), -1)] += vector
    else:
        found.others.append(DeckLoad("acceleration", tuple(vector.tolist())))
    return True

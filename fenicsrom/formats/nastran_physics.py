"""Materials, supports, couplings, point masses, springs and static loads of a Nastran file."""

import re
from collections import Counter, defaultdict
from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import pairwise, takewhile
from pathlib import Path

import numpy as np

from fenicsrom.errors import refuse
from fenicsrom.formats.collector import Collector, numbers_between, read_lines
from fenicsrom.formats.mesh_file import Block, DeckJoint, DeckLoad, Floats, Ints, MeshFile, axes_of
from fenicsrom.formats.nastran_cards import Card
from fenicsrom.formats.nastran_systems import Systems
from fenicsrom.formats.reasons import said
from fenicsrom.formats.shapes import STRAIGHT

_SETS = {
    "SPC": ("SPC", "SPC1", "SPCADD"),
    "MPC": ("MPC", "MPCADD"),
    "LOAD": (
        *("LOAD", "FORCE", "FORCE1", "FORCE2", "MOMENT", "MOMENT1", "MOMENT2", "GRAV", "ACCEL"),
        *("ACCEL1", "RFORCE", "PLOAD", "PLOAD1", "PLOAD2", "PLOAD4", "SLOAD", "SPCD"),
    ),
    "BCSET": ("BCTSET", "BCTADD"),
    "BGSET": ("BGSET", "BGADD"),
}
SELECTED = {name: command for command, names in _SETS.items() for name in names}
"""The command of the case control that selects the sets of an entry."""

COMBINED = ("SPCADD", "MPCADD", "LOAD", "BCTADD", "BGADD")
"""Entries that combine sets."""

RIGID = ("RBE2", "RBE3", "RBAR")
"""Entries that couple nodes."""

PARALLEL = 1e-6
"""Components of unit vectors that differ less are those of the same axes."""

MATERIALS = ("MAT1", "MAT2", "MAT3", "MAT8", "MAT9", "MAT10", "MAT11", "MAT12")

TAKEN = (
    *("PSOLID", "PSHELL", "PELAS", "CONM2", "CELAS1", "CELAS2", "PARAM", "BSURFS"),
    *MATERIALS,
    *RIGID,
    *SELECTED,
)
"""Entries from which something is taken, or which are named as left."""

LEFT = {
    "CELAS1": " between two points that move, or about an axis",
    "CELAS2": " between two points that move, or about an axis",
    "CONM2": " with an offset or moments of inertia",
    "SPC": " with a displacement",
    "PLOAD4": ": a pressure is taken if it acts on a solid, along its normal, and does not vary",
    "RBAR": " with other independent components than those of one end",
    "GRAV": " along axes that depend on the place",
    "MOMENT": ": nodes of solids do not turn",
}
"""What is not taken of some entries."""


@dataclass(eq=False)
class Deck:
    """What the entries refer to.

    Attributes:
        path: the file.
        mesh: the mesh, whose groups of cells have the numbers of the properties.
        cards: the entries.
        numbers: index of each grid point by its number.
        systems: the coordinate systems.
        found: what was collected.
        factor: factor on all masses.
        elastic: stiffness of each property of springs.
        rows: block and row of each cell by its number.
    """

    path: Path
    mesh: MeshFile
    cards: list[Card]
    numbers: dict[int, int]
    systems: Systems
    found: Collector = field(default_factory=Collector)
    factor: float = 1.0
    elastic: dict[str, float] = field(default_factory=dict)
    rows: dict[int, tuple[Block, int]] = field(default_factory=dict)

    def index(self, card: Card, field_: int) -> int:
        """The index of a grid point in a field of an entry.

        Raises:
            ValueError: the file does not have it.
        """
        number = card.integer(field_)
        if number not in self.numbers:
            raise ValueError(f"GRID {number} is not in the file")
        return self.numbers[number]


def with_physics(
    path: Path, mesh: MeshFile, cards: list[Card], numbers: dict[int, int], systems: Systems
) -> MeshFile:
    """Add what the entries say besides the mesh.

    Args:
        path: the file, whose case control selects sets.
        mesh: the mesh, whose groups of cells have the numbers of the properties.
        cards: the entries.
        numbers: index of each grid point by its number.
        systems: the coordinate systems.
    """
    deck = Deck(path, mesh, cards, numbers, systems)
    for card in cards:
        if card.name == "PARAM" and card.text(0).upper() == "WTMASS":
            deck.factor = card.real(1, 1.0)
        elif card.name == "PELAS":
            deck.elastic |= {card.text(k): card.real(k + 1) for k in (0, 4) if card.text(k)}
    for block in mesh.blocks if any(card.name in ("PLOAD4", "BSURFS") for card in cards) else ():
        deck.rows |= {int(label): (block, k) for k, label in enumerate(np.atleast_1d(block.labels))}
    _sections(deck)
    _turned(deck)
    factors = _factors(deck)
    left: Counter[str] = Counter()
    for card in sorted(cards, key=lambda card: SELECTED.get(card.name) != "SPC"):
        factor, command = 1.0, SELECTED.get(card.name)
        if card.name in COMBINED:
            continue
        if command is not None:
            factor = factors[command].get(card.text(0), 0.0)
            if not factor:
                left[f"{card.name} of the set {card.text(0)}, which the case does not use"] += 1
                continue
        try:
            taken = _take(deck, card, factor)
        except (ValueError, KeyError):
            taken = False
        if not taken:
            left[said(card.name, card.name) + LEFT.get(card.name, "")] += 1
    for name, count in left.items():
        deck.found.leave(f"{count} {name}", name.startswith("SPC"))
    return deck.found.finished(mesh)


def _selected(deck: Deck) -> dict[str, str]:
    """The sets that the case control selects for the first subcase, by command."""
    head: list[str] = []
    for line in read_lines(deck.path):
        if re.match(r"\s*BEGIN +BULK", line, flags=re.I):
            break
        head.append(line.partition("$")[0])
    parts = re.split(r"^\s*SUBCASE\b", "\n".join(head), flags=re.M | re.I)
    if len(parts) > 2:
        deck.found.leave("the subcases after the first one")
    pairs = re.findall(
        r"^\s*(SPC|MPC|LOAD|BCSET|BGSET)\s*=\s*(\d+)", "\n".join(parts[:2]), re.M | re.I
    )
    return {name.upper(): number for name, number in pairs}


def _factors(deck: Deck) -> dict[str, dict[str, float]]:
    """The factor of each set that the case uses, by command; SPCADD, MPCADD and LOAD combine sets.

    Without any selection, the only set that no other set contains is used.

    Raises:
        RecursionError: a set contains itself.
    """
    selected, found = _selected(deck), {}
    for command in _SETS:
        sets = dict.fromkeys(c.text(0) for c in deck.cards if SELECTED.get(c.name) == command)
        parts: dict[str, dict[str, float]] = {}
        for card in deck.cards:
            if card.name in COMBINED and SELECTED[card.name] == command:
                parts.setdefault(card.text(0), {}).update(_parts(card))
        inner = {name for of in parts.values() for name in of}
        outer = [name for name in sets if name not in inner]
        # sets of contacts and ties must be selected
        alone = len(outer) == 1 and not selected and command not in ("BCSET", "BGSET")
        chosen = selected.get(command, outer[0] if alone else "")
        if chosen and chosen not in sets:
            deck.found.leave(f"{command} = {chosen} of the case, which is not in the file")
        total: defaultdict[str, float] = defaultdict(float)
        for name, factor in _resolved(parts, chosen, 1.0):
            total[name] += factor
        found[command] = dict(total)
    return found


def _resolved(
    parts: dict[str, dict[str, float]], name: str, factor: float
) -> Iterator[tuple[str, float]]:
    """The sets in a set, and their factors; a set without parts is a set of entries."""
    if name not in parts:
        yield name, factor
    for part, own in parts.get(name, {}).items():
        yield from _resolved(parts, part, factor * own)


def _parts(card: Card) -> dict[str, float]:
    """The sets that an entry combines, and their factors."""
    if card.name != "LOAD":
        return {word: 1.0 for word in card.fields[1:] if word}
    found: defaultdict[str, float] = defaultdict(float)
    for k in range(2, len(card.fields) - 1, 2):
        if card.text(k + 1):
            found[card.text(k + 1)] += card.real(1) * card.real(k)
    return found


def _sections(deck: Deck) -> None:
    """Note which cells have which material, by the number of their property."""
    names = {card.text(0): _name(card) for card in deck.cards if card.name in MATERIALS}
    material_of: dict[str, str] = {}
    for card in deck.cards:
        if card.name in ("PSOLID", "PSHELL"):
            material_of[card.text(0)] = names.get(card.text(1), f"MAT {card.text(1)}")
        if card.name == "PSHELL" and card.text(2):
            if deck.found.thickness not in (None, card.real(2)):
                deck.found.leave("the thicknesses of other PSHELL")
            deck.found.thickness = deck.found.thickness or card.real(2)
    for number, block in enumerate(deck.mesh.blocks):
        deck.found.strain |= block.name.startswith("CPLSTN")
        for group, cells in block.groups.items():
            if group in material_of:
                deck.found.cells_of(material_of[group], deck.mesh)[number] |= cells


def _name(card: Card) -> str:
    """The name of an entry and its number."""
    return f"{card.name} {card.text(0)}"


def _turned(deck: Deck) -> None:
    """Note the grid points whose displacements are along the axes of another system."""
    default = next((card for card in deck.cards if card.name == "GRDSET"), Card("GRDSET"))
    for card in deck.cards:
        if card.name == "GRID":
            node = deck.index(card, 0)
            system = card.integer(5, default.integer(5))
            if system > 0:
                axes = deck.systems.axes(system, deck.mesh.points[node])
                if not np.allclose(axes, np.eye(3), atol=PARALLEL):
                    deck.found.turned.add(node)
    for card in deck.cards:
        if card.name == "GRID" and (held := card.text(6) or default.text(6)):
            components = _components(held)
            name = f"GRID {axes_of(components)}"
            deck.found.hold(name, [deck.index(card, 0)], components)


def _components(digits: str) -> set[int]:
    """The components (0 to 5) of digits such as 123."""
    return {int(digit) - 1 for digit in digits if digit != "0"}


def _take(deck: Deck, card: Card, factor: float) -> bool:
    """Take what an entry says; whether all of it was understood.

    Args:
        deck: the deck.
        card: the entry.
        factor: factor on loads.
    """
    found = deck.found
    if card.name in MATERIALS:
        found.constants[_name(card)].update(_constants(card, deck.factor))
    elif card.name in ("SPC", "SPC1"):
        return _support(deck, card)
    elif card.name in RIGID:
        return _couple(deck, card)
    elif card.name == "MPC":
        terms = [
            (deck.index(card, k), card.integer(k + 1) - 1)
            for first in range(1, len(card.fields), 8)
            for k in (first, first + 3)
            if card.text(k)
        ]
        found.couplings.add("MPC", "MPC", terms)
    elif card.name == "CONM2":
        found.masses[deck.numbers.get(card.integer(1), -1)] += deck.factor * card.real(3)
        return not any(card.real(k) for k in range(4, 15))
    elif card.name in ("CELAS1", "CELAS2"):
        return _spring(deck, card)
    elif SELECTED.get(card.name) == "LOAD":
        return _load(deck, card, factor)
    elif card.name in ("BCTSET", "BGSET"):
        _join(deck, card)
    return True


def _constants(card: Card, factor: float) -> dict[str, float]:
    """The constants of an isotropic material; none of another one."""
    if card.name != "MAT1":
        return {}
    young, shear, poisson = (card.real(k) for k in (1, 2, 3))
    if not card.text(1):
        young = 2.0 * shear * (1.0 + poisson)
    elif not card.text(3) and shear:
        poisson = 0.5 * young / shear - 1.0
    density = {"rho": factor * card.real(4)} if card.text(4) else {}
    return {"E": young, "nu": poisson} | density


def held_grids(card: Card) -> list[tuple[set[int], list[int]]]:
    """The components (0 to 5) and grid points that an SPC or SPC1 holds.

    Raises:
        ValueError: the entry is damaged.
    """
    if card.name == "SPC":
        held = [(card.text(k + 1), [card.integer(k)]) for k in (1, 4) if card.text(k)]
    else:
        held = [(card.text(1), listed(card.fields[2:]))]
    return [(_components(digits), grids) for digits, grids in held]


def listed(words: list[str]) -> list[int]:
    """Numbers, and ranges of numbers with THRU.

    Raises:
        ValueError: a word is no number.
    """
    found: list[int] = []
    given = [word for word in words if word]
    for k, word in enumerate(given):
        if word.upper() == "THRU":
            found += numbers_between(found[-1] + 1, int(given[k + 1]) - 1)
        else:
            found.append(int(word))
    return found


def _support(deck: Deck, card: Card) -> bool:
    """Take an SPC or SPC1 without a displacement."""
    if card.name == "SPC" and (card.real(3) or card.real(6)):
        return False
    for components, grids in held_grids(card):
        name = f"SPC {card.text(0)} {axes_of(components)}".strip()
        nodes = [deck.numbers[grid] for grid in grids if grid in deck.numbers]
        deck.found.hold(name, nodes, components)
    return True


def _couple(deck: Deck, card: Card) -> bool:
    """Take a rigid element, or the mean of RBE3 as an equation of its reference node."""
    name, couplings, x = _name(card), deck.found.couplings, deck.mesh.points
    every = set(range(6))
    if card.name == "RBE2":
        words = list(takewhile(str.isalnum, filter(None, card.fields[3:])))  # then an expansion
        nodes = np.array([deck.numbers[grid] for grid in listed(words)], dtype=np.int64)
        held = _components(card.text(2))
        couplings.rigid("RBE2", name, deck.index(card, 1), nodes, held, x)
        return True
    if card.name == "RBAR":
        ends = deck.index(card, 1), deck.index(card, 2)
        for k in (0, 1):
            if _components(card.text(3 + k)) == every:
                held = _components(card.text(6 - k)) or every
                couplings.rigid("RBAR", name, ends[k], np.array([ends[1 - k]]), held, x)
                return True
        return False
    weights: dict[int, float] = {}
    weight = 0.0
    words = [word for word in card.fields[4:] if word]
    for before, word in pairwise(["", *takewhile(lambda w: w not in ("UM", "ALPHA"), words)]):
        if not word.isdigit():
            weight = Card("", [word]).real(0)
        elif before.isdigit():  # the components follow a weight
            weights[deck.numbers[int(word)]] = weight
        elif not _components(word) >= {0, 1, 2}:
            return False
    nodes, factors = np.array(list(weights)), np.array(list(weights.values()))
    couplings.mean("RBE3", name, deck.index(card, 2), nodes, factors)
    return True


def _spring(deck: Deck, card: Card) -> bool:
    """Take a CELAS1 or CELAS2 to the ground or to a held grid point."""
    ends = [k for k in (2, 4) if card.integer(k)]
    nodes = [deck.numbers.get(card.integer(k), -1) for k in ends]
    components = [card.integer(k + 1) - 1 for k in ends]
    stiffness = deck.elastic.get(card.text(1)) if card.name == "CELAS1" else card.real(1)
    return deck.found.spring(nodes, components, stiffness)


def _load(deck: Deck, card: Card, factor: float) -> bool:
    """Take a force, gravity or a pressure times a factor."""
    if card.name == "FORCE":
        node = deck.index(card, 1)
        vector = factor * card.real(3) * _vector(deck, card, 2, 4, node)
        deck.found.forces[node] += vector
    elif card.name == "FORCE1":
        node, start, end = (deck.index(card, k) for k in (1, 3, 4))
        along = deck.mesh.points[end] - deck.mesh.points[start]
        deck.found.forces[node] += factor * card.real(2) * along / np.linalg.norm(along)
    elif card.name == "GRAV":
        vector = factor * card.real(2) * _vector(deck, card, 1, 3, None)
        deck.found.others.append(DeckLoad("acceleration", tuple(vector.tolist())))
    elif card.name == "PLOAD4":
        return _pressure(deck, card, factor)
    else:
        return False
    return True


def _vector(deck: Deck, card: Card, system: int, first: int, node: int | None) -> Floats:
    """A vector (3,) of an entry in the basic system.

    Args:
        deck: the deck.
        card: the entry.
        system: field of its coordinate system.
        first: field of its first component.
        node: the node at which it acts; None for the origin.

    Raises:
        ValueError: the axes of the system depend on a place.
    """
    vector = np.array([card.real(first + k) for k in range(3)])
    if not card.integer(system):
        return vector
    place = None if node is None else deck.mesh.points[node]
    return np.asarray(vector @ deck.systems.axes(card.integer(system), place))


def _pressure(deck: Deck, card: Card, factor: float) -> bool:
    """Take a PLOAD4 of one pressure along the inner normal of solids.

    Raises:
        ValueError: the entry does not say on which face it acts.
    """
    pressures = {card.real(k, card.real(2)) for k in (2, 3, 4, 5)}
    if len(pressures) > 1 or any(card.real(k) for k in (9, 10, 11)) or not card.text(6).isdigit():
        return False
    block, row = deck.rows.get(card.integer(1), (None, 0))
    if block is None:
        raise refuse(deck.path, f"PLOAD4 refers to the element {card.text(1)}, not in the file")
    given = [deck.index(card, k) for k in (6, 7) if card.text(k)]
    face = _face(block, block.nodes[row], given)
    straight = Block(STRAIGHT[2, len(face)], np.array([face]))
    deck.found.pressures[factor * card.real(2)].append(straight)
    return True


def _join(deck: Deck, card: Card) -> None:
    """Take the contacts of a BCTSET, or the ties of a BGSET, one on each line.

    Raises:
        ValueError: the entry is damaged.
    """
    found, tied = deck.found, card.name == "BGSET"
    for at in range(1, len(card.fields), 8):
        pair = [f"surface {card.text(k)}" for k in (at, at + 1)]
        for name in pair:
            if name not in found.surfaces:
                found.surfaces[name] = _facets(deck, name)
        if missing := [name for name in pair if not found.surfaces[name]]:
            found.leave(f"{_name(card)}: {missing[0]} has no faces of solids (BSURFS)")
            continue
        joint = DeckJoint(
            _name(card),
            *pair,
            tied=tied,
            reach=card.real(at + 2 if tied else at + 4) or None,
            friction=0.0 if tied else card.real(at + 2),
        )
        found.joints.append(joint)


def _facets(deck: Deck, surface: str) -> list[Block]:
    """The facets of a BSURFS: after three blank fields, cells and three corners of their faces.

    Raises:
        ValueError, KeyError: the entry is damaged.
    """
    faces = []
    for card in deck.cards:
        if card.name == "BSURFS" and f"surface {card.text(0)}" == surface:
            for at in range(4, len(card.fields), 4):
                block, row = deck.rows[card.integer(at)]
                corners = {deck.index(card, at + k) for k in (1, 2, 3)}
                sides = (block.nodes[row][list(side)] for side in block.shape.facets)
                faces += [side for side in sides if corners <= set(side.tolist())]
    rows = [[side for side in faces if len(side) == width] for width in (3, 4)]
    return [
        Block(STRAIGHT[2, len(of[0])], np.array(of), {surface: np.full(len(of), True)})
        for of in rows
        if of
    ]


def _face(block: Block, nodes: Ints, given: list[int]) -> list[int]:
    """The corners of the face of a cell that a PLOAD4 means.

    The entry gives opposite corners of a quadrilateral, a corner of a triangle, or a corner of the
    face of a tetrahedron and the corner that is not on it.

    Raises:
        ValueError: there is no such face.
    """
    for facet in block.shape.facets if block.shape.dimension == 3 else ():
        face = nodes[list(facet)].tolist()
        if block.shape.corners == 4:
            found = len(given) == 2 and given[0] in face and given[1] not in face
        elif len(face) == 4:
            found = set(given) in ({face[0], face[2]}, {face[1], face[3]})
        else:
            found = len(given) == 1 and given[0] in face
        if found:
            return [int(node) for node in face]
    raise ValueError("the entry does not say on which face the pressure acts")

"""CalculiX decks (.inp), written: mesh, supports, materials, loads, rotation and modes.

A deck has up to three steps: the equilibrium under the static loads and the rotation, the natural
frequencies about it, and a transient of average acceleration under the loads that vary in time.
With NLGEOM, CalculiX uses the same material as this program: the second Piola-Kirchhoff stress is
linear in the Green-Lagrange strain. The step of frequencies then contains the stress stiffening and
the spin softening of the equilibrium.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np

from fenicsrom.arrays import Array
from fenicsrom.files import atomic_write
from fenicsrom.formats.mesh_file import Ints, MeshFile
from fenicsrom.formats.shapes import SHAPES, from_vtk
from fenicsrom.online.stress.stress import axes
from fenicsrom.scene import Elasticity

ELEMENTS = {
    **{(kind, None): f"C3D{SHAPES[kind].nodes}" for kind in (4, 11, 5, 17)},
    **{(kind, "stress"): f"CPS{SHAPES[kind].nodes}" for kind in (2, 9, 3, 16)},
    **{(kind, "strain"): f"CPE{SHAPES[kind].nodes}" for kind in (2, 9, 3, 16)},
}
"""Types of elements by the kind of the cells and the plane state."""

ENTRIES = 10
"""Numbers in a line of a set or an element; CalculiX reads at most 16."""

FIELD = 20
"""Characters of a number that CalculiX reads; it ignores the others, the exponent included."""

TOLERANCE = 1e-7
"""Residual and correction of CalculiX's Newton iteration, relative to mean force and displacement.

Its default of 0.005 and 0.01 leaves errors of 1e-3 in displacements.
"""

LONGEST_NAME = 70
"""Number of characters of the name of a set; CalculiX reads at most 80."""


Equation = tuple[int, tuple[tuple[int, float], ...]]
"""A node, and components with factors whose sum of products with the displacement vanishes.

CalculiX removes the first component.
"""


class Pressed(NamedTuple):
    """A pressure that follows the deformation.

    Attributes:
        cells: the cells (k,) on which it acts.
        faces: (k,) their faces, as `shapes` counts them.
        size: Pa.
    """

    cells: Ints
    faces: Ints
    size: float


class Section(NamedTuple):
    """The cells of one material.

    Attributes:
        cells: their numbers (k,).
        material: the material, in SI units.
        thickness: thickness, m, in 2D only.
    """

    cells: Ints
    material: Elasticity
    thickness: float


class Transient(NamedTuple):
    """A transient with a fixed step, from rest at the equilibrium.

    Attributes:
        times: (s,) ends of the steps, from 0, s.
        factors: (s, loads) sizes of the loads at these times.
        forces: (loads, n, d) forces of loads of size 1, N.
    """

    times: Array
    factors: Array
    forces: Array


class CutSector(NamedTuple):
    """A sector of a disk.

    Attributes:
        number: sectors of the disk.
        following: (k,) the nodes of the cut face whose displacements follow from the other one.
        leading: (l,) the nodes of the other one.
        axis: (2, 3) two points of the axis, m.
        waves: the nodal diameters whose modes are wanted, ascending.
    """

    number: int
    following: Ints
    leading: Ints
    axis: Array
    waves: tuple[int, ...]


@dataclass(frozen=True, kw_only=True, eq=False)
class Deck:
    """The content of a deck, in SI units.

    Attributes:
        title: first line of the deck.
        notes: one sentence for each part of the scene that the deck leaves out.
        mesh: nodes, one block of cells, its groups and the groups of nodes.
        plane: "stress" or "strain" in 2D.
        sections: the materials.
        clamped: (n, d) whether a component of a node is clamped.
        equations: the nodes that are held along directions which are not axes.
        masses: (n,) concentrated masses, kg.
        springs: (n, d) stiffness of springs to the ground, N/m.
        forces: (n, d) dead forces, N.
        pressures: pressures that follow the deformation.
        omega_squared: Ω², rad²/s².
        axis: (2, 3) a point of the axis of rotation, and its unit vector.
        nonlinear: whether the equilibrium is geometrically nonlinear.
        modes: number of natural frequencies.
        printed: numbers (k,) of the nodes whose displacements are printed.
        transient: the transient; None without loads that vary in time.
        sector: the cut faces, if the body is a sector of a disk.
    """

    title: str
    notes: tuple[str, ...]
    mesh: MeshFile
    plane: str | None
    sections: tuple[Section, ...]
    clamped: Array
    equations: tuple[Equation, ...]
    masses: Array
    springs: Array
    forces: Array
    pressures: tuple[Pressed, ...]
    omega_squared: float
    axis: Array
    nonlinear: bool
    modes: int
    printed: Ints
    transient: Transient | None = None
    sector: CutSector | None = None

    @property
    def element(self) -> str:
        """The type of the elements."""
        return ELEMENTS[self.mesh.blocks[0].kind, self.plane]

    @property
    def loaded(self) -> bool:
        """Whether forces or the rotation deform the body."""
        return bool(np.any(self.forces)) or bool(self.pressures) or self.omega_squared > 0.0


def write_deck(path: Path, deck: Deck) -> None:
    """Write a deck.

    Raises:
        OSError: the file cannot be written.
    """
    with atomic_write(path) as temporary:
        temporary.write_text("\n".join([*_lines(deck), ""]), encoding="utf-8")


def _lines(deck: Deck) -> Iterator[str]:
    """The lines of a deck."""
    yield "*HEADING"
    yield _plain(deck.title) or "a scene of fenicsrom"
    yield "** SI units; *CLOAD holds the work-equivalent forces of the loads"
    yield from (f"** {_plain(note)}" for note in deck.notes)
    names = _Names()
    every, cells = names.new("ALL_NODES"), names.new("ALL_CELLS")
    printed = names.new("PROBE")
    yield from _mesh(deck, every, cells, names)
    yield from _attachments(deck, names)
    yield from _sections(deck, names)
    if len(deck.printed):
        yield from _set("NSET", printed, deck.printed)
    clamped = deck.clamped.copy()
    if deck.sector is not None:
        yield from _cyclic(deck.sector, names)
        clamped[deck.sector.following] = False  # CalculiX allows one condition of a displacement
    if clamped.any():
        yield "*BOUNDARY"
    for axis, component in enumerate(clamped.T, 1):
        yield from (f"{1 + node}, {axis}, {axis}" for node in np.flatnonzero(component))
    for node, terms in deck.equations:
        entries = [f"{1 + node}, {1 + axis}, {_number(factor)}" for axis, factor in terms]
        yield from ["*EQUATION", str(len(entries)), ", ".join(entries)]
    amplitudes = []
    if deck.transient is not None:
        for factors in deck.transient.factors.T:
            amplitudes.append(names.new("LOAD"))
            yield f"*AMPLITUDE, NAME={amplitudes[-1]}"
            yield from map(_pair, deck.transient.times, factors)
    output = ["*NODE FILE", "U"]
    if len(deck.printed):
        output = [f"*NODE PRINT, NSET={printed}", "U", *output]
    if deck.loaded:
        yield f"*STEP{', NLGEOM, INC=1000' if deck.nonlinear else ''}"
        if deck.nonlinear:
            yield from ["*CONTROLS, PARAMETERS=FIELD", f"{TOLERANCE}, {TOLERANCE}"]
        yield "*STATIC"
        yield from _loads(deck, cells)
        yield from [*output, "*EL FILE", "S, ENER" if deck.transient else "S", "*END STEP"]
    about = deck.loaded and deck.nonlinear
    # CalculiX integrates in time only if the first step asks for the energy
    energy = ["*EL FILE", "ENER"] if deck.transient and not deck.loaded else []
    for wave in (None,) if deck.sector is None else deck.sector.waves:
        yield from [f"*STEP{', PERTURBATION' if about else ''}", "*FREQUENCY"]
        yield str(deck.modes if wave is None else 2 * deck.modes)  # each wave goes both ways
        if wave is not None:
            yield f"*SELECT CYCLIC SYMMETRY MODES, NMIN={wave}, NMAX={wave}"
        yield from ["*NODE FILE", "U", *energy, "*END STEP"]
    if deck.transient is not None:
        yield from _transient(deck, deck.transient, amplitudes, output)


def _cyclic(sector: CutSector, names: _Names) -> Iterator[str]:
    """The cut faces, and how they make a disk."""
    faces = []
    for name, nodes in (("FOLLOWING", sector.following), ("LEADING", sector.leading)):
        faces.append(names.new(name))
        yield from _set("NSET", faces[-1], nodes)
        yield from [f"*SURFACE, NAME={faces[-1]}_FACE, TYPE=NODE", faces[-1]]
    yield from ["*TIE, CYCLIC SYMMETRY, NAME=CUT_FACES", ", ".join(f"{f}_FACE" for f in faces)]
    yield f"*CYCLIC SYMMETRY MODEL, N={sector.number}, NGRAPH=1, TIE=CUT_FACES"
    yield ", ".join(map(_number, sector.axis.ravel()))


def _transient(
    deck: Deck, transient: Transient, amplitudes: list[str], output: list[str]
) -> Iterator[str]:
    """The step of a transient; the static loads go on."""
    times = transient.times
    yield f"*STEP{', NLGEOM' if deck.nonlinear else ''}, INC={10 * times.size}"
    if deck.nonlinear:
        yield from ["*CONTROLS, PARAMETERS=FIELD", f"{TOLERANCE}, {TOLERANCE}"]
    yield from ["*DYNAMIC, DIRECT, ALPHA=0.", _pair(times[1] - times[0], times[-1])]
    for name, forces in zip(amplitudes, transient.forces, strict=True):
        yield f"*CLOAD, AMPLITUDE={name}"
        yield from _forces(forces)
    yield from [*output, "*END STEP"]


def _forces(forces: Array) -> Iterator[str]:
    """The lines of nodal forces (n, d)."""
    for node, axis in np.argwhere(forces != 0.0):
        yield f"{1 + node}, {1 + axis}, {_number(forces[node, axis])}"


def _pair(first: float, second: float) -> str:
    """A line of two numbers."""
    return f"{_number(first)}, {_number(second)}"


def _mesh(deck: Deck, every: str, cells: str, names: _Names) -> Iterator[str]:
    """Nodes, elements and the sets of both."""
    yield f"*NODE, NSET={every}"
    for number, point in enumerate(deck.mesh.points, 1):
        yield ", ".join([str(number), *map(_number, point)])
    (block,) = deck.mesh.blocks
    yield f"*ELEMENT, TYPE={deck.element}, ELSET={cells}"
    order = from_vtk(block.kind, np.arange(block.nodes.shape[1])[None])[0]
    nodes = block.nodes[:, np.argsort(order)]
    for number, row in enumerate(nodes, 1):
        yield from _rows([number, *(1 + row)])
    for name, marks in block.groups.items():
        yield from _set("ELSET", names.new(name), np.flatnonzero(marks))
    for name, group in deck.mesh.node_groups.items():
        yield from _set("NSET", names.new(name), group)


def _attachments(deck: Deck, names: _Names) -> Iterator[str]:
    """Concentrated masses, and springs to the ground."""
    number = len(deck.mesh.blocks[0].nodes)
    sizes_of = [("MASS", "MASS", deck.masses, list[str]())]
    for axis, component in enumerate(deck.springs.T, 1):
        sizes_of.append(("SPRING", "SPRING1", component, [str(axis)]))
    for kind, element, sizes, lines in sizes_of:
        for size in np.unique(sizes[sizes > 0.0]):
            name = names.new(kind)
            yield f"*ELEMENT, TYPE={element}, ELSET={name}"
            for node in np.flatnonzero(sizes == size):
                number += 1
                yield f"{number}, {1 + node}"
            yield from [f"*{kind}, ELSET={name}", *lines, _number(size)]


def _sections(deck: Deck, names: _Names) -> Iterator[str]:
    """Materials with their axes, and the cells of each material."""
    for number, section in enumerate(deck.sections, 1):
        name, cells = f"MATERIAL_{number}", names.new(f"CELLS_{number}")
        yield from _set("ELSET", cells, section.cells)
        yield f"*MATERIAL, NAME={name}"
        material, oriented = section.material, ""
        if material.is_isotropic:
            yield from ["*ELASTIC", ", ".join(map(_number, material.isotropic_constants))]
        else:
            values = [_number(value) for part in material.orthotropic_constants for value in part]
            yield from ["*ELASTIC, TYPE=ENGINEERING CONSTANTS", ", ".join(values[:8]), values[8]]
        yield from ["*DENSITY", _number(material.density)]
        if not material.is_isotropic:
            yield f"*ORIENTATION, NAME=AXES_{number}, SYSTEM=RECTANGULAR"
            yield ", ".join(map(_number, axes(material)[:, :2].T.reshape(-1)))
            oriented = f", ORIENTATION=AXES_{number}"
        yield f"*SOLID SECTION, ELSET={cells}, MATERIAL={name}{oriented}"
        if deck.plane is not None:
            yield _number(section.thickness)


def _loads(deck: Deck, cells: str) -> Iterator[str]:
    """Dead forces, pressures and the centrifugal force."""
    if np.any(deck.forces):
        yield "*CLOAD"
        yield from _forces(deck.forces)
    for pressed in deck.pressures:
        yield "*DLOAD"
        for cell, face in zip(pressed.cells, pressed.faces, strict=True):
            yield f"{1 + cell}, P{1 + face}, {_number(pressed.size)}"
    if deck.omega_squared > 0.0:
        numbers = ", ".join(map(_number, (deck.omega_squared, *deck.axis.reshape(-1))))
        first = 1 + len(deck.mesh.blocks[0].nodes)  # the masses are the elements after the cells
        masses = range(first, first + np.count_nonzero(deck.masses > 0.0))
        yield "*DLOAD"
        yield from (f"{elements}, CENTRIF, {numbers}" for elements in (cells, *masses))


class _Names:
    """Names of sets, which CalculiX compares without regard to case."""

    def __init__(self) -> None:
        """Start without names."""
        self._taken: set[str] = set()

    def new(self, name: str) -> str:
        """A name of letters, digits and underscores that no other set has."""
        plain = re.sub(r"[^A-Za-z0-9_]", "_", name)[:LONGEST_NAME]
        found, number = plain, 1
        while found.upper() in self._taken:
            number += 1
            found = f"{plain}_{number}"
        self._taken.add(found.upper())
        return found


def _set(kind: str, name: str, members: Ints) -> Iterator[str]:
    """A set of nodes or elements, counted from 0 here and from 1 in the deck."""
    yield f"*{kind}, {kind}={name}"
    for start in range(0, len(members), ENTRIES):
        yield ", ".join(str(1 + entry) for entry in members[start : start + ENTRIES])


def _rows(numbers: Sequence[int]) -> Iterable[str]:
    """One entry of many numbers, continued by commas at the ends of its lines."""
    parts = [numbers[k : k + ENTRIES] for k in range(0, len(numbers), ENTRIES)]
    lines = [", ".join(map(str, part)) for part in parts]
    return [*(f"{line}," for line in lines[:-1]), lines[-1]]


def _number(value: float) -> str:
    """A number in the characters that CalculiX reads, with 14 digits at least."""
    text = repr(float(value))
    return text if len(text) <= FIELD else f"{value:.13e}"


def _plain(text: str) -> str:
    """Text in one line of printable ASCII characters, which is not read as a keyword."""
    return "".join(c if c.isascii() and c.isprintable() else " " for c in text).strip(" *")[:200]

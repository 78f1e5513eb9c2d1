"""The units in which a scene is written, and its conversion to SI units.

A unit of the reference of the keys is a product of powers of N, Pa, kg, m and s. The numbers of a
scene are in the same product of the units of [units]: with mm, t and s, a force is in N, a stress
in MPa and a density in t/mm³. Radians, Hz and rev/min stay as they are. The conversion is that of
decimal numbers, so that 7.85e-9 t/mm³ becomes exactly 7850 kg/m³.

The units of a deck, which does not name them, from its materials and its gravity.

Young's modulus has the unit M / (L T²) and the density M / L³, with the units L, M and T of length,
mass and time. Numbers in the units of one system are those of a known solid in few others. The
gravity, L / T², may tell these apart.
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from decimal import Decimal
from typing import Annotated, Any

from fenicsrom.scene.base import rules
from fenicsrom.scene.base.rules import choice, is_number, is_sequence
from fenicsrom.scene.base.tables import keys, table_kind

INCH, FOOT, POUND = Decimal("0.0254"), Decimal("0.3048"), Decimal("4.4482216152605")
"""An inch and a foot in m, and a pound of force in N."""

LENGTHS, MASSES, TIMES = (
    {
        **{"m": Decimal(1), "cm": Decimal("1e-2"), "mm": Decimal("1e-3"), "um": Decimal("1e-6")},
        **{"in": INCH, "ft": FOOT},
    },
    {
        **{"kg": Decimal(1), "g": Decimal("1e-3"), "t": Decimal("1e3")},
        **{"slinch": POUND / INCH, "slug": POUND / FOOT},
    },
    {"s": Decimal(1), "ms": Decimal("1e-3")},
)
"""Units of length, mass and time in SI units; a slinch is a lbf s²/in, a slug a lbf s²/ft."""

DERIVED = {
    **{
        (f"{factor:g}", unit): f"{prefix}{unit}"
        for prefix, factor in {"": 1, "k": 1e3, "M": 1e6, "G": 1e9, "m": 1e-3, "µ": 1e-6}.items()
        for unit in ("N", "Pa")
    },
    (f"{POUND:.6g}", "N"): "lbf",
    (f"{POUND / INCH**2:.6g}", "Pa"): "psi",
    (f"{POUND / FOOT**2:.6g}", "Pa"): "psf",
}
"""Names of units of force and stress by their size in SI units."""

BASE = {
    "m": (1, 0, 0),
    "kg": (0, 1, 0),
    "s": (0, 0, 1),
    "N": (1, 1, -2),
    "Pa": (-1, 1, -2),
    "rad": (0, 0, 0),
    "–": (0, 0, 0),
    "1": (0, 0, 0),
}
"""Powers of length, mass and time in the units of the keys."""

FIXED = ("", "Hz", "rev/min")
"""Units of keys that do not depend on the units of the scene."""

REGIONAL = ("preload", "normal_stiffness", "tangential_stiffness")
"""Keys of a contact that are per area if the contact is at all nodes of a region."""

PER_AREA = {"N": "N/m²", "N/m": "N/m³", "N s/m": "N s/m³"}
"""Units of numbers of a point, and of the numbers of a region."""


@dataclass(frozen=True, kw_only=True)
class Units:
    """The units of the numbers of the scene; results are in SI units.

    Attributes:
        length: unit of length, also of the mesh file without `geometry.scale`. A .geo file is in m.
        mass: unit of mass.
        time: unit of time.
        si: whether the numbers are in SI units already, as in stored scenes.
    """

    length: Annotated[str, choice(*LENGTHS)] = "m"
    mass: Annotated[str, choice(*MASSES)] = "kg"
    time: Annotated[str, choice(*TIMES)] = "s"
    si: Annotated[bool, rules.flag] = False

    def factor(self, unit: str) -> Decimal:
        """The factor by which a number in these units is multiplied to be in SI units."""
        found = Decimal(1)
        if unit in FIXED:
            return found
        own = (LENGTHS[self.length], MASSES[self.mass], TIMES[self.time])
        over, _, under = unit.partition("/")
        for part, sign in ((over, 1), (under, -1)):
            for name, exponent in re.findall(r"([A-Za-z1–]+)([²³]?)", part):
                power = sign * {"": 1, "²": 2, "³": 3}[exponent]
                for size, times in zip(own, BASE[name], strict=True):
                    found *= size ** (power * times)
        return found

    def name_of(self, unit: str) -> str:
        """The unit in which the scene gives a number, such as "MPa" for "Pa" and "mm" for "m"."""
        own = {"m": self.length, "kg": self.mass, "s": self.time}
        for name in ("N", "Pa"):
            size = f"{float(self.factor(name)):.6g}"
            own[name] = DERIVED.get((size, name), f"{size} {name}")
        if unit in FIXED:
            return unit
        return re.sub(r"[A-Za-z]+", lambda match: own.get(match[0], match[0]), unit)

    def in_si(self, value: Any, unit: str) -> Any:
        """A number, or the numbers in lists, in SI units; other values stay as they are."""
        if is_sequence(value):
            return [self.in_si(entry, unit) for entry in value]
        factor = self.factor(unit)
        if factor == 1 or not is_number(value):
            return value
        return float(Decimal(repr(value)) * factor)

    def from_si(self, value: Any, unit: str) -> Any:
        """A number in SI units in these units; other values stay as they are."""
        factor = self.factor(unit)
        if factor == 1 or not is_number(value):
            return value
        return float(Decimal(repr(value)) / factor)

    def per_region(self, value: float, unit: str, unit_lengths: int) -> str:
        """A number of a region as the scene gives it, such as `20 N/mm per node`.

        Args:
            value: the number per area in SI units (`fenicsrom.online.contact.points.shares`).
            unit: the unit of this number at a point.
            unit_lengths: 0 of facets, 1 of edges, 2 of nodes.
        """
        given = self.from_si(value, PER_AREA[unit])
        return f"{given:g} {self.name_of(unit)} per {self.region(unit_lengths)}"

    def region(self, unit_lengths: int) -> str:
        """The unit of a region: of facets (0), edges (1) or nodes (2)."""
        return (f"{self.length}² of facets", f"{self.length} of edges", "node")[unit_lengths]

    def rows_in_si(self, rows: Any, unit: str) -> Any:
        """The rows of a table in SI units, whose columns have the units in a list with commas."""
        if not is_sequence(rows):
            return rows
        units = unit.split(", ")
        return [list(map(self.in_si, row, units)) if is_sequence(row) else row for row in rows]

    @property
    def names(self) -> str:
        """The units of length, mass, time, force and stress, as in "mm, t, s, N, MPa"."""
        return ", ".join(map(self.name_of, ("m", "kg", "s", "N", "Pa")))

    @property
    def is_si(self) -> bool:
        """Whether the scene is written in SI units."""
        return self.names == Units().names


def table_in_si(table: Mapping[str, Any], kind: type, units: Units) -> dict[str, Any]:
    """The plain data of a table in SI units.

    Args:
        table: the data; values that the table does not allow stay as they are.
        kind: the dataclass that describes the table.
        units: the units of its numbers.
    """
    rules_of = {name: rule for name, rule, *_ in keys(kind)}
    whole = table.get("at") == "nodes" or "against" in table
    region = whole and "normal_stiffness" in rules_of
    found = {}
    for name, value in table.items():
        rule = rules_of.get(name)
        inner = table_kind(rule) if rule is not None else None
        if rule is None:
            found[name] = value
        elif inner is not None and isinstance(value, Mapping):
            found[name] = table_in_si(value, inner, units)
        elif inner is not None and is_sequence(value):
            found[name] = [
                table_in_si(entry, inner, units) if isinstance(entry, Mapping) else entry
                for entry in value
            ]
        elif "," in rule.unit:
            found[name] = units.rows_in_si(value, rule.unit)
        else:
            unit = PER_AREA[rule.unit] if region and name in REGIONAL else rule.unit
            found[name] = units.in_si(value, unit)
    return found


SYSTEMS = (
    Units(),
    Units(length="mm", mass="t"),
    Units(length="mm", mass="kg"),
    Units(length="in", mass="slinch"),
    Units(length="mm", mass="kg", time="ms"),
    Units(length="mm", mass="g", time="ms"),
    Units(length="m", mass="t"),
    Units(length="cm", mass="g"),
    Units(length="mm", mass="g"),
    Units(length="um", mass="kg"),
    Units(length="ft", mass="slug"),
)
"""Systems of units in which decks are written, the usual ones first."""

SOLIDS = (
    *((2.05e11, 7850.0), (1.15e11, 7200.0), (7e10, 2700.0), (1.14e11, 4450.0)),  # steel to titanium
    *((4.5e10, 1800.0), (1.2e11, 8900.0), (4e11, 19300.0), (1.6e10, 11300.0)),  # Mg, Cu, W, Pb
    *((2.9e11, 1850.0), (1.6e11, 2330.0), (7.9e10, 19300.0)),  # beryllium, silicon, gold
    *((3.7e11, 3600.0), (2.1e11, 6000.0), (3e10, 2400.0)),  # ceramics, zirconia, concrete
    *((1e11, 1600.0), (3e10, 1900.0), (1.1e10, 500.0)),  # fibres of carbon and glass, wood
    *((2.5e9, 1200.0), (8e9, 1400.0), (9e8, 950.0), (5e6, 1100.0)),  # polymers, rubber
)
"""Young's moduli in Pa and densities in kg/m³ of solids."""

NEAR = 1.6
"""Numbers that differ by a smaller factor are those of the same solid."""

GRAVITY, NEAR_GRAVITY = 9.81, 1.01
"""Acceleration of gravity, m/s², and the factor by which that of a deck may differ."""

Elastic = tuple[float, float | None]
"""Young's modulus and density, or None, in unknown units."""


def likely_systems(materials: Sequence[Elastic], gravity: Sequence[float] = ()) -> list[Units]:
    """The systems of units in which most of the materials are known solids, the likely one first.

    Args:
        materials: the materials.
        gravity: sizes of accelerations.
    """
    fits = {
        system: sum(_is_known(system, *material) for material in materials) for system in SYSTEMS
    }
    found = [system for system in SYSTEMS if fits[system] == max(fits.values()) > 0]
    earthly = [
        system
        for system in found
        if any(_near(system.in_si(size, "m/s²"), GRAVITY, NEAR_GRAVITY) for size in gravity)
    ]
    return earthly or found


def _is_known(system: Units, young: float, density: float | None) -> bool:
    """Whether a material is a known solid in a system of units."""
    modulus = system.in_si(young, "Pa")
    mass = None if density is None else system.in_si(density, "kg/m³")
    return any(
        _near(modulus, solid, NEAR) and (mass is None or _near(mass, heavy, NEAR))
        for solid, heavy in SOLIDS
    )


def _near(value: float, other: float, factor: float) -> bool:
    return other / factor <= value <= other * factor

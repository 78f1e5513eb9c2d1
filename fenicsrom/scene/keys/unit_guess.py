"""The units of a deck, which does not name them, from its materials and its gravity.

Young's modulus has the unit M / (L T²) and the density M / L³, with the units L, M and T of length,
mass and time. Numbers in the units of one system are those of a known solid in few others. The
gravity, L / T², may tell these apart.
"""

from collections.abc import Sequence

from fenicsrom.scene.keys.unit_system import Units

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

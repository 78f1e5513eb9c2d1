"""The units of decks, guessed from materials and gravity."""

from __future__ import annotations

import pytest

from fenicsrom.scene.keys.unit_system import Units, likely_systems


@pytest.mark.parametrize(
    ("young", "density", "names"),
    [
        (2.1e11, 7850.0, "m, kg, s, N, Pa"),
        (2.1e5, 7.85e-9, "mm, t, s, N, MPa"),
        (2.1e8, 7.85e-6, "mm, kg, s, mN, kPa"),
        (210.0, 7.85e-6, "mm, kg, ms, kN, GPa"),
        (3e7, 7.33e-4, "in, slinch, s, lbf, psi"),
        (2.1e12, 7.85, "cm, g, s, 1e-05 N, 0.1 Pa"),
        (5e3, 1.1e-6, "mm, kg, s, mN, kPa"),  # rubber, whose modulus in GPa would be that of steel
        (210000.0, None, "mm, t, s, N, MPa"),
    ],
)
def test_known_solid_names_its_units(young: float, density: float | None, names: str) -> None:
    assert likely_systems([(young, density)])[0].names == names


def test_gravity_tells_units_apart() -> None:
    """Young's modulus alone fits several systems."""
    deck = [(2.1e5, None)]
    assert len(likely_systems(deck)) > 1
    assert likely_systems(deck, [9810.0]) == [Units(length="mm", mass="t")]
    assert likely_systems(deck, [9.81e-3]) == [Units(length="mm", mass="g", time="ms")]


def test_most_materials_decide() -> None:
    exotic = (1.0, 1.0)
    deck = [exotic, (2.1e8, 7.85e-6), (7e7, 2.7e-6)]
    assert likely_systems(deck) == [Units(length="mm", mass="kg")]
    assert likely_systems([exotic]) == []

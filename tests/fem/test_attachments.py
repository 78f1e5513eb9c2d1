"""Concentrated masses, springs and dashpots: beams against closed forms, exact reduction."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.optimize import brentq
from support import (
    STOCKY,
    assert_force_of_energy,
    assert_polynomial_is_exact,
    assert_tangent_of_force,
    beam_scene,
    dense,
    enriched,
    free_unknowns,
    make_solid,
    refusal,
    scene_of,
)

pytest.importorskip("dolfinx")

from fenicsrom.errors import ErrorKind
from fenicsrom.fem.full.full import full_model
from fenicsrom.online.run.simulate import simulate
from fenicsrom.reduction.basis import project
from fenicsrom.reduction.modes import component_modes
from fenicsrom.scene import Basis

SLENDER = tuple(
    f"geometry.parameters.{size}"
    for size in ("length=1.0", "height=0.01", "elements_along=30", "load_at=0.5")
)


def cantilever(attachments: list[dict[str, Any]], *overrides: str, **tables: Any) -> Any:
    """A cantilever of 1 m x 10 mm x 10 mm with attachments."""
    return make_solid(
        beam_scene(
            2,
            (*SLENDER, "geometry.thickness=0.01", "material.poisson=0.0", *overrides),
            contacts=None,
            attachments=attachments,
            **tables,
        )
    )


def bending(solid: Any) -> tuple[float, float]:
    """E I in N m² and the mass in kg of the beam."""
    return solid.material.young * 0.01**4 / 12.0, solid.material.density * 1e-4


def test_tip_mass_lowers_the_frequencies_as_in_the_closed_form() -> None:
    """1 + cosh λ cos λ + (m / ρAL) λ (cos λ sinh λ − sin λ cosh λ) = 0, ω = λ² √(EI / ρAL⁴).

    Reference: two frequencies of a cantilever with a tip mass | characteristic equation of the
    beam | 27.479, 247.34 rad/s | agree | 0.1 %
    """
    solid = cantilever([{"group": "tip", "mass": 0.5}])
    stiffness, mass = bending(solid)

    def residual(x: float) -> float:
        mixed = np.cos(x) * np.sinh(x) - np.sin(x) * np.cosh(x)
        return float(1.0 + np.cosh(x) * np.cos(x) + 0.5 / mass * x * mixed)

    exact = [brentq(residual, *bracket) ** 2 for bracket in ((0.5, 1.8), (3.0, 4.6))]
    found = component_modes(solid, Basis(modes=2)).omega[:2]
    np.testing.assert_allclose(found, np.array(exact) * np.sqrt(stiffness / mass), rtol=1e-3)


@pytest.mark.parametrize(("components", "along"), [(None, 1.0), (["y"], 1.0), (["x"], 0.0)])
def test_tip_spring_carries_its_part_of_the_load(components: Any, along: float) -> None:
    """The deflection under a tip force is F / (3 E I / L³ + k), and F L³ / 3 E I with k along x.

    Reference: tip deflection of a cantilever on a spring | closed form | F / (3EI/L³ + k) |
    agrees | 0.1 %
    """
    push = {"group": "tip", "direction": [0.0, 1.0], "force": 1.0}
    spring = {"node": [1.0, 0.0], "stiffness": 300.0}
    spring |= {"components": components} if components else {}
    solid = cantilever([spring], "geometrically_nonlinear=false", loads=[push])
    stiffness, _ = bending(solid)
    tip = solid.place(solid.loads[0].place, "")[0] @ solid.equilibrium
    assert tip[1] == pytest.approx(1.0 / (3.0 * stiffness + 300.0 * along), rel=1e-3)


def test_elastic_support_has_its_stiffness_per_area() -> None:
    solid = cantilever([{"group": "tip", "stiffness_per_area": 2e9}])
    np.testing.assert_allclose(solid.springs.reshape(-1, 2).sum(axis=0), 2e9 * 0.01 * 0.01)


def test_weight_of_a_mass_is_part_of_an_acceleration() -> None:
    weight = {"direction": [0.0, -1.0], "acceleration": 9.81, "frequency": 1.0}
    loads = [weight | {"frequency": 1.0}, {"group": "load", "direction": [0, 1], "force": 1.0}]
    bare, heavy = (
        cantilever(found, loads=loads).load_vectors[:, 0].sum()
        for found in ([], [{"group": "tip", "mass": 0.5}])
    )
    assert heavy - bare == pytest.approx(-0.5, rel=1e-9)


@pytest.fixture(scope="module")
def sprung() -> Any:
    """A stocky beam on springs, bent by a static load."""
    push = {"group": "tip", "direction": [0.3, 1.0], "force": 1e7}
    stocky = (*STOCKY, "geometry.parameters.elements_along=2")
    found = [{"group": "tip", "stiffness": 3e8, "mass": 1.0}, {"group": "load", "stiffness": 1e7}]
    found += [{"group": "load", "to": {"group": "tip"}, "stiffness": 2e9}]
    return make_solid(beam_scene(2, stocky, loads=[push], contacts=None, attachments=found))


def test_force_with_springs_is_the_derivative_of_the_energy(sprung: Any) -> None:
    assert_force_of_energy(sprung)


def test_tangent_with_springs_is_the_derivative_of_the_force(sprung: Any) -> None:
    assert_tangent_of_force(sprung)


def test_polynomial_with_springs_is_exact(sprung: Any) -> None:
    assert np.abs(sprung.equilibrium).max() > 0.005
    assert_polynomial_is_exact(sprung)


def test_dashpot_at_the_end_of_a_bar_damps_it_as_in_the_closed_form() -> None:
    """All axial modes of a clamped bar decay with (a / 2L) log((1 + r) / (1 − r)), r = c / ρ a.

    The wave speed is a = √(E / ρ). A dashpot with c per area at the end reflects the part
    (1 − r) / (1 + r) of a wave. The frequencies (2k − 1) a / 4L are those without the dashpot.

    Reference: two axial modes of a bar with a dashpot at its end | closed form | decay 3570.5
    1/s; 8091.4, 24274 rad/s | agree | 0.2 %
    """
    speed, ratio = np.sqrt(207e9 / 7801.0), 0.6
    end = {"group": "tip", "damping_per_area": ratio * 7801.0 * speed}
    free = ("material.poisson=0.0", "material.mass_damping=0.0", "geometrically_nonlinear=false")
    solid = make_solid(beam_scene(2, (*STOCKY, *free), contacts=None, attachments=[end]))
    keep = free_unknowns(solid)
    mass, stiffness = dense(solid.mass, keep), dense(solid.stiffness, keep)
    unit = np.zeros((solid.local, keep.size))
    unit[keep, np.arange(keep.size)] = 1.0
    model = full_model(solid)
    velocity = np.array([model.velocity_times(column) for column in unit.T])[:, keep]
    lower = -np.linalg.solve(mass, np.hstack([stiffness, velocity]))
    values = np.linalg.eigvals(np.block([[np.zeros_like(mass), np.eye(keep.size)], [lower]]))
    rate = speed / 2.0 * np.log((1.0 + ratio) / (1.0 - ratio))
    for k in (1, 2):
        exact = complex(-rate, (2 * k - 1) * np.pi / 2.0 * speed)
        assert np.abs(values - exact).min() < 2e-3 * abs(exact)


@pytest.mark.slow
def test_reduced_model_with_dashpots_moves_as_the_full_one() -> None:
    """Both keep the energy ledger, and the dashpot dissipates as much in both."""
    run = (
        *STOCKY,
        "material.mass_damping=0.0",
        "loads.0.frequency=100.0",
        "loads.0.force=2e6",
        "time.steady='march'",
        "time.periods=2",
        "time.steps_per_period=40",
    )
    dashpot = {"group": "tip", "damping": 2e4}
    between = {"node": [0.5, 0.1], "to": {"node": [1.0, -0.1]}, "damping": 2e4}
    solid = make_solid(beam_scene(2, run, contacts=None, attachments=[dashpot, between]))
    _, _, basis = enriched(solid, modes=8)
    reduced = simulate(project(solid, basis), scene_of(solid))
    full = simulate(full_model(solid), scene_of(solid))
    assert reduced.relative_imbalance < 1e-10 and full.relative_imbalance < 1e-10
    assert full.damping_dissipation[-1] > 0.2 * np.max(full.kinetic + full.elastic)
    np.testing.assert_allclose(
        reduced.damping_dissipation[-1], full.damping_dissipation[-1], rtol=5e-3
    )
    size = np.abs(full.displacement).max()
    np.testing.assert_allclose(reduced.displacement, full.displacement, atol=5e-3 * size)


def test_attachment_to_clamped_nodes_is_refused() -> None:
    with refusal(ErrorKind.PLACE, "attachments[0]"):
        cantilever([{"group": "root", "mass": 1.0}])

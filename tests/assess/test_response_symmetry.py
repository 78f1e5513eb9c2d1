"""Response curves of a symmetric body, whose basis lacks the modes that break the symmetry."""

from __future__ import annotations

import pytest
from support import beam_scene

pytest.importorskip("dolfinx")

from fenicsrom.assess.curves.results import Response
from fenicsrom.study import build_model
from fenicsrom.study.curves import response


@pytest.mark.slow
def test_clamped_beam_under_pressure_warns_of_motions_that_lose_their_symmetry() -> None:
    """The second mode is antisymmetric. It is left out, and grows above 50.7 Hz."""
    sizes = {"length": 2.54, "height": 0.0254, "elements_along": 8, "elements_through": 1}
    scene = beam_scene(
        2,
        tuple(f"geometry.parameters.{name}={size}" for name, size in sizes.items()),
        supports=[{"group": "root"}, {"group": "tip"}],
        contacts=None,
        loads=[
            {
                "box": [[0.0, 0.0127], [2.54, 0.0127]],
                "pressure": 1e5,
                "follower": True,
                "frequency": 20.0,
            }
        ],
        material={"young": 207e9, "poisson": 0.28, "density": 7801.0, "mass_damping": 1.0},
        probe={"group": "load", "at": "centre"},
        basis={"accuracy": 1.0},
        time={"steps_per_period": 60},
        response={"parameter": "frequency", "first": 40.0, "last": 57.0},
    )
    stored = build_model(scene)
    found = response(stored.resized([name for name in stored.labels if name != "2V"]))
    wrong = {check.point.parameter for check in found.curves[0].checks if check.contradicted}
    assert wrong == {f for check in found.curves[0].checks if (f := check.point.parameter) > 51.0}
    assert len(wrong) >= 3
    assert sum("a richer basis finds another stability" in said for said in found.warnings) == 1
    for check in found.curves[0].checks:
        f = check.point.parameter
        assert check.point.verdict == "stable" and check.compared
        if f > 51.0:
            assert check.richer_verdict == "fold" and f in wrong
        elif f < 50.0:
            assert f not in wrong


@pytest.mark.slow
def test_follower_pressure_that_varies_needs_the_derivatives_along_its_own_static_shape() -> None:
    """A cantilever under (8 + 4 sin) EI/L² at its end; the bending modes meet at the shape 2L."""
    young, height, density = 2.1e11, 0.02, 7850.0
    pressure, lowest = young * height**2 / 12.0, 0.5596 * (young / 12.0 / density) ** 0.5 * height

    def curve(derivatives: str) -> Response:
        scene = beam_scene(
            2,
            (
                "geometry.parameters.length=1.0",
                f"geometry.parameters.height={height}",
                "geometry.parameters.elements_along=8",
            ),
            contacts=None,
            supports=[{"group": "root"}],
            loads=[
                {"group": "tip", "pressure": 8.0 * pressure, "follower": True},
                {"group": "tip", "pressure": 4.0 * pressure, "follower": True, "frequency": lowest},
            ],
            material={"young": young, "poisson": 0.3, "density": density, "mass_damping": 1.0},
            probe={"group": "tip", "at": "centre"},
            basis={"derivatives": derivatives},
            time={"steps_per_period": 60},
            response={"first": 2.2 * lowest, "last": 3.1 * lowest},
        )
        return response(scene)

    few, many = curve("principal"), curve("all")
    assert any("a richer basis finds another stability" in said for said in few.warnings)
    assert not any(check.contradicted for check in many.curves[0].checks)
    edges = [
        [point.parameter for point in found.curves[0].special if point.kind == "period doubling"]
        for found in (few, many)
    ]
    assert edges[1][0] > 1.05 * edges[0][0] and edges[1][1] > 1.1 * edges[0][1]
    assert not any(point.kind == "non-smooth" for point in many.curves[0].special)

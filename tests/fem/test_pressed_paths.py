"""Equilibrium paths under follower pressures: rings, an arch, and a column with a free end."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from support import STEEL, beam_scene

pytest.importorskip("dolfinx")

from mpi4py import MPI
from test_follower_pressure import OUTSIDE, RADIUS, THICKNESS, YOUNG, ring_scene

from fenicsrom.assess.curves.equilibrium_path import EquilibriumPath, equilibrium_path
from fenicsrom.fem.paths.equilibrium_path import PathPoint
from fenicsrom.fem.solid.solid import build_solid
from fenicsrom.scene import Scene, make_scene


def follow(scene: Scene, **options: Any) -> EquilibriumPath:
    """The path of a scene, on this rank."""
    return equilibrium_path(scene, MPI.COMM_SELF, **options)


@pytest.mark.slow
@pytest.mark.parametrize(("follower", "factor"), [(True, 3.0), (False, 4.0 * OUTSIDE**2)])
def test_path_of_a_ring_has_its_bifurcation_at_the_pressure_of_theory(
    follower: bool, factor: float, tmp_path: Path
) -> None:
    """The load factor 1 is 3 E I / R³ if the pressure follows, else 4 E I / R³.

    Reference: bifurcation on the path of a pressed ring | closed form | 3EI/R³; 4EI/R³ | agrees
    | 0.3 %
    """
    critical = factor * YOUNG * THICKNESS**3 / 12 / RADIUS**3
    load = {"pressure": critical, "follower": follower}
    scene = ring_scene(tmp_path, load, statics={"last": 1.1})
    found = follow(scene)
    (crossed,) = found.special
    assert crossed.kind == "bifurcation" and not found.warnings
    assert crossed.load_factor == pytest.approx(1.0, rel=3e-3)


KINDS = ["bifurcation", "limit point"] * 2


def arch(pressure: float, **statics: Any) -> Scene:
    """A shallow arch, clamped at both ends, under a follower pressure from above."""
    return make_scene(
        geometry={
            "mesh": "arch2d.geo",
            "dimension": 2,
            "thickness": 0.01,
            "curved": True,
            "parameters": {"elements_along": 8},
        },
        material=STEEL,
        supports=[{"group": "left"}, {"group": "right"}],
        loads=[
            {"group": "outer", "pressure": pressure, "follower": True},
            {"group": "crown", "direction": [0.0, -1.0], "force": 50.0},
        ],
        probe={"group": "crown"},
        statics=statics,
    )


@pytest.mark.slow
def test_path_under_a_follower_pressure_is_that_of_load_control() -> None:
    visited: list[PathPoint] = []
    found = follow(arch(1e6, loads=[0]), visit=visited.append)
    assert found.points[0].probe[1] < 0.0 and not found.warnings  # the constant force
    assert [point.kind for point in found.special] == KINDS
    first = next(k for k, point in enumerate(visited) if point.kind)
    for point in visited[3:first:5]:
        solid = build_solid(arch(1e6 * point.load_factor), MPI.COMM_SELF)
        size = np.abs(solid.equilibrium).max()
        np.testing.assert_allclose(point.displacement, solid.equilibrium, atol=1e-8 * size)


@pytest.mark.slow
def test_pressure_without_a_potential_is_told() -> None:
    """Beck's column has no other equilibrium than the straight one, up to any load."""
    euler = np.pi**2 * STEEL["young"] * 0.0254**4 / 12.0 / (4.0 * 2.54**2)
    load = {"group": "tip", "pressure": euler / 0.0254**2, "follower": True}
    sizes = ("geometry.parameters.elements_along=8", "geometry.parameters.load_at=0.5")
    found = follow(beam_scene(2, sizes, contacts=None, loads=[load], statics={"last": 6.0}))
    (warning,) = found.warnings
    assert "no potential" in warning
    assert found.reason == "end of the range"
    assert max(abs(point.probe[1]) for point in found.points) < 1e-8

"""Stability of static equilibria: Euler's load, the elastica, the snap-through of an arch, and what
the user is told."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.optimize import brentq
from scipy.special import ellipe, ellipk
from support import STEEL, beam_scene, make_solid

pytest.importorskip("dolfinx")

from mpi4py import MPI

from fenicsrom.fem.base.linalg import Factorisation, negative_eigenvalues
from fenicsrom.fem.solid.solid import build_solid
from fenicsrom.scene import make_scene, read_scene

LENGTH, EULER = 2.54, np.pi**2 * 207e9 * 0.0254**4 / 12 / (4 * 2.54**2)  # m, N

ARCH = """\
rise = 0.02; l = 0.5; t = 0.005; r = (l^2/4 + rise^2)/(2*rise); f = (r + t)/r;
Point(1) = {0, rise - r, 0};
Point(2) = {-l/2, 0, 0}; Point(3) = {0, rise, 0}; Point(4) = {l/2, 0, 0};
Point(5) = {-l/2*f, (rise - r)*(1 - f), 0}; Point(6) = {0, rise + t, 0};
Point(7) = {l/2*f, (rise - r)*(1 - f), 0};
Circle(1) = {2, 1, 3}; Circle(2) = {3, 1, 4}; Circle(3) = {5, 1, 6}; Circle(4) = {6, 1, 7};
Line(5) = {2, 5}; Line(6) = {3, 6}; Line(7) = {4, 7};
Curve Loop(1) = {1, 6, -3, -5}; Plane Surface(1) = {1};
Curve Loop(2) = {2, 7, -4, -6}; Plane Surface(2) = {2};
Transfinite Curve {1, 2, 3, 4} = 6; Transfinite Curve {5, 6, 7} = 2;
Transfinite Surface {1, 2}; Recombine Surface {1, 2};
Physical Surface("solid") = {1, 2}; Physical Curve("root") = {5, 7}; Physical Curve("top") = {6};
"""


def pressed(force: float, elements: int = 8, **tables: Any) -> Any:
    """The paper's beam under a static axial force at its tip, without contact."""
    load = {"group": "tip", "at": "centre", "direction": [-1.0, 0.0], "force": force}
    given = {"contacts": None, "loads": [load], **tables}
    sizes = (f"geometry.parameters.elements_along={elements}", "geometry.parameters.load_at=0.5")
    return make_solid(beam_scene(2, sizes, **given))


def tip(solid: Any) -> Any:
    return solid.probe_rows @ solid.equilibrium


def arch(folder: Path, force: float) -> Any:
    """A shallow arch, clamped at both ends, with a force on its crown."""
    (folder / "arch.geo").write_text(ARCH)
    scene = make_scene(
        folder=folder,
        geometry={"mesh": "arch.geo", "dimension": 2, "thickness": 0.01, "curved": True},
        material=STEEL,
        supports=[{"group": "root"}],
        loads=[{"group": "top", "direction": [0.0, -1.0], "force": force}],
    )
    return build_solid(scene, MPI.COMM_WORLD)


@pytest.mark.parametrize(("part", "unstable"), [(0.98, 0), (1.02, 1), (10.0, 2)])
def test_straight_column_is_unstable_beyond_the_euler_loads(part: float, unstable: int) -> None:
    """The second Euler load of a cantilever is nine times the first."""
    solid = pressed(part * EULER, 16)
    assert solid.unstable == unstable
    assert bool(solid.warnings) == bool(unstable)
    assert negative_eigenvalues(solid.stiffness) == 0


def test_factor_counts_the_modes_below_a_frequency() -> None:
    """On one rank MUMPS, which factorises large matrices, counts without a second factorisation."""
    sizes = ("geometry.parameters.elements_along=60", "geometry.parameters.elements_through=3")
    solid = make_solid(beam_scene(2, sizes))
    assert solid.free > Factorisation.SMALL
    squares, _ = solid.eigenmodes(solid.factor, 4)
    for count in (1, 3):
        matrix = solid.stiffness.copy()
        matrix.axpy(-0.5 * (squares[count - 1] + squares[count]), solid.mass)
        assert Factorisation(matrix, "test_inertia").negative_eigenvalues() == count
        assert negative_eigenvalues(matrix) == count


def test_buckled_column_is_the_elastica() -> None:
    """Timoshenko and Gere, Theory of Elastic Stability, art. 2.7.

    Reference: tip of a column at 1.2 times its buckling load | elastica (Timoshenko and Gere) |
    1.6479, −0.8283 m | 1.6453, −0.8253 m | 1 %
    """
    part = 1.2

    def excess(angle: float) -> float:
        return float((ellipk(np.sin(angle / 2) ** 2) / (np.pi / 2)) ** 2 - part)

    k = np.sin(brentq(excess, 0.1, 3.0) / 2)
    along = LENGTH * (2 * ellipe(k * k) / ellipk(k * k) - 2)
    across = LENGTH * 2 * k / ellipk(k * k)
    solid = pressed(part * EULER, 40)
    assert tip(solid)[0] == pytest.approx(along, rel=0.01)
    assert abs(tip(solid)[1]) == pytest.approx(across, rel=0.01)
    (warning,) = solid.warnings
    assert "buckle" in warning and "1 direction," in warning


def test_column_buckles_to_the_side_of_its_loads() -> None:
    for side in (1.0, -1.0):
        push = {"group": "load", "at": "centre", "direction": [0.0, side], "force": 1.0}
        axial = {"group": "tip", "at": "centre", "direction": [-1.0, 0.0], "force": 1.5 * EULER}
        solid = pressed(0.0, loads=[axial, {**push, "frequency": 3.0}], probe={"group": "tip"})
        assert tip(solid)[1] * side > 0.1


def test_column_with_contact_keeps_its_equilibrium_and_warns() -> None:
    wall = {"group": "tip", "normal": [0.0, 1.0], "preload": 1.0, "friction": 0.1}
    stiffness = {"normal_stiffness": 1e6, "tangential_stiffness": 1e3}
    axial = {"group": "tip", "at": "centre", "direction": [-1.0, 0.0], "force": 1.5 * EULER}
    shake = {"group": "load", "direction": [0.0, 1.0], "force": 1.0, "frequency": 3.0}
    solid = pressed(0.0, contacts=[wall | stiffness], loads=[axial, shake])
    (warning,) = solid.warnings
    assert solid.unstable == 1 and "without its contacts" in warning
    assert abs(tip(solid)[0]) < 1e-3


@pytest.mark.slow
def test_arch_just_below_its_limit_load_does_not_snap() -> None:
    """`fenicsrom statics` finds the limit at 1535.9 N, between two steps of the growing load."""
    path = Path(__file__).parents[2] / "demos" / "arch_snap.toml"
    for force in (1300.0, 1530.0):
        solid = build_solid(read_scene(path, [f"loads.0.force={force}"]), MPI.COMM_SELF)
        assert not solid.warnings, force


def test_steep_growth_below_the_buckling_load_is_no_snap() -> None:
    """A small force across a column near its buckling load: the growth is large, and continuous."""
    axial = {"group": "tip", "at": "centre", "direction": [-1.0, 0.0], "force": 0.996 * EULER}
    push = {"group": "tip", "at": "centre", "direction": [0.0, 1.0], "force": 0.1}
    solid = pressed(0.0, 16, loads=[axial, push], probe={"group": "tip"})
    alone = pressed(0.0, 16, loads=[push], probe={"group": "tip"})
    assert tip(solid)[1] > 50.0 * tip(alone)[1] > 0.0
    assert not solid.warnings


@pytest.mark.slow
def test_arch_that_snaps_through_is_told(tmp_path: Path) -> None:
    """The limit load is between 750 and 800 N."""
    calm, snapped = arch(tmp_path, 750.0), arch(tmp_path, 1000.0)
    assert not calm.warnings and abs(tip(calm)[1]) < 0.01
    (warning,) = snapped.warnings
    assert "snaps through between 75 % and 80 %" in warning and abs(tip(snapped)[1]) > 0.03

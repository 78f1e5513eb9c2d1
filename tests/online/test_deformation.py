"""Volume ratios and principal stretches of given gradients."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import expm
from support import isotropic_material

from fenicsrom.online.stress.stress import NOWHERE, StressLaw, deformation, extremes

LAME, SHEAR = 2.0, 1.0


def law(plane: str | None = None, linear: bool = False) -> StressLaw:
    return StressLaw(plane, linear, not linear, (isotropic_material(LAME, SHEAR),))


def test_stretches_of_a_rotated_body_are_those_of_its_stretching() -> None:
    turn = expm(np.array([[0.0, -0.7, 0.2], [0.7, 0.0, 0.4], [-0.2, -0.4, 0.0]]))
    stretches = np.array([[1.1, 0.9, 1.2], [0.8, 1.0, 1.3], [-0.5, 1.0, 1.0]])
    start = np.array([turn @ np.diag(row) for row in stretches]) - np.eye(3)
    places = np.arange(9.0).reshape(3, 3)
    two = deformation(law(), places[:2], start[:2], 0.0 * start[:2])
    assert two.volume_ratio == pytest.approx(0.8 * 1.3) and list(two.position) == list(places[1])
    assert (two.smallest_stretch, two.largest_stretch) == pytest.approx((0.8, 1.3))
    last = deformation(law(), places[2:], 0.5 * start[2:], 0.5 * start[2:])
    assert last.is_inverted and last.volume_ratio == pytest.approx(-0.5)
    both = extremes([NOWHERE, two, last])
    assert both.volume_ratio == last.volume_ratio and both.position is last.position
    assert (both.smallest_stretch, both.largest_stretch) == pytest.approx((0.5, 1.3))


@pytest.mark.parametrize(("mean", "size"), [(0.0, 0.01), (-0.2, 0.005), (0.5, 0.1), (0.0, 3.0)])
def test_extreme_stretches_are_those_of_all_points(mean: float, size: float) -> None:
    gradients = size * np.random.default_rng(1).standard_normal((200, 3, 3))
    gradients[:, 0, 0] += mean
    found = deformation(law(), np.zeros((200, 3)), gradients, 0.0 * gradients)
    stretches = np.linalg.svd(np.eye(3) + gradients, compute_uv=False)
    assert found.smallest_stretch == pytest.approx(stretches.min(), rel=1e-7)
    assert found.largest_stretch == pytest.approx(stretches.max(), rel=1e-12)


def test_extreme_of_a_uniaxial_state_is_not_lost_by_rounding() -> None:
    for stretch in np.linspace(0.05, 0.95, 181):
        gradients = np.array([np.diag([stretch - 1.0, 0.0, 0.0]), np.diag([1.0, 0.0, 0.0])])
        found = deformation(law(), np.zeros((2, 3)), gradients, 0.0 * gradients)
        assert found.smallest_stretch == pytest.approx(stretch, rel=1e-12)


def test_volume_ratio_in_plane_stress_has_the_thickness() -> None:
    """E_zz = -λ / (λ + 2 μ) tr E; a large extension leaves no thickness."""
    gradient = np.diag([0.2, 0.0])[None]
    across = -LAME / (LAME + 2.0 * SHEAR) * (0.2 + 0.02)
    found = deformation(law("stress"), np.zeros((1, 2)), gradient, 0.0 * gradient)
    assert found.volume_ratio == pytest.approx(1.2 * np.sqrt(1.0 + 2.0 * across))
    assert deformation(law("strain"), np.zeros((1, 2)), gradient, 0.0 * gradient).volume_ratio == (
        pytest.approx(1.2)
    )
    found = deformation(law("stress"), np.zeros((1, 2)), 10.0 * gradient, 0.0 * gradient)
    assert found.volume_ratio == 0.0 and found.is_inverted


def test_small_vibrations_do_not_invert() -> None:
    gradient = np.diag([-2.0, 0.0, 0.0])[None]
    found = deformation(law(linear=True), np.zeros((1, 3)), 0.0 * gradient, gradient)
    assert found.volume_ratio == 1.0 and found.smallest_stretch == 1.0

"""Selection: least-squares coordinates that do not depend on the scale of a mode, and both weights
against a hand calculation."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from fenicsrom.reduction.derivatives import modal_coordinates, select

Array = NDArray[np.float64]

N = 30
WEIGHTS = np.linspace(0.5, 2.0, N)


def inner(a: Array, b: Array) -> Array:
    return a.T @ (WEIGHTS[:, None] * b)


def largest(vectors: Array) -> Array:
    return np.abs(vectors).max(axis=0)


@pytest.fixture
def vectors() -> Array:
    """Modes of very different size, such as metres per square-root kilogram and metres per
    newton."""
    return np.random.default_rng(0).standard_normal((N, 4)) * [1.0, 3.0, 1e-5, 1e-8]


def test_least_squares_recovers_known_coordinates(vectors: Array) -> None:
    known = np.random.default_rng(1).standard_normal((4, 7))
    snapshots = vectors / largest(vectors) @ known
    np.testing.assert_allclose(
        modal_coordinates(vectors, snapshots, inner, largest(vectors)), known, rtol=1e-9
    )


def test_residual_is_orthogonal_in_the_mass_norm(vectors: Array) -> None:
    snapshots = np.random.default_rng(2).standard_normal((N, 5))
    scaled = vectors / largest(vectors)
    q = modal_coordinates(vectors, snapshots, inner, largest(vectors))
    np.testing.assert_allclose(inner(scaled, snapshots - scaled @ q), 0.0, atol=1e-11)


def test_selection_does_not_depend_on_scale_of_modes(vectors: Array) -> None:
    snapshots = np.random.default_rng(3).standard_normal((N, 5))
    other = vectors * [1e6, 1e-3, -1.0, 1e4]
    one, two = (modal_coordinates(y, snapshots, inner, largest(y)) for y in (vectors, other))
    np.testing.assert_allclose(np.abs(two), np.abs(one), rtol=1e-9)


def test_dependent_modes_share_common_coordinate(vectors: Array) -> None:
    twice = np.concatenate([vectors, vectors[:, :1]], axis=1)
    snapshots = vectors[:, :1] / largest(vectors)[0]
    q = modal_coordinates(twice, snapshots, inner, largest(twice))
    np.testing.assert_allclose(q[[0, 4], 0], 0.5, rtol=1e-6)
    np.testing.assert_allclose(q[1:4], 0.0, atol=1e-6)


LABELS = ["1V", "2V", "1S"]
ETA = np.array([[4.0, 0.0, 2.0], [0.0, -2.0, 0.0], [1.0, 0.5, -0.5]])  # modes x snapshots


def test_mmi_weights_match_hand_calculation() -> None:
    # largest of each row: 4, 2, 1; their products relative to 16
    chosen = select(ETA, LABELS, "mmi", 0.1)
    assert chosen.modal_coordinates == {"1V": 1.0, "2V": 0.5, "1S": 0.25}
    assert chosen.weights == {
        "1V1V": 1.0,
        "1V2V": 8 / 16,
        "1V1S": 4 / 16,
        "2V2V": 4 / 16,
        "2V1S": 2 / 16,
        "1S1S": 1 / 16,
    }
    assert chosen.derivatives == ("1V1V", "1V2V", "1V1S", "2V2V", "2V1S")
    assert chosen.modes == ("1V", "2V", "1S")


def test_mmi_nls_weights_match_hand_calculation() -> None:
    # sums over the snapshots: 16 + 4; 0 (1V and 2V never move together); 4 + 1; 4; 1; 1 + 1/4 + 1/4
    chosen = select(ETA, LABELS, "mmi-nls", 0.06)
    assert chosen.weights == {
        "1V1V": 1.0,
        "1V2V": 0.0,
        "1V1S": 0.25,
        "2V2V": 0.2,
        "2V1S": 0.05,
        "1S1S": 0.075,
    }
    assert chosen.derivatives == ("1V1V", "1V1S", "2V2V", "1S1S")


def test_weak_normal_modes_are_dropped_and_static_modes_are_kept() -> None:
    eta = ETA * [[1.0], [0.01], [0.01]]
    chosen = select(eta, LABELS, "mmi-nls", 0.01)
    assert chosen.modes == ("1V", "1S")
    assert chosen.modal_coordinates == pytest.approx({"1V": 1.0, "2V": 0.005, "1S": 0.0025})
    assert chosen.derivatives == ("1V1V",)
    assert set(chosen.weights) == {"1V1V", "1V1S", "1S1S"}


def test_weight_at_threshold_is_dropped() -> None:
    assert "1V1S" not in select(ETA, LABELS, "mmi-nls", 0.25).derivatives
    assert "1V1S" in select(ETA, LABELS, "mmi-nls", 0.2499).derivatives


@pytest.mark.parametrize("method", ["mmi", "mmi-nls"])
def test_structure_without_motion_keeps_all_modes_and_no_derivative(method: str) -> None:
    chosen = select(np.zeros_like(ETA), LABELS, method, 0.1)
    assert chosen.modes == ("1V", "2V", "1S")
    assert chosen.derivatives == () and chosen.weights == {}
    assert chosen.modal_coordinates == {"1V": 0.0, "2V": 0.0, "1S": 0.0}

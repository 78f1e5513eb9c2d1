"""Signs and conditions of symmetric matrices whose coordinates have different units."""

from __future__ import annotations

import numpy as np
import pytest

from fenicsrom.arrays import Array
from fenicsrom.online.kernels.dense import negative_eigenvalues, scaled, scaled_condition

UNITS = 10.0 ** np.linspace(-12.0, 12.0, 7)


def matrix_with(values: Array) -> Array:
    """A symmetric matrix with these eigenvalues and random eigenvectors."""
    axes = np.linalg.qr(np.random.default_rng(1).standard_normal((values.size, values.size)))[0]
    return np.asarray(axes * values @ axes.T)


@pytest.mark.parametrize("negative", [0, 1, 3, 7])
def test_negative_eigenvalues_are_counted_in_any_units(negative: int) -> None:
    signs = np.where(np.arange(7) < negative, -1.0, 1.0)
    matrix = matrix_with(signs * np.linspace(1.0, 3.0, 7))
    assert np.sum(np.linalg.eigvalsh(matrix) < 0.0) == negative
    assert negative_eigenvalues(matrix * np.outer(UNITS, UNITS)) == negative


def test_zero_on_the_diagonal_leaves_the_signs() -> None:
    assert negative_eigenvalues(np.array([[0.0, 1e-9], [1e-9, 1e12]])) == 1
    assert scaled(np.zeros((2, 2))).tolist() == [[0.0, 0.0], [0.0, 0.0]]


def test_scaled_condition_does_not_depend_on_the_units() -> None:
    matrix = matrix_with(np.linspace(1.0, 3.0, 7))
    in_units = matrix * np.outer(UNITS, UNITS)
    assert scaled_condition(in_units) == pytest.approx(scaled_condition(matrix), rel=1e-9)
    assert np.linalg.cond(in_units) > 1e20
    assert scaled_condition(np.zeros((0, 0))) == 1.0

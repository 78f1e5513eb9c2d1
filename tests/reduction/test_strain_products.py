"""Products of the strains: the columns that BLAS multiplies against one pair after the other."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from support import isotropic_tensor

from fenicsrom.online.model.polynomial import pairs
from fenicsrom.reduction import basis as module
from fenicsrom.reduction.basis import strain_products

Array = NDArray[np.float64]


def one_by_one(weights: Array, gradients: Array, lame: float, mu: float) -> Array:
    """The products <x, y> of the definition, point by point and pair by pair."""
    n, d = gradients.shape[1] - 1, gradients.shape[2]
    total = 0.0
    for weight, g in zip(weights, gradients, strict=True):
        f0 = np.eye(d) + g[0]
        raw = [(np.eye(d) + 0.5 * g[0]).T @ g[0]]
        raw += [f0.T @ g[i] for i in range(1, n + 1)]
        raw += [g[1 + i].T @ g[1 + j] for i, j in zip(*pairs(n), strict=True)]
        strains = [0.5 * (x + x.T) for x in raw]
        total += weight * np.array(
            [
                [lame * np.trace(x) * np.trace(y) + 2.0 * mu * np.sum(x * y) for y in strains]
                for x in strains
            ]
        )
    return np.asarray(total)


@pytest.mark.parametrize(("dimension", "n", "lame"), [(2, 0, 1.3), (3, 1, -0.3), (3, 4, 1.3)])
def test_strain_products_equal_those_of_single_pairs(
    dimension: int, n: int, lame: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    rng = np.random.default_rng(n)
    weights = rng.uniform(0.5, 1.0, 11)
    gradients = 0.4 * rng.standard_normal((11, 1 + n, dimension, dimension))
    monkeypatch.setattr(module, "BLOCK_BYTES", 3 * 8 * 15 * 6)  # some blocks, the last one smaller
    chunks = [(weights[:7], gradients[:7]), (weights[7:], gradients[7:])]
    expected = one_by_one(weights, gradients, lame, 0.7)
    found = strain_products(chunks, isotropic_tensor(lame, 0.7, dimension), n)
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-13 * np.abs(expected).max())

"""The different values of cubic coefficients."""

import numpy as np
import pytest

from fenicsrom.online.model import polynomial as unique_cubic
from fenicsrom.online.model.polynomial import count, elastic_polynomial, paired_cubic


@pytest.mark.parametrize("n", [1, 2, 7])
def test_cubic_of_strain_products_is_restored_from_its_different_values(n, monkeypatch):
    monkeypatch.setattr(unique_cubic, "ROWS", 5)
    size = 1 + n + n * (n + 1) // 2
    root = np.random.default_rng(n).standard_normal((size, size))
    cubic = elastic_polynomial(root @ root.T, n).cubic
    values = unique_cubic.unique_cubic(cubic, n)
    assert values.size == count(n) and np.all(values)
    restored = paired_cubic(values, n)
    np.testing.assert_allclose(restored, cubic, rtol=1e-13, atol=1e-13 * np.abs(cubic).max())
    np.testing.assert_array_equal(paired_cubic(unique_cubic.unique_cubic(restored, n), n), restored)


def test_linear_model_has_no_values():
    assert not unique_cubic.unique_cubic(np.zeros((0, 0)), 4).size
    assert paired_cubic(np.zeros(0), 4).shape == (0, 0)

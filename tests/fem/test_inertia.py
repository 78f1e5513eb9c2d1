"""Matrices of inertia forces from the mass matrix of one displacement component."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.sparse

pytest.importorskip("dolfinx")

from fenicsrom.fem.inertia import _kronecker


@pytest.mark.parametrize("d", [2, 3])
def test_kronecker_product_stores_the_entries_that_are_kept(d: int) -> None:
    rng = np.random.default_rng(d)
    dense = rng.standard_normal((6, 9)) * (rng.uniform(size=(6, 9)) < 0.4)
    dense[2] = 0.0  # a row without entries
    between = rng.standard_normal((d, d))
    kept = np.ones((d, d), dtype=bool)
    kept[0, 1], kept[d - 1] = False, False
    nodes = scipy.sparse.csr_array(dense)
    found = _kronecker(nodes, between, kept)
    np.testing.assert_array_equal(found.toarray(), np.kron(dense, between * kept))
    assert found.nnz == nodes.nnz * kept.sum() and found.has_sorted_indices

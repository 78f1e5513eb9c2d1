"""Matrices of disks: products and inverses agree with full matrices."""

from dataclasses import replace

import numpy as np
import pytest

from fenicsrom.online.model.cyclic_matrix import COLUMNS, CyclicMatrix

M = 2


@pytest.mark.parametrize("reach", [False, True])
@pytest.mark.parametrize("neighbour", [1, -1])
@pytest.mark.parametrize(("sectors", "inside"), [(3, 3), (7, 3), (4, 0)])
def test_matrix_of_sectors_agrees_with_the_full_one(
    sectors: int, inside: int, neighbour: int, reach: bool
) -> None:
    rng, n = np.random.default_rng(1), inside + 2 * M
    blocks = rng.standard_normal((sectors, n, n)) + 2.0 * n * np.eye(n)
    matrix = CyclicMatrix(sectors, blocks, M, neighbour)
    size = sectors * (n - M)
    own = np.arange(size).reshape(sectors, -1)
    wanted = np.zeros((size, size))
    for j in range(sectors):
        places = np.concatenate([own[j], own[(j + neighbour) % sectors][inside:]])
        wanted[np.ix_(places, places)] += blocks[j]
    columns = rng.standard_normal((size, 2 * reach))
    matrix = 2.0 * (0.5 * matrix + 0.0 * matrix)
    if reach:
        matrix = matrix + 0.5 * replace(0.0 * matrix, columns=columns, weight=6.0)
        wanted += 3.0 * columns @ columns.T
    np.testing.assert_allclose(matrix.toarray(), wanted, rtol=0.0, atol=1e-14)
    z, block = rng.standard_normal(size), rng.standard_normal((size, COLUMNS + 5))
    np.testing.assert_allclose(matrix @ z, wanted @ z, rtol=1e-14, atol=1e-14)
    inverse, given = matrix.inverse(), block.copy()
    np.testing.assert_allclose(inverse(block), np.linalg.solve(wanted, block), rtol=0.0, atol=1e-15)
    np.testing.assert_array_equal(block, given)
    np.testing.assert_allclose(inverse(z), np.linalg.solve(wanted, z), rtol=0.0, atol=1e-15)
    alike = CyclicMatrix(sectors, blocks[:1], M, neighbour)
    several = CyclicMatrix(sectors, np.repeat(blocks[:1], sectors, axis=0), M, neighbour)
    np.testing.assert_allclose(alike @ z, several @ z, rtol=1e-14, atol=1e-14)
    np.testing.assert_allclose(alike.inverse()(z), several.inverse()(z), rtol=0.0, atol=1e-15)


def test_inverse_of_a_singular_matrix_is_not_a_number() -> None:
    assert np.isnan(CyclicMatrix(3, np.zeros((1, 6, 6)), M, 1).inverse()(np.ones(12))).all()

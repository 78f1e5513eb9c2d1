"""Integrals of the products of strains, from which the elastic polynomial is made.

With the displacement u = u₀ + Σ q_i φ_i the strain is a quadratic polynomial of q,

    E = E₀ + q_i ε_i + ½ q_i q_j h_ij,    ε_i = sym(F₀ᵀ ∇φ_i),    h_ij = sym(∇φ_iᵀ ∇φ_j),    (1)

and the polynomial of `fenicsrom.online.model.polynomial` needs all products

    ⟨x, y⟩ = ∫ x : C y    (2)

of E₀, ε_i and h_ij. With C = L Lᵀ in Mandel's notation and the weight w of a quadrature point, a
strain x becomes a column √w Lᵀ x of d (d + 1) / 2 numbers at each point, so that the inner product
of two columns is (2). BLAS multiplies the columns of many points at once.
"""

from collections.abc import Iterable

import numpy as np

from fenicsrom.arrays import Array
from fenicsrom.online.model.polynomial import pairs
from fenicsrom.online.stress.strain_columns import write_strains

BLOCK_BYTES = 4e6
"""Memory of the strains of one block of points; it fits into the cache of a processor."""


def strain_products(chunks: Iterable[tuple[Array, Array]], stiffness: Array, count: int) -> Array:
    """Integrate the products (2) of E₀, ε_i and h_ij.

    Args:
        chunks: pairs (weights (k,), gradients (k, 1 + n, d, d)) at k quadrature points; gradient 0
            is that of u₀.
        stiffness: (m, m) C in Mandel's notation, positive definite, Pa.
        count: n.

    Returns:
        (s, s) symmetric products in J, s = 1 + n + n (n + 1) / 2, in the order E₀, ε_i, h_ij; the
        h_ij come in the order of `pairs`.
    """
    root = np.linalg.cholesky(stiffness).T
    size = 1 + count + pairs(count)[0].size
    total = np.zeros((size, size))
    for weights, gradients in chunks:
        d = gradients.shape[-1]
        block = max(1, int(BLOCK_BYTES / (8 * size * d * (d + 1) / 2)))
        for start in range(0, weights.size, block):
            part = slice(start, start + block)
            g = np.ascontiguousarray(gradients[part].transpose(2, 3, 1, 0))
            strains = np.empty((size, len(root), g.shape[-1]))
            write_strains(g, g * np.sqrt(weights[part]), strains)
            columns = np.matmul(root, strains).reshape(size, -1)
            total += columns @ columns.T
    return total

"""Integrals of the products of strains, from which the elastic polynomial is made.

With the displacement u = u₀ + Σ q_i φ_i the strain is a quadratic polynomial of q,

    E = E₀ + q_i ε_i + ½ q_i q_j h_ij,    ε_i = sym(F₀ᵀ ∇φ_i),    h_ij = sym(∇φ_iᵀ ∇φ_j),    (1)

and the polynomial of `fenicsrom.online.model.polynomial` needs all products

    ⟨x, y⟩ = ∫ λ tr x tr y + 2 μ x : y    (2)

of E₀, ε_i and h_ij. A strain x becomes a column of d (d + 1) / 2 numbers per quadrature point, so
that the inner product of two columns is (2). In Mandel's notation, with weight w of the point, the
column is √w C^½ x: its shear components are √(2 μ w) √2 x_bc, and its normal components

    √w (√(2 μ) x_bb + s tr x),    s = (√(2 μ + d λ) − √(2 μ)) / d.    (3)

BLAS multiplies the columns of many points at once.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable

import numpy as np

from fenicsrom.arrays import Array
from fenicsrom.online.model.polynomial import pairs
from fenicsrom.online.stress.strain_columns import write_strains

Chunks = Iterable[tuple[Array, Array]]

BLOCK_BYTES = 4e6
"""Memory of the strains of one block of points; it fits into the cache of a processor."""


def strain_products(chunks: Chunks, first_lame: float, shear_modulus: float, count: int) -> Array:
    """Integrate the products (2) of E₀, ε_i and h_ij.

    Args:
        chunks: pairs (weights (k,), gradients (k, 1 + n, d, d)) at k quadrature points; gradient 0
            is that of u₀.
        first_lame: λ (λ* in plane stress), Pa.
        shear_modulus: μ, Pa.
        count: n.

    Returns:
        (s, s) symmetric products in J, s = 1 + n + n (n + 1) / 2, in the order E₀, ε_i, h_ij; the
        h_ij come in the order of `pairs`.
    """

    def columns_of(weights: Array, gradients: Array) -> Array:
        """The columns (3)."""
        d = gradients.shape[-1]
        columns = _strain_columns(np.sqrt(2.0 * shear_modulus * weights), gradients)
        ratio = np.sqrt(1.0 + 0.5 * d * first_lame / shear_modulus)
        columns[:, :d] += ((ratio - 1.0) / d) * columns[:, :d].sum(axis=1, keepdims=True)
        return columns

    return _summed(chunks, count, columns_of)


def tensor_products(chunks: Chunks, stiffness: Array, count: int) -> Array:
    """Integrate the products x : C y of E₀, ε_i and h_ij for any constant elasticity tensor.

    Args:
        chunks: as in `strain_products`.
        stiffness: (m, m) C in Mandel's notation, positive definite, Pa.
        count: n.

    Returns:
        As `strain_products`.
    """
    root = np.linalg.cholesky(stiffness).T  # rootᵀ root = C

    def columns_of(weights: Array, gradients: Array) -> Array:
        """The columns √w root x."""
        return np.asarray(root @ _strain_columns(np.sqrt(weights), gradients))

    return _summed(chunks, count, columns_of)


def _summed(chunks: Chunks, count: int, columns_of: Callable[[Array, Array], Array]) -> Array:
    """The sum over all points of the products of the columns (s, m, k) of the strains."""
    size = 1 + count + pairs(count)[0].size
    total = np.zeros((size, size))
    for weights, gradients in chunks:
        d = gradients.shape[-1]
        block = max(1, int(BLOCK_BYTES / (8 * size * d * (d + 1) / 2)))
        for start in range(0, weights.size, block):
            part = slice(start, start + block)
            columns = columns_of(weights[part], gradients[part])
            columns = columns.reshape(size, -1)
            total += columns @ columns.T
    return total


def _strain_columns(scale: Array, gradients: Array) -> Array:
    """The strains in Mandel's notation (s, d (d + 1) / 2, k), times a factor (k,) of each point."""
    k, fields, d, _ = gradients.shape
    columns = np.empty((fields + pairs(fields - 1)[0].size, d * (d + 1) // 2, k))
    g = np.ascontiguousarray(np.moveaxis(gradients, 0, -1).transpose(1, 2, 0, 3))  # (d, d, 1+n, k)
    write_strains(g, g * scale, columns)
    return columns

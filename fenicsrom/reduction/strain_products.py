"""Integrals of the products of strains, from which the elastic polynomial is made.

With the displacement u = u₀ + Σ q_i φ_i the strain is a quadratic polynomial of q,

    E = E₀ + q_i ε_i + ½ q_i q_j h_ij,    ε_i = sym(F₀ᵀ ∇φ_i),    h_ij = sym(∇φ_iᵀ ∇φ_j),    (1)

and the polynomial of `fenicsrom.online.polynomial` needs all products

    ⟨x, y⟩ = ∫ λ tr x tr y + 2 μ x : y    (2)

of E₀, ε_i and h_ij. A strain x becomes a column of d (d + 1) / 2 numbers per quadrature point, so
that the inner product of two columns is (2). In Mandel's notation, with weight w of the point, the
column is √w C^½ x: its shear components are √(2 μ w) √2 x_bc, and its normal components

    √w (√(2 μ) x_bb + s tr x),    s = (√(2 μ + d λ) − √(2 μ)) / d.    (3)

BLAS multiplies the columns of many points at once.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from fenicsrom.arrays import Array
from fenicsrom.online.polynomial import pairs

BLOCK_BYTES = 4e6
"""Memory of the strains of one block of points; it fits into the cache of a processor."""


def strain_products(
    chunks: Iterable[tuple[Array, Array]], first_lame: float, shear_modulus: float, count: int
) -> Array:
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
    size = 1 + count + pairs(count)[0].size
    total = np.zeros((size, size))
    for weights, gradients in chunks:
        d = gradients.shape[-1]
        block = max(1, int(BLOCK_BYTES / (8 * size * d * (d + 1) / 2)))
        for start in range(0, weights.size, block):
            part = slice(start, start + block)
            columns = _strain_columns(weights[part], gradients[part], first_lame, shear_modulus)
            total += columns @ columns.T
    return total


def _strain_columns(
    weights: Array, gradients: Array, first_lame: float, shear_modulus: float
) -> Array:
    """The columns (3) of all strains: (s, d (d + 1) / 2 times k), each contiguous."""
    k, fields, d, _ = gradients.shape
    n = fields - 1
    shears = [(b, c) for b in range(d) for c in range(b + 1, d)]
    columns = np.empty((1 + n + n * (n + 1) // 2, d + len(shears), k))
    g = np.ascontiguousarray(np.moveaxis(gradients, 0, -1).transpose(1, 2, 0, 3))  # (d, d, 1+n, k)
    scaled = g * np.sqrt(2.0 * shear_modulus * weights)
    products = np.empty((d, d, fields, k))
    term = np.empty_like(products)

    def write(first: int, left: Array, right: Array) -> None:
        """Write sym(leftᵀ right) of some fields, left (d, d, k), right (d, d, fields, k)."""
        count = right.shape[2]
        found, more = products[:, :, :count], term[:, :, :count]
        np.multiply(left[0][:, None, None], right[0][None], out=found)
        for a in range(1, d):
            np.multiply(left[a][:, None, None], right[a][None], out=more)
            found += more
        mine = columns[first : first + count]
        for b in range(d):
            mine[:, b] = found[b, b]
        for k, (b, c) in enumerate(shears):
            np.add(found[b, c], found[c, b], out=mine[:, d + k])

    # E₀ = sym ∇u₀ + ½ ∇u₀ᵀ ∇u₀ and ε_i = sym(F₀ᵀ ∇φ_i)
    identity = np.eye(d)[:, :, None]
    write(0, identity + 0.5 * g[:, :, 0], scaled[:, :, :1])
    if n:
        write(1, identity + g[:, :, 0], scaled[:, :, 1:])
    row = 1 + n
    for i in range(1, fields):
        write(row, g[:, :, i], scaled[:, :, i:])
        row += fields - i
    columns[:, d:] *= np.sqrt(0.5)
    ratio = np.sqrt(1.0 + 0.5 * d * first_lame / shear_modulus)
    columns[:, :d] += ((ratio - 1.0) / d) * columns[:, :d].sum(axis=1, keepdims=True)
    return columns.reshape(columns.shape[0], -1)

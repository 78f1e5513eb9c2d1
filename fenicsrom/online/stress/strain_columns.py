"""The strains of all vectors and pairs of vectors at many points, compiled.

`fenicsrom.reduction.strain_products` multiplies these columns.
"""

import numpy as np

from fenicsrom.arrays import Array
from fenicsrom.online.kernels.compiled import kernel

SHEAR = float(np.sqrt(0.5))
"""Factor of x_bc + x_cb: the shear component in Mandel's notation is √2 times that of sym x."""


@kernel
def write_strains(gradients: Array, scaled: Array, columns: Array) -> None:
    """Write E₀, ε_i and h_ij of `fenicsrom.reduction.strain_products`, eq. (1), at k points.

    Args:
        gradients: (d, d, 1 + n, k) displacement gradients; the first one is that of u₀.
        scaled: (d, d, 1 + n, k) these times a factor of each point.
        columns: (s, d (d + 1) / 2, k) out: the strains in Mandel's notation, times this factor.
    """
    fields = gradients.shape[2]
    write_product(gradients, 0, scaled, 0, 1.0, 0.5, columns, 0)
    for j in range(1, fields):
        write_product(gradients, 0, scaled, j, 1.0, 1.0, columns, j)
    row = fields
    for i in range(1, fields):
        for j in range(i, fields):
            write_product(gradients, i, scaled, j, 0.0, 1.0, columns, row)
            row += 1


@kernel
def write_product(
    left: Array, i: int, right: Array, j: int, own: float, weight: float, columns: Array, row: int
) -> None:
    """Write own · sym(y) + weight · sym(xᵀ y) with x = left_i and y = right_j.

    Args:
        left: (d, d, l, k).
        i: number of x.
        right: (d, d, r, k).
        j: number of y.
        own: factor of y itself.
        weight: factor of the product.
        columns: (s, d (d + 1) / 2, k) out.
        row: where to write.
    """
    d, points = left.shape[0], left.shape[3]
    shear = d
    for b in range(d):
        for p in range(points):
            columns[row, b, p] = own * right[b, b, j, p]
        for a in range(d):
            for p in range(points):
                columns[row, b, p] += weight * left[a, b, i, p] * right[a, b, j, p]
        for c in range(b + 1, d):
            for p in range(points):
                columns[row, shear, p] = SHEAR * own * (right[b, c, j, p] + right[c, b, j, p])
            for a in range(d):
                for p in range(points):
                    both = (
                        left[a, b, i, p] * right[a, c, j, p] + left[a, c, i, p] * right[a, b, j, p]
                    )
                    columns[row, shear, p] += SHEAR * weight * both
            shear += 1

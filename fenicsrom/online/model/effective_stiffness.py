"""The linear equations of a Newton iteration of a reduced model, S x = b."""

import numpy as np
from numpy.typing import NDArray

from fenicsrom.arrays import Array
from fenicsrom.online.contact.compliance import form_delassus, is_formed
from fenicsrom.online.kernels.compiled import kernel
from fenicsrom.online.kernels.dense import lu_factor, lu_solve
from fenicsrom.online.model.workspace import Workspace


@kernel
def factorise_effective(
    mass: Array,
    velocity_matrix: Array,
    linear: bool,
    mass_coefficient: float,
    velocity_coefficient: float,
    tangent: Array,
    tangent_coefficient: float,
    work: Workspace,
) -> None:
    """Write the factors of S of `ReducedModel.solve_effective`, unless a linear model has them."""
    n, factor, key = mass.shape[0], work.factor, work.key
    if (
        linear
        and key[0] == mass_coefficient
        and key[1] == velocity_coefficient
        and key[2] == tangent_coefficient
    ):
        return
    for i in range(n):
        for j in range(n):
            factor[i, j] = mass_coefficient * mass[i, j] + tangent[i, j]
    if velocity_coefficient != 0.0 and velocity_matrix.shape[0] > 0:
        for i in range(n):
            for j in range(n):
                factor[i, j] += velocity_coefficient * velocity_matrix[i, j]
    key[0] = mass_coefficient if lu_factor(factor, work.pivots, n) else np.nan
    key[1] = velocity_coefficient
    key[2] = tangent_coefficient


@kernel
def write_effective_solution(
    rows: Array, directions: NDArray[np.int64], d: int, residual: Array, work: Workspace
) -> None:
    """Write the solutions of `ReducedModel.solve_effective` to `compliance`, y behind Z."""
    n, r, compliance = residual.size, directions.size, work.compliance
    unit, delassus = compliance.unit, compliance.delassus
    for i in range(n):
        unit[i, r] = -residual[i]
        for j in range(r):
            unit[i, j] = rows[directions[j], i]
    if np.isnan(work.key[0]):
        unit[:] = np.nan
    else:
        lu_solve(work.factor, work.pivots, unit, n, 1 + r)
    if is_formed(compliance, r):
        form_delassus(rows, compliance, directions)
        return
    for i in range(r):  # only the block of the point
        first = i - i % d
        for j in range(first, first + d):
            delassus[i, j] = 0.0
            for k in range(n):
                delassus[i, j] += rows[directions[i], k] * unit[k, j]


@kernel
def write_normal_flexibility(
    mass: Array, stiffness: Array, rows: Array, h: float, work: Workspace, out: Array
) -> None:
    """Write b^T S^-1 b of each contact point; see `ReducedModel.write_normal_flexibility`."""
    n, points, factor, unit = mass.shape[0], out.size, work.factor, work.compliance.unit
    d = rows.shape[0] // points
    for i in range(n):
        for j in range(n):
            factor[i, j] = 2.0 / h**2 * mass[i, j] + 0.5 * stiffness[i, j]
        for p in range(points):
            unit[i, p] = rows[p * d, i]
    work.key[0] = np.nan  # it is not the factor of a step
    if not lu_factor(factor, work.pivots, n):
        unit[:] = np.nan
    else:
        lu_solve(factor, work.pivots, unit, n, points)
    for p in range(points):
        out[p] = 0.0
        for i in range(n):
            out[p] += rows[p * d, i] * unit[i, p]

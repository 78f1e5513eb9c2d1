"""The exact polynomial of the elastic force in the coordinates q of a basis.

The elastic energy of St Venant-Kirchhoff material is a quartic polynomial of the displacement. With
u = u0 + sum q_i phi_i,

    E = E0 + q_i eps_i + 1/2 q_i q_j h_ij,    eps_i = sym(F0^T grad phi_i),    h_ij = sym(grad
    phi_i^T grad phi_j)

so that the products of E0, eps_i and h_ij under the elasticity tensor, integrated over the body,
give every coefficient:

    f_i = f0_i + K_ij q_j + 1/2 A_ijk q_j q_k + 1/6 B_ijkl q_j q_k q_l
    K_ij = <eps_i, eps_j> + <E0, h_ij>
    A_ijk = <eps_i, h_jk> + <eps_j, h_ik> + <eps_k, h_ij>
    B_ijkl = <h_ij, h_kl> + <h_ik, h_jl> + <h_il, h_jk>

With a = A q and b = 1/2 B q q the tangent is T = K + a + b and the force f = f0 + (K + a/2 + b/3)
q: one matrix-vector product gives both. No mesh is touched online.

The different values among the cubic coefficients of an elastic force.

B_ijkl is symmetric in all indices: of the n⁴ values, n (n + 1) (n + 2) (n + 3) / 24 with
i <= j <= k <= l differ. The value of i <= j <= k <= l stands at the place

    C(i, 1) + C(j + 1, 2) + C(k + 2, 3) + C(l + 3, 4)    (combinatorial number system)

`Workspace` has the scratch arrays of a reduced model.
"""

from collections.abc import Iterator
from typing import Annotated, NamedTuple

import numpy as np
from numpy.typing import NDArray

from fenicsrom.arrays import Array
from fenicsrom.online.contact.problem import Compliance
from fenicsrom.online.kernels.compilation import compiled, kernel, part
from fenicsrom.online.kernels.dense import add_by_upper_half, add_combined_rows


class Workspace(NamedTuple):
    """The results of a `ReducedModel` of n coordinates and m contact displacements.

    The results are valid until the next call of the model. In models of this size a new array costs
    compiled code more than the arithmetic on it.

    Attributes:
        columns: (n, p) the columns of the quadratic coefficients; they are combined faster than the
            rows.
        points: (2, n) coordinates.
        products: (3, 2, p) see `elastic_products`.
        force: (n,) elastic force.
        tangent: (n, n) its derivative.
        factor: (n, n) factors of the last effective stiffness.
        pivots: (n,)
        key: (3,) mass, velocity and tangent coefficient of the factor, by which a linear model
            keeps it; the first is NaN if the matrix is singular.
        compliance: the response to contact forces; its array `unit` holds right-hand sides and
            solutions.
        contact_columns: (n, m) the columns of the contact rows.
        contact: (m,) contact displacement.
        mass_product: (n,) M v.
        velocity_product: (n,) D v.
        factors: (loads,) time factors of the loads.
        load_vector: (n,) load vector, N.
        pressure_factors: (2, k) factors of the follower pressures at the start and at the end of
            the step.
        pressure_vectors: (2, n) coordinates and a force of a follower pressure.
        pressure_tangent: (n, n) its derivative.
        speeds: (3,) a varying speed at both ends of the step, and the length of the step.
        velocity: (n, n) D with the Coriolis force of the mean speed of the step.
    """

    columns: Array
    points: Annotated[Array, "2 n"]
    products: Annotated[Array, "3 2 p"]
    force: Annotated[Array, "n"]
    tangent: Annotated[Array, "n n"]
    factor: Annotated[Array, "n n"]
    pivots: Annotated[NDArray[np.int64], "n"]
    key: Annotated[Array, "3"]
    compliance: Compliance
    contact_columns: Array
    contact: Annotated[Array, "m"]
    mass_product: Annotated[Array, "n"]
    velocity_product: Annotated[Array, "n"]
    factors: Annotated[Array, "loads"]
    load_vector: Annotated[Array, "n"]
    pressure_factors: Annotated[Array, "2 k"]
    pressure_vectors: Annotated[Array, "2 n"]
    pressure_tangent: Annotated[Array, "pressed pressed"]
    speeds: Annotated[Array, "3"]
    velocity: Annotated[Array, "D D"]


class ElasticPolynomial(NamedTuple):
    """Coefficients of the elastic force in n coordinates, with p = n (n + 1) / 2 pairs i <= j.

    The quadratic and cubic coefficients of a linear model are empty.

    Attributes:
        force: (n,) f0, the force at q = 0.
        stiffness: (n, n) K.
        quadratic: (p, n) A with its first two indices a pair.
        cubic: (p, p) B/2 with its indices paired and the columns i < j doubled: cubic @ (pairs of
            q) = b.
    """

    force: Array
    stiffness: Array
    quadratic: Array
    cubic: Array


def pairs(n: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Indices i <= j of the n (n + 1) / 2 pairs, in the order 00, 01, .., 11, 12, .. ."""
    i, j = np.triu_indices(n)
    return i.astype(np.int64), j.astype(np.int64)


def pair_numbers(n: int) -> NDArray[np.int64]:
    """The number (n, n) of the pair of two indices, in either order."""
    first, second = pairs(n)
    found = np.zeros((n, n), dtype=np.int64)
    found[first, second] = found[second, first] = np.arange(first.size)
    return found


def elastic_polynomial(products: Array, count: int) -> ElasticPolynomial:
    """The totally symmetric coefficients from the integrated strain products (module docstring).

    Args:
        products: (s, s) from `fenicsrom.reduction.basis`, summed over all ranks.
        count: n.
    """
    (first, second), index = pairs(count), pair_numbers(count)
    eps = slice(1, 1 + count)
    force = products[0, eps].copy()
    prestress = products[0, 1 + count :]
    stiffness = products[eps, eps] + prestress[index]
    g = products[eps, 1 + count :]  # <eps_i, h_p>
    h = products[1 + count :, 1 + count :]
    i, j = first[:, None], second[:, None]
    k = np.arange(count)[None, :]
    quadratic = g[i, index[j, k]] + g[j, index[i, k]] + g[k, index[i, j]]
    k, m = first[None, :], second[None, :]
    cubic = h + h[index[i, k], index[j, m]] + h[index[i, m], index[j, k]]
    cubic *= np.where(first == second, 0.5, 1.0)[None, :]
    return ElasticPolynomial(force, stiffness, quadratic, cubic)


MANY_PAIRS = 500
"""More cubic coefficients do not fit into the cache of a core: only one half of them is read."""


@part
def elastic_products(columns: Array, cubic: Array, q: Array, s: Array, a: Array, b: Array) -> None:
    """The products of the polynomial at k points q (k, n), in one pass over its coefficients.

    Args:
        columns: (n, p) the columns of the quadratic coefficients.
        cubic: (p, p) the cubic ones.
        q: (k, n).
        s: (k, p) out: the products q_i q_j of the pairs, halved for i = j.
        a: (k, p) out: a of the module docstring, by pairs.
        b: (k, p) out: b, those i = j halved (B being symmetric, its rows can be combined, which is
            faster than to multiply them).
    """
    points, n = q.shape
    p = cubic.shape[0]
    for g in range(points):
        row = 0
        for i in range(n):
            s[g, row] = 0.5 * q[g, i] * q[g, i]
            row += 1
            for j in range(i + 1, n):
                s[g, row] = q[g, i] * q[g, j]
                row += 1
    b[:] = 0.0
    if p < MANY_PAIRS:
        add_combined_rows(s, cubic, b)
    else:
        add_symmetric(n, s, a, cubic, b)
    a[:] = 0.0
    add_combined_rows(q, columns, a)


@kernel
def add_symmetric(n: int, s: Array, t: Array, cubic: Array, b: Array) -> None:
    """Add s @ cubic to b by the half of the cubic coefficients above the diagonal.

    Args:
        n: number of coordinates.
        s: (k, p) as in `elastic_products`.
        t: (k, p) scratch.
        cubic: (p, p) the cubic coefficients.
        b: (k, p).
    """
    for g in range(s.shape[0]):
        row = 0
        for i in range(n):
            t[g, row] = 2.0 * s[g, row]
            for j in range(row + 1, row + n - i):
                t[g, j] = s[g, j]
            row += n - i
    add_by_upper_half(s, t, cubic, b)
    for g in range(s.shape[0]):
        row = 0
        for i in range(n):
            b[g, row] += 0.5 * t[g, row]
            for j in range(row + 1, row + n - i):
                b[g, j] += t[g, j]
            row += n - i


@kernel
def elastic_mean(
    elastic: ElasticPolynomial,
    work: Workspace,
    start: Array,
    q0: Array,
    dq: Array,
    start_weight: float,
    points: Array,
    weights: Array,
) -> float:
    """Write the mean force (n,) of `ReducedModel.elastic_over_step` and its derivative (n, n).

    Args:
        elastic: the coefficients.
        work: the arrays of the model; out: `force` and `tangent`.
        start: the arguments of `elastic_over_step` from here to `weights`.
        q0: (n,).
        dq: (n,).
        start_weight: of the force `start`.
        points: (g,) in [0, 1].
        weights: (g,) their weights.

    Returns:
        sum of w_g s_g: the coefficient of the stiffness in the tangent.
    """
    n, count, mean, tangent = q0.size, points.size, work.force, work.tangent
    q = work.points[:count]
    total, moved = 0.0, 0.0
    for g in range(count):
        total += weights[g]
        moved += weights[g] * points[g]
        for i in range(n):
            q[g, i] = q0[i] + points[g] * dq[i]
    for i in range(n):  # the linear part at all points at once
        value = start_weight * start[i] + total * elastic.force[i]
        for j in range(n):
            value += elastic.stiffness[i, j] * (total * q0[j] + moved * dq[j])
            tangent[i, j] = moved * elastic.stiffness[i, j]
        mean[i] = value
    if elastic.cubic.shape[0] == 0:
        return moved
    s, a, b = work.products[0, :count], work.products[1, :count], work.products[2, :count]
    elastic_products(work.columns, elastic.cubic, q, s, a, b)
    for g in range(count):
        weight, lever = weights[g], weights[g] * points[g]
        row = 0
        for i in range(n):
            value = (0.5 * a[g, row] + b[g, row] * (2.0 / 3.0)) * q[g, i]
            tangent[i, i] += lever * (a[g, row] + 2.0 * b[g, row])
            row += 1
            for j in range(i + 1, n):
                both = lever * (a[g, row] + b[g, row])
                mixed = 0.5 * a[g, row] + b[g, row] * (1.0 / 3.0)
                tangent[i, j] += both
                tangent[j, i] += both
                value += mixed * q[g, j]
                mean[j] += weight * mixed * q[g, i]
                row += 1
            mean[i] += weight * value
    return moved


@kernel
def write_tangents(
    elastic: ElasticPolynomial,
    columns: Array,
    q: Array,
    products: Array,
    shares: Array,
    first: Array,
    second: Array,
) -> None:
    """Write two weighted sums of the tangents at k points, in one pass over the coefficients.

    Args:
        elastic: the coefficients.
        columns: (n, p) the columns of the quadratic ones.
        q: (k, n) the points, k at most 2.
        products: (3, 2, p) scratch.
        shares: (2, 2) out of which k columns are the weights of the points in both sums.
        first: (n, n) out.
        second: (n, n) out.
    """
    count, n = q.shape
    total, moved = 0.0, 0.0
    for g in range(count):
        total += shares[0, g]
        moved += shares[1, g]
    for i in range(n):
        for j in range(n):
            first[i, j] = total * elastic.stiffness[i, j]
            second[i, j] = moved * elastic.stiffness[i, j]
    if elastic.cubic.shape[0] == 0:
        return
    s, a, b = products[0, :count], products[1, :count], products[2, :count]
    elastic_products(columns, elastic.cubic, q, s, a, b)
    for g in range(count):
        weight, lever, row = shares[0, g], shares[1, g], 0
        for i in range(n):
            both = a[g, row] + 2.0 * b[g, row]
            first[i, i] += weight * both
            second[i, i] += lever * both
            row += 1
            for j in range(i + 1, n):
                both = a[g, row] + b[g, row]
                first[i, j] += weight * both
                first[j, i] += weight * both
                second[i, j] += lever * both
                second[j, i] += lever * both
                row += 1


@compiled
def elastic_force(elastic: ElasticPolynomial, q: Array, force: Array, tangent: Array) -> float:
    """Write force f (n,) and tangent T (n, n) at q; returns the energy, zero at q = 0, in J."""
    points, products = np.empty((1, q.size)), np.empty((3, 1, elastic.cubic.shape[0]))
    return elastic_force_with(
        elastic, np.ascontiguousarray(elastic.quadratic.T), points, products, q, force, tangent
    )


@kernel
def elastic_force_with(
    elastic: ElasticPolynomial,
    columns: Array,
    points: Array,
    products: Array,
    q: Array,
    force: Array,
    tangent: Array,
) -> float:
    """`elastic_force` with the columns (n, p) of A, and scratch arrays (1, n) and (3, 1, p)."""
    n = q.size
    for i in range(n):
        value = 0.0
        for j in range(n):
            value += elastic.stiffness[i, j] * q[j]
            tangent[i, j] = elastic.stiffness[i, j]
        force[i] = value
    energy = 0.0
    for i in range(n):
        energy += (elastic.force[i] + 0.5 * force[i]) * q[i]
        force[i] += elastic.force[i]
    if elastic.cubic.shape[0] == 0:
        return energy
    for i in range(n):
        points[0, i] = q[i]
    s, a, b = products[0, :1], products[1, :1], products[2, :1]
    elastic_products(columns, elastic.cubic, points[:1], s, a, b)
    row = 0
    for i in range(n):
        for j in range(i, n):
            twice = 2.0 if i == j else 1.0
            both = a[0, row] + twice * b[0, row]
            mixed = 0.5 * a[0, row] + twice * b[0, row] / 3.0
            tangent[i, j] += both
            force[i] += mixed * q[j]
            if j > i:
                tangent[j, i] += both
                force[j] += mixed * q[i]
            energy += s[0, row] * (a[0, row] / 3.0 + twice * b[0, row] / 6.0)
            row += 1
    return energy


ROWS = 256
"""Rows of the paired coefficients that are moved at once."""

Ints = NDArray[np.int64]


def unique_cubic(cubic: Array, n: int) -> Array:
    """The different values of paired cubic coefficients (p, p) of n coordinates."""
    found = np.zeros(count(n) if cubic.size else 0)
    for rows, places, weights in _places(n) if cubic.size else ():
        found[places] = cubic[rows] / weights
    return found


def paired_cubic(values: Array, n: int) -> Array:
    """The paired coefficients (p, p), exactly symmetric, of their different values."""
    p = n * (n + 1) // 2 if values.size else 0
    found = np.zeros((p, p))
    for rows, places, weights in _places(n) if p else ():
        found[rows] = values[places] * weights
    return found


def count(n: int) -> int:
    """The number of different values in n coordinates."""
    return n * (n + 1) * (n + 2) * (n + 3) // 24


def _places(n: int) -> Iterator[tuple[slice, Ints, Array]]:
    """Some rows of the paired coefficients, the places of their values, and their weights.

    The weights are those of `ElasticPolynomial.cubic`: 1/2 in columns i = j, 1 in the others.
    """
    first, second = pairs(n)
    k, m = first[None, :], second[None, :]
    weights = np.where(first == second, 0.5, 1.0)
    for start in range(0, first.size, ROWS):
        rows = slice(start, start + ROWS)
        i, j = first[rows, None], second[rows, None]
        inner, other = np.maximum(i, k), np.minimum(j, m)
        b, c = np.minimum(inner, other) + 1, np.maximum(inner, other) + 2
        a, d = np.minimum(i, k), np.maximum(j, m) + 3
        places = a + b * (b - 1) // 2 + c * (c - 1) * (c - 2) // 6
        yield rows, places + d * (d - 1) * (d - 2) * (d - 3) // 24, weights

"""The reduced model: mass, loads and the exact polynomial of the elastic force in the coordinates q of a basis.

The elastic energy of St Venant-Kirchhoff material is a quartic polynomial of the displacement. With u = u0 + sum q_i phi_i,

    E = E0 + q_i eps_i + 1/2 q_i q_j h_ij,    eps_i = sym(F0^T grad phi_i),    h_ij = sym(grad phi_i^T grad phi_j)

so that the products of E0, eps_i and h_ij under the elasticity tensor, integrated over the body, give every coefficient:

    f_i = f0_i + K_ij q_j + 1/2 A_ijk q_j q_k + 1/6 B_ijkl q_j q_k q_l
    K_ij = <eps_i, eps_j> + <E0, h_ij>
    A_ijk = <eps_i, h_jk> + <eps_j, h_ik> + <eps_k, h_ij>
    B_ijkl = <h_ij, h_kl> + <h_ik, h_jl> + <h_il, h_jk>

With a = A q and b = 1/2 B q q the tangent is T = K + a + b and the force f = f0 + (K + a/2 + b/3) q: one matrix-vector product
gives both. No mesh is touched online.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any, NamedTuple

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from fenicsrom.basis import ReducedBasis
from fenicsrom.contact import ContactPoints
from fenicsrom.dense import add_combined_rows, add_times, compiled, inner, kernel, lu_factor, lu_solve, times, write_times
from fenicsrom.signals import Signals, factors, write_factors

Array = NDArray[np.float64]


class ElasticPolynomial(NamedTuple):
    """Coefficients of the elastic force in n coordinates; p = n (n + 1) / 2 pairs i <= j, empty for a linear model.

    Attributes:
        force: (n,) f0, the force at q = 0.
        stiffness: (n, n) K.
        quadratic: (p, n) A with its first two indices a pair.
        cubic: (p, p) B/2 with its indices paired and the columns i < j doubled: cubic @ (pairs of q) = b.
    """

    force: Array
    stiffness: Array
    quadratic: Array
    cubic: Array


def pairs(n: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Indices i <= j of the n (n + 1) / 2 pairs, in the order used throughout: 00, 01, .., 11, 12, .."""
    i, j = np.triu_indices(n)
    return i.astype(np.int64), j.astype(np.int64)


def strain_products(
    chunks: Iterable[tuple[Array, Array]], first_lame: float, shear_modulus: float, count: int
) -> Array:
    """Integrate the products of E0, eps_i and h_ij under the elasticity tensor.

    Args:
        chunks: pairs (weights (k,), gradients (k, 1 + n, d, d)) at k quadrature points; gradient 0 is that of u0.
        first_lame: lambda (lambda* in plane stress), Pa.
        shear_modulus: mu, Pa.
        count: n.

    Returns:
        (s, s) symmetric, s = 1 + n + n (n + 1) / 2: products <x, y> = int lambda tr x tr y + 2 mu x : y, in J; rows of h_ij
        come in the order of `pairs`.
    """
    first, second = pairs(count)
    size = 1 + count + first.size
    total = np.zeros((size, size))
    for weights, gradients in chunks:
        k, _, d, _ = gradients.shape
        f0 = np.eye(d) + gradients[:, 0]
        strains = np.empty((k, d, d, size))
        strains[..., 0] = gradients[:, 0] + 0.5 * np.einsum("kab,kac->kbc", gradients[:, 0], gradients[:, 0])
        modes = np.ascontiguousarray(np.moveaxis(gradients[:, 1:], 1, -1))  # (k, d, d, n): grad phi_i = modes[..., i]
        strains[..., 1 : 1 + count] = np.einsum("kab,kaci->kbci", f0, modes)
        strains[..., 1 + count :] = np.einsum("kabp,kacp->kbcp", modes[..., first], modes[..., second], optimize=True)
        # Mandel's rows: the product of two columns is x : y; one more row carries the trace
        a, b = np.triu_indices(d)
        shear = np.where(a == b, 0.5, np.sqrt(0.5))
        rows = np.empty((k, a.size + 1, size))
        scale = np.sqrt(2.0 * shear_modulus * weights)
        for r in range(a.size):
            rows[:, r] = (strains[:, a[r], b[r]] + strains[:, b[r], a[r]]) * (shear[r] * scale)[:, None]
        trace = strains[:, range(d), range(d)].sum(axis=1)
        rows[:, -1] = trace * np.sqrt(first_lame * weights)[:, None]
        flat = rows.reshape(-1, size)
        total += flat.T @ flat
    return total


def elastic_polynomial(products: Array, count: int) -> ElasticPolynomial:
    """The totally symmetric coefficients from the integrated strain products (module docstring).

    Args:
        products: (s, s) from `strain_products`, summed over all ranks.
        count: n.
    """
    first, second = pairs(count)
    index = np.zeros((count, count), dtype=np.int64)
    index[first, second] = index[second, first] = np.arange(first.size)
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


class Workspace(NamedTuple):
    """Where a `ReducedModel` of n coordinates and m contact displacements puts its results: valid until its next call.

    (A new array costs numba more than the arithmetic on it, in models of this size.)

    Attributes:
        columns: (n, p) the columns of the quadratic coefficients, which are combined faster than their rows.
        points: (2, n) coordinates.
        products: (3, 2, p) see `elastic_products`.
        force: (n,) elastic force.
        slope: (n, n) its derivative.
        factor: (n, n) the last effective stiffness factorised.
        pivots: (n,)
        key: (2,) what the factor held was made of (a linear model keeps its factor).
        block: (n, 1 + m) right-hand sides and solutions.
        compliance: (m, m) contact displacement by contact force.
        contact: (m,) contact displacement.
        inertia: (n,) M v.
        gyroscopic: (n,) Gamma v.
        factors: (loads,) time factors of the loads.
        load: (n,) load vector.
    """

    columns: Array
    points: Array
    products: Array
    force: Array
    slope: Array
    factor: Array
    pivots: NDArray[np.int64]
    key: Array
    block: Array
    compliance: Array
    contact: Array
    inertia: Array
    gyroscopic: Array
    factors: Array
    load: Array


def negative_eigenvalues(matrix: Array) -> int:
    """Number of negative eigenvalues of the symmetric part of a matrix (n, n)."""
    return int(np.sum(np.linalg.eigvalsh(0.5 * (matrix + matrix.T)) < 0.0))


class ReducedModel(NamedTuple):
    """Everything the online stage needs of n coordinates and m contact displacements.

    Attributes:
        mass: (n, n), kg.
        damping: alpha in C = alpha M, 1/s.
        elastic: coefficients of the elastic force.
        loads: (n, loads), unit loads projected on the basis.
        signals: time factors of the loads.
        points: the contact points.
        contact_rows: (m, n) B^T R, contact displacements by coordinates; m = 0 without contact.
        contact_offset: (m,) contact displacement at q = 0 (the equilibrium), m.
        probe: (d, n) rows that give the displacement of the probe, in global axes.
        probe_offset: (d,) displacement of the probe at q = 0, m.
        turning: (n, n) gyroscopic matrix Gamma, kg/s; (0, 0) of a model without.
        work: where the results go.
    """

    mass: Array
    damping: float
    elastic: ElasticPolynomial
    loads: Array
    signals: Signals
    points: ContactPoints
    contact_rows: Array
    contact_offset: Array
    probe: Array
    probe_offset: Array
    turning: Array
    work: Workspace

    @property
    def size(self) -> int:
        """Number of coordinates n."""
        return self.mass.shape[0]

    @property
    def linear(self) -> bool:
        """Whether the elastic force is linear."""
        return self.elastic.cubic.shape[0] == 0

    @property
    def gyroscopic(self) -> bool:
        """Whether there are gyroscopic forces."""
        return self.turning.shape[0] > 0

    @property
    def gauss_points(self) -> int:
        """Gauss points that integrate the force along a step exactly: 2 for a cubic, 1 for a linear force."""
        return 1 if self.linear else 2

    # The operations of `fenicsrom.integrate.Model`. Compiled code calls the same functions with the model as first argument.

    def elastic_over_step(
        self, start: Array, q0: Array, dq: Array, start_weight: float, points: Array, weights: Array
    ) -> tuple[Array, Array]:
        """Mean elastic force over a step and its derivative by dq: see `fenicsrom.integrate.Scheme`."""
        elastic_mean(self.elastic, self.work, start, q0, dq, start_weight, points, weights)
        return self.work.force, self.work.slope

    def elastic_at(self, q: Array) -> tuple[Array, float]:
        """Elastic force (n,) and energy at q."""
        return self.work.force, elastic_force_with(
            self.elastic, self.work.columns, self.work.points, self.work.products, q, self.work.force, self.work.slope
        )

    def responses(self, inertia: float, drag: float, slope: Array, residual: Array) -> tuple[Array, Array, Array]:
        """Solve S [y, Z] = [-residual, B] with S = inertia M + drag Gamma + slope; returns y (n,), Z (n, m), G = B^T Z (m, m).

        A linear model keeps its factor while S is the same. A singular S gives NaN.
        """
        solve_responses(
            self.mass, self.turning, self.contact_rows, self.elastic.cubic.shape[0] == 0, self.work, inertia, drag, slope,
            residual,
        )  # fmt: skip
        return self.work.block[:, 0], self.work.block[:, 1:], self.work.compliance

    def negative_directions(self, slope: Array) -> int:
        """Number of negative eigenvalues of a stiffness as `elastic_over_step` gives it."""
        return negative_eigenvalues(slope)

    def contact_displacement(self, q: Array) -> Array:
        """Contact displacement (m,) at q, m."""
        add_times(self.contact_offset, self.contact_rows, q, self.work.contact)
        return self.work.contact

    def probe_displacement(self, q: Array) -> Array:
        """Displacement (d,) of the probe at q, m."""
        return self.probe_offset + times(self.probe, q)

    def mass_times(self, v: Array) -> Array:
        """M v (n,)."""
        write_times(self.mass, v, self.work.inertia)
        return self.work.inertia

    def gyroscopic_times(self, v: Array) -> Array:
        """Gamma v (n,)."""
        write_times(self.turning, v, self.work.gyroscopic)
        return self.work.gyroscopic

    def dot(self, a: Array, b: Array) -> float:
        """Inner product of two vectors (n,)."""
        return inner(a, b)

    def load(self, time: float) -> Array:
        """Load vector (n,) at a time, N."""
        write_factors(self.signals, time, self.work.factors)
        write_times(self.loads, self.work.factors, self.work.load)
        return self.work.load


def reduced_model(
    mass: Array,
    damping: float,
    elastic: ElasticPolynomial,
    loads: Array,
    signals: Signals,
    points: ContactPoints,
    contact_rows: Array,
    contact_offset: Array,
    probe: Array,
    probe_offset: Array,
    turning: Array | None = None,
) -> ReducedModel:
    """A `ReducedModel` with its workspace; arguments as its attributes."""
    n, m = mass.shape[0], contact_rows.shape[0]
    turning = np.zeros((0, 0)) if turning is None else turning
    arrays = mass, loads, contact_rows, contact_offset, probe, probe_offset, turning
    tidy = [np.ascontiguousarray(a, dtype=np.float64) for a in arrays]
    coefficients = ElasticPolynomial(*(np.ascontiguousarray(a, dtype=np.float64) for a in elastic))
    where = ContactPoints(np.ascontiguousarray(points.contact, dtype=np.int64), *map(np.ascontiguousarray, points[1:]))
    return ReducedModel(
        tidy[0], float(damping), coefficients, tidy[1], signals, where, tidy[2], tidy[3], tidy[4], tidy[5], tidy[6],
        work=Workspace(
            columns=np.ascontiguousarray(coefficients.quadratic.T), points=np.zeros((2, n)),
            products=np.zeros((3, 2, coefficients.cubic.shape[0])), force=np.zeros(n), slope=np.zeros((n, n)),
            factor=np.zeros((n, n)), pivots=np.zeros(n, dtype=np.int64), key=np.zeros(2),
            block=np.zeros((n, 1 + m)), compliance=np.zeros((m, m)), contact=np.zeros(m), inertia=np.zeros(n),
            gyroscopic=np.zeros(n), factors=np.zeros(loads.shape[1]), load=np.zeros(n),
        ),
    )  # fmt: skip


@kernel
def solve_responses(
    mass: Array,
    turning: Array,
    rows: Array,
    linear: bool,
    work: Workspace,
    inertia: float,
    drag: float,
    slope: Array,
    residual: Array,
) -> None:
    """Leave the solutions of `ReducedModel.responses` in the columns of work.block and in work.compliance."""
    n, m = residual.size, rows.shape[0]
    factor, key, block, compliance = work.factor, work.key, work.block, work.compliance
    if not (linear and key[0] == inertia and key[1] == slope[0, 0]):
        for i in range(n):
            for j in range(n):
                factor[i, j] = inertia * mass[i, j] + slope[i, j]
        if drag != 0.0 and turning.shape[0] > 0:
            for i in range(n):
                for j in range(n):
                    factor[i, j] += drag * turning[i, j]
        key[0] = inertia if lu_factor(factor, work.pivots, n) else np.nan
        key[1] = slope[0, 0]
    for i in range(n):
        block[i, 0] = -residual[i]
        for j in range(m):
            block[i, 1 + j] = rows[j, i]
    if np.isnan(key[0]):
        block[:] = np.nan
    else:
        lu_solve(factor, work.pivots, block, n)
    for i in range(m):
        for j in range(m):
            value = 0.0
            for k in range(n):
                value += rows[i, k] * block[k, 1 + j]
            compliance[i, j] = value


@kernel
def elastic_products(columns: Array, cubic: Array, q: Array, s: Array, a: Array, b: Array) -> None:
    """The products of the polynomial at k points q (k, n), in one pass over its coefficients.

    Args:
        columns: (n, p) the columns of the quadratic coefficients.
        cubic: (p, p) the cubic ones.
        q: (k, n).
        s: (k, p) out: the pairs of q, those i = j halved.
        a: (k, p) out: a of the module docstring, by pairs.
        b: (k, p) out: b, those i = j halved (B being symmetric, its rows can be combined, which is faster than to
            multiply them).
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
        for row in range(p):
            a[g, row] = 0.0
            b[g, row] = 0.0
    add_combined_rows(q, columns, a)
    add_combined_rows(s, cubic, b)


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
) -> None:
    """Leave the results of `ReducedModel.elastic_over_step` in work.force and work.slope."""
    n, count, mean, slope = q0.size, points.size, work.force, work.slope
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
            slope[i, j] = moved * elastic.stiffness[i, j]
        mean[i] = value
    if elastic.cubic.shape[0] == 0:
        return
    s, a, b = work.products[0, :count], work.products[1, :count], work.products[2, :count]
    elastic_products(work.columns, elastic.cubic, q, s, a, b)
    for g in range(count):
        weight, moved = weights[g], weights[g] * points[g]
        row = 0
        for i in range(n):
            value = (0.5 * a[g, row] + b[g, row] * (2.0 / 3.0)) * q[g, i]
            slope[i, i] += moved * (a[g, row] + 2.0 * b[g, row])
            row += 1
            for j in range(i + 1, n):
                both = moved * (a[g, row] + b[g, row])
                mixed = 0.5 * a[g, row] + b[g, row] * (1.0 / 3.0)
                slope[i, j] += both
                slope[j, i] += both
                value += mixed * q[g, j]
                mean[j] += weight * mixed * q[g, i]
                row += 1
            mean[i] += weight * value


@compiled
def elastic_force(elastic: ElasticPolynomial, q: Array, force: Array, tangent: Array) -> float:
    """Force f (n,) and tangent T (n, n) at q, written into the arrays given; returns the energy, zero at q = 0, in J."""
    points, products = np.empty((1, q.size)), np.empty((3, 1, elastic.cubic.shape[0]))
    return elastic_force_with(elastic, np.ascontiguousarray(elastic.quadratic.T), points, products, q, force, tangent)


@kernel
def elastic_force_with(
    elastic: ElasticPolynomial, columns: Array, points: Array, products: Array, q: Array, force: Array, tangent: Array
) -> float:
    """`elastic_force` with the columns (n, p) of A, and room for the coordinates (1, n) and the products (3, 1, p)."""
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


class DenseModel:
    """A model of n coordinates with dense matrices and an elastic force given as a function.

    It serves the intrusive projection of the full elastic force (the paper's method, and the oracle of the polynomial)
    and the 1D beam; it is a `fenicsrom.integrate.Model`.
    """

    def __init__(
        self,
        mass: Array,
        damping: float,
        elastic: Callable[[Array], tuple[Array, Array]],
        energy: Callable[[Array], float],
        loads: Array,
        signals: Signals,
        points: ContactPoints,
        contact_rows: Array,
        contact_offset: Array,
        probe: Array,
        probe_offset: Array,
        turning: Array | None = None,
        *,
        linear: bool,
        gauss_points: int,
    ):
        """Keep the matrices.

        Args:
            mass: (n, n), kg.
            damping: alpha in C = alpha M, 1/s.
            elastic: q -> force (n,) and tangent (n, n).
            energy: q -> elastic energy, J.
            loads: (n, loads) unit loads.
            signals: their time factors.
            points: the contact points.
            contact_rows: (m, n) B^T.
            contact_offset: (m,) contact displacement at q = 0.
            probe: (d, n) rows of the probe's displacement.
            probe_offset: (d,) its displacement at q = 0.
            turning: (n, n) gyroscopic matrix, where there is one.
            linear: the tangent is constant.
            gauss_points: points that integrate the force along a step exactly, or to rounding.
        """
        self.mass, self.damping, self.loads, self.signals = mass, damping, loads, signals
        self.linear, self.gauss_points, self.points = linear, gauss_points, points
        self.gyroscopic = turning is not None and turning.size > 0
        self._turning = turning if turning is not None and turning.size else np.zeros_like(mass)
        self._elastic, self._energy = elastic, energy
        self._rows, self._offset = contact_rows, contact_offset
        self._probe, self._probe_offset = probe, probe_offset
        self._factor: tuple[Array, NDArray[np.int32]] | None = None
        self._key: tuple[float, float] | None = None

    def elastic_over_step(
        self, start: Array, q0: Array, dq: Array, start_weight: float, points: Array, weights: Array
    ) -> tuple[Array, Array]:
        """Mean force over a step and its derivative by dq."""
        mean, slope = start_weight * start, np.zeros_like(self.mass)
        for point, weight in zip(points, weights, strict=True):
            force, tangent = self._elastic(q0 + point * dq)
            mean = mean + weight * force
            slope += weight * point * tangent
        return mean, slope

    def elastic_at(self, q: Array) -> tuple[Array, float]:
        """Elastic force (n,) and energy."""
        return self._elastic(q)[0], self._energy(q)

    def responses(self, inertia: float, drag: float, slope: Array, residual: Array) -> tuple[Array, Array, Array]:
        """Solve (inertia M + drag Gamma + slope) [y, Z] = [-residual, B]; NaN if the matrix is singular."""
        key = (inertia, float(slope[-1, -1]))
        if not (self.linear and key == self._key):
            effective = inertia * self.mass + slope
            if self.gyroscopic:
                effective += drag * self._turning
            self._factor = scipy.linalg.lu_factor(effective, check_finite=False) if np.all(np.isfinite(effective)) else None
            self._key = key
        block = np.concatenate([-residual[:, None], self._rows.T], axis=1)
        if self._factor is None or np.any(np.diag(self._factor[0]) == 0.0):
            block[:] = np.nan
        else:
            block = scipy.linalg.lu_solve(self._factor, block, check_finite=False)
        return block[:, 0].copy(), block[:, 1:].copy(), self._rows @ block[:, 1:]

    def negative_directions(self, slope: Array) -> int:
        """Number of negative eigenvalues of a stiffness."""
        return negative_eigenvalues(slope)

    def contact_displacement(self, q: Array) -> Array:
        """Contact displacement (m,)."""
        return self._offset + self._rows @ q

    def probe_displacement(self, q: Array) -> Array:
        """Displacement (d,) of the probe."""
        return self._probe_offset + self._probe @ q

    def mass_times(self, v: Array) -> Array:
        """M v."""
        return self.mass @ v

    def gyroscopic_times(self, v: Array) -> Array:
        """Gamma v."""
        return self._turning @ v

    def dot(self, a: Array, b: Array) -> float:
        """Inner product."""
        return float(a @ b)

    def load(self, time: float) -> Array:
        """Load vector at a time."""
        return self.loads @ factors(self.signals, time)


def project(solid: Any, basis: ReducedBasis, nonlinear: bool = True) -> ReducedModel:
    """Project the solid on a basis, with the exact polynomial of its elastic force about the equilibrium.

    Args:
        solid: a `fenicsrom.solid.Solid`.
        basis: the basis.
        nonlinear: False gives the linear model of the tangent at the equilibrium.
    """
    r, n = basis.vectors, basis.size
    if nonlinear:
        products = strain_products(solid.tabulate(r), solid.first_lame, solid.shear_modulus, n)
        elastic = elastic_polynomial(solid.comm.allreduce(products), n)
        if solid.rotation is not None:  # its potential is quadratic
            centrifugal = solid.gram(r, solid.rotation.force(solid.equilibrium)[:, None])[:, 0]
            softening = solid.rotation.square * solid.gram(r, solid.rotation.mass_times(r))
            elastic = elastic._replace(force=elastic.force - centrifugal, stiffness=elastic.stiffness - softening)
    else:
        force = solid.gram(r, solid.rest_force[:, None])[:, 0]
        elastic = ElasticPolynomial(force, solid.gram(r, solid.stiffness_times(r)), np.zeros((0, 0)), np.zeros((0, 0)))
    return reduced_model(elastic=elastic, **_projections(solid, r))


def project_intrusively(solid: Any, basis: ReducedBasis) -> DenseModel:
    """The same model with the full elastic force assembled on the mesh and projected at every evaluation (the paper's way)."""
    r, u0 = basis.vectors, solid.equilibrium
    rest = solid.energy(u0)

    def elastic(q: Array) -> tuple[Array, Array]:
        u = u0 + r @ q
        return solid.gram(r, solid.internal_force(u)), solid.gram(r, solid.tangent_times(u, r))

    def energy(q: Array) -> float:
        return float(solid.energy(u0 + r @ q) - rest)

    parts = _projections(solid, r)
    return DenseModel(
        elastic=elastic, energy=energy, linear=False, gauss_points=solid.gauss_points,
        **parts,
    )  # fmt: skip


def projected_gyroscopic(solid: Any, r: Array) -> Array:
    """R^T G R (n, n) of vectors R (local, n), skew, N s/m; (0, 0) where the scene leaves the Coriolis force out."""
    if solid.gyroscopic is None:
        return np.zeros((0, 0))
    return np.asarray(solid.gram(r, solid.gyroscopic_times(r)))


def _projections(solid: Any, r: Array) -> dict[str, Any]:
    """Everything but the elastic force."""
    u0 = solid.equilibrium
    return {
        "mass": solid.gram(r, solid.mass_times(r)),
        "damping": solid.scene.material.mass_damping,
        "loads": solid.gram(r, solid.load_vectors),
        "signals": solid.signals,
        "points": solid.points,
        "contact_rows": solid.comm.allreduce(solid.contact_rows @ r),
        "contact_offset": solid.comm.allreduce(solid.contact_rows @ u0),
        "probe": solid.comm.allreduce(solid.probe_rows @ r),
        "probe_offset": solid.comm.allreduce(solid.probe_rows @ u0),
        "turning": projected_gyroscopic(solid, r),
    }

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
from numba import njit
from numpy.typing import NDArray

from fenicsrom.basis import ReducedBasis
from fenicsrom.dense import add_combined_rows, inner, lu_factor, lu_solve, times

Array = NDArray[np.float64]


class Signals(NamedTuple):
    """The time factors of the loads, amplitude sin(omega t + phase), arrays (loads,): N, rad/s, rad."""

    amplitude: Array
    omega: Array
    phase: Array


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
    chunks: Iterable[tuple[Array, Array]], first_lame: float, shear_modulus: float, count: int, nonlinear: bool = True
) -> Array:
    """Integrate the products of E0, eps_i and h_ij under the elasticity tensor.

    Args:
        chunks: pairs (weights (k,), gradients (k, 1 + n, d, d)) at k quadrature points; gradient 0 is that of u0.
        first_lame: lambda (lambda* in plane stress), Pa.
        shear_modulus: mu, Pa.
        count: n.
        nonlinear: False leaves the h_ij out, but for their product with E0, which belongs to the stiffness.

    Returns:
        (s, s) symmetric, s = 1 + n + n (n + 1) / 2: products <x, y> = int lambda tr x tr y + 2 mu x : y, in J; rows of h_ij
        come in the order of `pairs`. In the linear case only the first row of the products with h_ij is filled.
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
        if nonlinear or np.any(gradients[:, 0]):
            strains[..., 1 + count :] = np.einsum("kabp,kacp->kbcp", modes[..., first], modes[..., second], optimize=True)
        else:
            strains[..., 1 + count :] = 0.0
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
        if nonlinear:
            total += flat.T @ flat
        else:
            head = flat[:, : 1 + count].T @ flat[:, : 1 + count]
            total[: 1 + count, : 1 + count] += head
            total[0, 1 + count :] += flat[:, 0] @ flat[:, 1 + count :]
    return total


def elastic_polynomial(products: Array, count: int, nonlinear: bool = True) -> ElasticPolynomial:
    """The totally symmetric coefficients from the integrated strain products (module docstring).

    Args:
        products: (s, s) from `strain_products`, summed over all ranks.
        count: n.
        nonlinear: False gives the linear model, with empty A and B.
    """
    first, second = pairs(count)
    index = np.zeros((count, count), dtype=np.int64)
    index[first, second] = index[second, first] = np.arange(first.size)
    eps = slice(1, 1 + count)
    force = products[0, eps].copy()
    prestress = products[0, 1 + count :]
    stiffness = products[eps, eps] + prestress[index]
    if not nonlinear:
        return ElasticPolynomial(force, stiffness, np.zeros((0, 0)), np.zeros((0, 0)))
    g = products[eps, 1 + count :]  # <eps_i, h_p>
    h = products[1 + count :, 1 + count :]
    i, j = first[:, None], second[:, None]
    k = np.arange(count)[None, :]
    quadratic = g[i, index[j, k]] + g[j, index[i, k]] + g[k, index[i, j]]
    k, m = first[None, :], second[None, :]
    cubic = h + h[index[i, k], index[j, m]] + h[index[i, m], index[j, k]]
    cubic *= np.where(first == second, 0.5, 1.0)[None, :]
    return ElasticPolynomial(force, stiffness, quadratic, cubic)


class ReducedModel(NamedTuple):
    """Everything the online stage needs of n coordinates, the first m of which are the contact displacements.

    Attributes:
        mass: (n, n), kg.
        damping: alpha in C = alpha M, 1/s.
        elastic: coefficients of the elastic force.
        loads: (n, loads), unit loads projected on the basis.
        signals: time factors of the loads.
        contact_offset: (m,) contact displacement at q = 0 (the equilibrium), m; m = 0 without contact.
        probe: (d, n) rows that give the displacement of the probe, in global axes.
        probe_offset: (d,) displacement of the probe at q = 0, m.
        factor: (n, n) workspace, the last effective stiffness factorised.
        pivots: (n,) workspace.
        key: (2,) workspace: what the factor held was made of (a linear model keeps its factor).
    """

    mass: Array
    damping: float
    elastic: ElasticPolynomial
    loads: Array
    signals: Signals
    contact_offset: Array
    probe: Array
    probe_offset: Array
    factor: Array
    pivots: NDArray[np.int64]
    key: Array

    @property
    def size(self) -> int:
        """Number of coordinates n."""
        return self.mass.shape[0]

    @property
    def linear(self) -> bool:
        """Whether the elastic force is linear."""
        return self.elastic.cubic.shape[0] == 0

    @property
    def gauss_points(self) -> int:
        """Gauss points that integrate the force along a step exactly: 2 for a cubic, 1 for a linear force."""
        return 1 if self.linear else 2

    # The operations of `fenicsrom.integrate.Model`. Compiled code calls the same functions with the model as first argument.

    def elastic_over_step(
        self, start: Array, q0: Array, dq: Array, start_weight: float, points: Array, weights: Array
    ) -> tuple[Array, Array]:
        """Mean elastic force over a step and its derivative by dq: see `fenicsrom.integrate.Scheme`."""
        n = q0.size
        mean = start_weight * start
        slope = np.zeros((n, n))
        add_elastic_mean(self.elastic, q0, dq, points, weights, mean, slope)
        return mean, slope

    def elastic_at(self, q: Array) -> tuple[Array, float]:
        """Elastic force (n,) and energy at q."""
        n = q.size
        force = np.empty(n)
        energy = elastic_force(self.elastic, q, force, np.empty((n, n)))
        return force, energy

    def responses(self, inertia: float, slope: Array, residual: Array) -> tuple[Array, Array, Array]:
        """Solve S [y, Z] = [-residual, B] with S = inertia M + slope; returns y (n,), Z (n, m) and G = B^T Z (m, m).

        B holds the first m unit vectors. A linear model keeps its factor while S is the same. A singular S gives NaN.
        """
        n = residual.size
        m = self.contact_offset.size
        linear = self.elastic.cubic.shape[0] == 0
        if not (linear and self.key[0] == inertia and self.key[1] == slope[0, 0]):
            for i in range(n):
                for j in range(n):
                    self.factor[i, j] = inertia * self.mass[i, j] + slope[i, j]
            self.key[0] = inertia if lu_factor(self.factor, self.pivots) else np.nan
            self.key[1] = slope[0, 0]
        block = np.zeros((n, 1 + m))
        for i in range(n):
            block[i, 0] = -residual[i]
        for i in range(m):
            block[i, 1 + i] = 1.0
        if np.isnan(self.key[0]):
            block[:] = np.nan
        else:
            lu_solve(self.factor, self.pivots, block)
        return block[:, 0].copy(), block[:, 1:].copy(), block[:m, 1:].copy()

    def contact_displacement(self, q: Array) -> Array:
        """Contact displacement (m,) at q, m."""
        return self.contact_offset + q[: self.contact_offset.size]

    def probe_displacement(self, q: Array) -> Array:
        """Displacement (d,) of the probe at q, m."""
        return self.probe_offset + times(self.probe, q)

    def mass_times(self, v: Array) -> Array:
        """M v (n,)."""
        return times(self.mass, v)

    def dot(self, a: Array, b: Array) -> float:
        """Inner product of two vectors (n,)."""
        return inner(a, b)

    def load(self, time: float) -> Array:
        """Load vector (n,) at a time, N."""
        signals = self.signals
        return times(self.loads, signals.amplitude * np.sin(signals.omega * time + signals.phase))


def reduced_model(
    mass: Array,
    damping: float,
    elastic: ElasticPolynomial,
    loads: Array,
    signals: Signals,
    contact_offset: Array,
    probe: Array,
    probe_offset: Array,
) -> ReducedModel:
    """A `ReducedModel` with its workspace; arguments as its attributes."""
    n = mass.shape[0]
    tidy = [np.ascontiguousarray(a, dtype=np.float64) for a in (mass, loads, contact_offset, probe, probe_offset)]
    coefficients = ElasticPolynomial(*(np.ascontiguousarray(a, dtype=np.float64) for a in elastic))
    times = Signals(*(np.ascontiguousarray(a, dtype=np.float64) for a in signals))
    return ReducedModel(
        tidy[0], float(damping), coefficients, tidy[1], times, *tidy[2:],
        factor=np.zeros((n, n)), pivots=np.zeros(n, dtype=np.int64), key=np.zeros(2),
    )  # fmt: skip


@njit(cache=True, error_model="numpy")
def elastic_products(elastic: ElasticPolynomial, q: Array) -> tuple[Array, Array, Array]:
    """The products of the polynomial at k points q (k, n), in one pass over its coefficients.

    Returns:
        s, a, b: (k, p) the pairs of q, a and b of the module docstring; those i = j of s and b are halved. (So they make use
        of the symmetry of B: rows of the matrix are combined, which is faster than to take products with them.)
    """
    points, n = q.shape
    p = elastic.cubic.shape[0]
    s, a, b = np.empty((points, p)), np.empty((points, p)), np.zeros((points, p))
    for g in range(points):
        row = 0
        for i in range(n):
            s[g, row] = 0.5 * q[g, i] * q[g, i]
            row += 1
            for j in range(i + 1, n):
                s[g, row] = q[g, i] * q[g, j]
                row += 1
        for row in range(p):
            value = 0.0
            for k in range(n):
                value += elastic.quadratic[row, k] * q[g, k]
            a[g, row] = value
    add_combined_rows(s, elastic.cubic, b)
    return s, a, b


@njit(cache=True, error_model="numpy")
def add_elastic_mean(
    elastic: ElasticPolynomial, q0: Array, dq: Array, points: Array, weights: Array, mean: Array, slope: Array
) -> None:
    """Add sum_g w_g f(q0 + s_g dq) to mean (n,) and its derivative by dq to slope (n, n)."""
    n, count = q0.size, points.size
    q = np.empty((count, n))
    linear = 0.0
    for g in range(count):
        linear += weights[g] * points[g]
        for i in range(n):
            q[g, i] = q0[i] + points[g] * dq[i]
    for g in range(count):
        for i in range(n):
            value = elastic.force[i]
            for j in range(n):
                value += elastic.stiffness[i, j] * q[g, j]
            mean[i] += weights[g] * value
    for i in range(n):
        for j in range(n):
            slope[i, j] += linear * elastic.stiffness[i, j]
    if elastic.cubic.shape[0] == 0:
        return
    _, a, b = elastic_products(elastic, q)
    for g in range(count):
        row = 0
        for i in range(n):
            mean[i] += weights[g] * (0.5 * a[g, row] + b[g, row] * (2.0 / 3.0)) * q[g, i]
            slope[i, i] += weights[g] * points[g] * (a[g, row] + 2.0 * b[g, row])
            row += 1
            for j in range(i + 1, n):
                both = weights[g] * points[g] * (a[g, row] + b[g, row])
                mixed = weights[g] * (0.5 * a[g, row] + b[g, row] * (1.0 / 3.0))
                slope[i, j] += both
                slope[j, i] += both
                mean[i] += mixed * q[g, j]
                mean[j] += mixed * q[g, i]
                row += 1


@njit(cache=True, error_model="numpy")
def elastic_force(elastic: ElasticPolynomial, q: Array, force: Array, tangent: Array) -> float:
    """Force f (n,) and tangent T (n, n) at q, written into the arrays given; returns the energy, zero at q = 0, in J."""
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
    s, a, b = elastic_products(elastic, q.copy().reshape(1, n))
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
        contact_rows: Array,
        contact_offset: Array,
        probe: Array,
        probe_offset: Array,
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
            contact_rows: (m, n) B^T.
            contact_offset: (m,) contact displacement at q = 0.
            probe: (d, n) rows of the probe's displacement.
            probe_offset: (d,) its displacement at q = 0.
            linear: the tangent is constant.
            gauss_points: points that integrate the force along a step exactly, or to rounding.
        """
        self.mass, self.damping, self.signals = mass, damping, signals
        self.linear, self.gauss_points = linear, gauss_points
        self._elastic, self._energy = elastic, energy
        self._loads, self._rows, self._offset = loads, contact_rows, contact_offset
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

    def responses(self, inertia: float, slope: Array, residual: Array) -> tuple[Array, Array, Array]:
        """Solve (inertia M + slope) [y, Z] = [-residual, B]; NaN if the matrix is singular."""
        key = (inertia, float(slope[-1, -1]))
        if not (self.linear and key == self._key):
            effective = inertia * self.mass + slope
            self._factor = scipy.linalg.lu_factor(effective, check_finite=False) if np.all(np.isfinite(effective)) else None
            self._key = key
        block = np.concatenate([-residual[:, None], self._rows.T], axis=1)
        if self._factor is None or np.any(np.diag(self._factor[0]) == 0.0):
            block[:] = np.nan
        else:
            block = scipy.linalg.lu_solve(self._factor, block, check_finite=False)
        return block[:, 0].copy(), block[:, 1:].copy(), self._rows @ block[:, 1:]

    def contact_displacement(self, q: Array) -> Array:
        """Contact displacement (m,)."""
        return self._offset + self._rows @ q

    def probe_displacement(self, q: Array) -> Array:
        """Displacement (d,) of the probe."""
        return self._probe_offset + self._probe @ q

    def mass_times(self, v: Array) -> Array:
        """M v."""
        return self.mass @ v

    def dot(self, a: Array, b: Array) -> float:
        """Inner product."""
        return float(a @ b)

    def load(self, time: float) -> Array:
        """Load vector at a time."""
        return self._loads @ (self.signals.amplitude * np.sin(self.signals.omega * time + self.signals.phase))


def project(solid: Any, basis: ReducedBasis, nonlinear: bool = True) -> ReducedModel:
    """Project the solid on a basis, with the exact polynomial of its elastic force about the equilibrium.

    Args:
        solid: a `fenicsrom.solid.Solid`.
        basis: the basis.
        nonlinear: False gives the geometrically linear model.
    """
    r, n = basis.vectors, basis.size
    products = solid.comm.allreduce(
        strain_products(solid.tabulate(r), solid.first_lame, solid.shear_modulus, n, nonlinear)
        if nonlinear or solid.loaded
        else np.zeros((0, 0))
    )
    if nonlinear or solid.loaded:
        elastic = elastic_polynomial(products, n, nonlinear)
    else:
        stiffness = solid.gram(r, solid.stiffness_times(r))
        elastic = ElasticPolynomial(np.zeros(n), stiffness, np.zeros((0, 0)), np.zeros((0, 0)))
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
    rows = np.eye(basis.masters, basis.size)
    return DenseModel(
        elastic=elastic, energy=energy, contact_rows=rows, linear=False, gauss_points=2,
        **parts,
    )  # fmt: skip


def _projections(solid: Any, r: Array) -> dict[str, Any]:
    """Everything but the elastic force."""
    u0 = solid.equilibrium
    return {
        "mass": solid.gram(r, solid.mass_times(r)),
        "damping": solid.scene.material.mass_damping,
        "loads": solid.gram(r, solid.load_vectors),
        "signals": solid.signals,
        "contact_offset": solid.comm.allreduce(solid.contact_rows @ u0),
        "probe": solid.comm.allreduce(solid.probe_rows @ r),
        "probe_offset": solid.comm.allreduce(solid.probe_rows @ u0),
    }

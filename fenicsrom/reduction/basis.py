"""Rubin and Craig-Bampton bases, plain or enriched with modal derivatives.

The first coordinates of a basis are the contact displacements:

    u = u₀ + R q,    R = [R_m, R_s],    Bᵀ R_m = I,    Bᵀ R_s = 0,    (1)

with R_m = G (Bᵀ G)⁻¹ for both methods. Together with Φ, Rubin's Ψʳ (Bᵀ Ψʳ)⁻¹ spans the same space,
but it loses rank as modes are added. Every other vector v, a normal mode or a derivative, enters as

    v − R_m Bᵀ v,    (2)

orthonormalised in the mass inner product against the vectors before it. If the norm of the
remaining part, relative to that of the vector (2), is at most `DEPENDENCE`, the vector is dropped
and named. Source: Mashayekhi and Zucca (2024), eqs. (12) and (13).

Integrals of the products of strains, from which the elastic polynomial is made.

With the displacement u = u₀ + Σ q_i φ_i the strain is a quadratic polynomial of q,

    E = E₀ + q_i ε_i + ½ q_i q_j h_ij,    ε_i = sym(F₀ᵀ ∇φ_i),    h_ij = sym(∇φ_iᵀ ∇φ_j),    (3)

and the polynomial of `fenicsrom.online.model.polynomial` needs all products

    ⟨x, y⟩ = ∫ x : C y    (4)

of E₀, ε_i and h_ij. With C = L Lᵀ in Mandel's notation and the weight w of a quadrature point, a
strain x becomes a column √w Lᵀ x of d (d + 1) / 2 numbers at each point, so that the inner product
of two columns is (4). BLAS multiplies the columns of many points at once.

Projection of a structure on a basis: the reduced model.

The displacement is u = u₀ + R q. Every matrix of the structure is projected by Galerkin's method,
for example the mass Rᵀ M R; the elastic force is Rᵀ f(u₀ + R q).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.linalg.blas import dsyrk

from fenicsrom.arrays import Array
from fenicsrom.errors import AccuracyError, ErrorKind
from fenicsrom.online.kernels.dense import scaled_condition
from fenicsrom.online.model.loads import PressurePolynomial, static_factors
from fenicsrom.online.model.matrices import DenseModel
from fenicsrom.online.model.model import ReducedModel, reduced_model
from fenicsrom.online.model.polynomial import ElasticPolynomial, paired_cubic, pairs, unique_cubic
from fenicsrom.online.stress.stress import write_strains
from fenicsrom.reduction.protocols import Structure
from fenicsrom.words import brief

if TYPE_CHECKING:
    from fenicsrom.reduction.modes import ComponentModes


BLOCK_BYTES = 4e6
"""Memory of the strains of one block of points; it fits into the cache of a processor."""


def strain_products(chunks: Iterable[tuple[Array, Array]], stiffness: Array, count: int) -> Array:
    """Integrate the products (4) of E₀, ε_i and h_ij.

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
    total = np.zeros((size, size), order="F")
    for weights, gradients in chunks:
        d = gradients.shape[-1]
        block = max(1, int(BLOCK_BYTES / (8 * size * d * (d + 1) / 2)))
        for start in range(0, weights.size, block):
            part = slice(start, start + block)
            g = np.ascontiguousarray(gradients[part].transpose(2, 3, 1, 0))
            strains = np.empty((size, len(root), g.shape[-1]))
            write_strains(g, g * np.sqrt(weights[part]), strains)
            columns = np.matmul(root, strains).reshape(size, -1)
            total = dsyrk(1.0, columns.T, 1.0, total, trans=1, overwrite_c=1)
    return np.triu(total) + np.triu(total, 1).T


DEPENDENCE = 1e-7
"""A vector is dropped if the relative norm of its independent part is at most this."""

KEPT = 0.5
"""A vector of norm 1 is a rounding error if orthogonalising it once more leaves at most this."""

WELL_DEFINED = 1e-3
"""Smallest independent part of a vector, relative to its norm, that a Cholesky factor resolves.

The factor is accurate to 1e-16 of the square of the norm, so the part has six digits.
"""

ORTHOGONALITY = 1e-10
"""Largest error of the properties (1), relative to the largest sum of terms |b r| in Bᵀ R."""


@brief()
@dataclass(frozen=True, eq=False, repr=False)
class ReducedBasis:
    """A basis of n vectors, the first m for the contact displacements.

    Attributes:
        method: "rubin" or "craig-bampton".
        vectors: (local, n) R.
        labels: (n,) labels of the coordinates: static modes, then normal modes and derivatives.
        masters: m.
        dropped: for the label of each dropped vector, the relative norm of its independent part.
        condition: condition number of Rᵀ M R after scaling to unit diagonal.
    """

    method: str
    vectors: Array
    labels: tuple[str, ...]
    masters: int
    dropped: dict[str, float]
    condition: float

    @property
    def size(self) -> int:
        """Number of coordinates n, masters included."""
        return self.vectors.shape[1]

    def part(self, labels: Sequence[str], mass: Array) -> ReducedBasis:
        """The basis of these vectors, the masters first; `mass` (n, n) is their Rᵀ M R."""
        vectors = self.vectors[:, [self.labels.index(label) for label in labels]]
        return replace(
            self, vectors=vectors, labels=tuple(labels), condition=scaled_condition(mass)
        )


def build_basis(
    structure: Structure,
    modes: ComponentModes,
    vectors: Array,
    labels: Sequence[str],
    dependence: float = DEPENDENCE,
) -> ReducedBasis:
    """Orthonormalise the vectors and assemble the basis.

    Args:
        structure: the structure.
        modes: its component modes, which give the method, R_m and Bᵀ.
        vectors: (local, k) normal modes and derivatives, the most important first.
        labels: (k,) labels of the vectors.
        dependence: a vector is dropped if the relative norm of its independent part is at most
            this.

    Returns:
        The basis.

    Raises:
        AccuracyError: Bᵀ R differs from [I, 0], or R_s is not orthonormal (`ORTHOGONALITY`).
    """
    enrichment, names, dropped = _orthonormalised(structure, modes, vectors, labels, dependence)
    m = modes.masters.shape[1]
    r = np.ascontiguousarray(np.concatenate([modes.masters, enrichment], axis=1))
    gram = structure.mass_inner(r, r)
    _check(structure, modes, r, gram)
    static = [f"{k + 1}S" for k in range(m)]
    return ReducedBasis(modes.method, r, (*static, *names), m, dropped, scaled_condition(gram))


def extended_space(inner: Callable[[Array, Array], Array], space: Array, vectors: Array) -> Array:
    """Extend an M-orthonormal space (local, k) by the vectors that it does not contain yet.

    Args:
        inner: the mass inner products of two blocks.
        space: the space.
        vectors: (local, m).

    Returns:
        (local, k + l) the space, then l ≤ m vectors.
    """
    sizes = np.sqrt(np.diag(inner(vectors, vectors)))
    vectors = vectors[:, sizes > 0.0] / sizes[sizes > 0.0]
    for least in (DEPENDENCE, KEPT):  # the second pass removes the rounding errors of the first
        vectors = vectors - space @ inner(space, vectors)
        values, turn = np.linalg.eigh(inner(vectors, vectors))
        keep = values > least**2
        vectors = vectors @ (turn[:, keep] / np.sqrt(values[keep]))
    return np.concatenate([space, vectors], axis=1)


def _orthonormalised(
    structure: Structure,
    modes: ComponentModes,
    vectors: Array,
    labels: Sequence[str],
    dependence: float,
) -> tuple[Array, list[str], dict[str, float]]:
    """Apply (2) to the vectors, and orthonormalise each vector against the kept ones before it.

    A block of vectors is orthonormalised by the Cholesky factor of its Gram matrix (Cholesky-QR,
    twice), as Gram-Schmidt does vector by vector. The factor loses digits where a vector is nearly
    dependent. The block then ends before this vector, and the next block begins with it.

    Returns:
        The kept vectors (local, k), their labels, and for the label of each other vector the
        relative norm of its independent part.
    """
    inner, total = structure.mass_inner, structure.comm.allreduce
    masters, rows = modes.masters, modes.rows
    kept, dropped = vectors[:, :0], dict[str, float]()
    names: list[str] = []
    sizes = np.sqrt(np.maximum(np.diag(inner(vectors, vectors)), 0.0))
    rest = (vectors - masters @ total(rows @ vectors)) / np.where(sizes > 0.0, sizes, 1.0)
    first = 0
    while first < len(labels):
        for _ in range(2 if names else 0):  # the second pass removes rounding errors of the first
            rest = rest - kept @ inner(kept, rest)
        gram = inner(rest, rest)
        remainder = float(np.sqrt(max(gram[0, 0], 0.0)))
        if remainder <= dependence:
            dropped[labels[first]] = remainder
            first, rest = first + 1, rest[:, 1:]
            continue
        block = _normalised(rest, gram, dependence)
        # the division has amplified rounding errors: restore both properties in turn
        for _ in range(2):
            block = block - masters @ total(rows @ block)
            block = block - kept @ inner(kept, block)
            block = _normalised(block, inner(block, block), dependence)
        kept = np.concatenate([kept, block], axis=1)
        names += labels[first : first + block.shape[1]]
        first, rest = first + block.shape[1], rest[:, block.shape[1] :]
    return kept, names, dropped


def _normalised(block: Array, gram: Array, dependence: float) -> Array:
    """The first vectors of a block (local, k) with Gram matrix (k, k), made orthonormal.

    The first vector is always taken. The next ones are taken as long as their independent part is
    at least `WELL_DEFINED` of their own norm and well above the `dependence`.
    """
    from scipy.linalg import solve_triangular  # slow to import, and reused bases do not need it

    size, taken = gram.shape[0], 1
    least = np.maximum(WELL_DEFINED**2 * np.diag(gram), (dependence / WELL_DEFINED) ** 2)
    lower = np.zeros((size, size))
    lower[0, 0] = np.sqrt(gram[0, 0])
    for k in range(1, size):
        lower[k, :k] = solve_triangular(lower[:k, :k], gram[:k, k], lower=True)
        square = gram[k, k] - float(lower[k, :k] @ lower[k, :k])
        if not square >= least[k]:
            break
        lower[k, k] = np.sqrt(square)
        taken = k + 1
    inverse = solve_triangular(lower[:taken, :taken], np.eye(taken), lower=True)
    return np.asarray(block[:, :taken] @ inverse.T)


def _check(structure: Structure, modes: ComponentModes, r: Array, gram: Array) -> None:
    """Check the properties (1) of a basis R (local, n) with the Gram matrix Rᵀ M R (n, n).

    Raises:
        AccuracyError: a property does not hold.
    """
    total, rows, m, n = structure.comm.allreduce, modes.rows, modes.rows.shape[0], r.shape[1]
    contact_error = np.abs(total(rows @ r) - np.eye(m, n)).max(initial=0.0)
    skewness = np.abs(gram[m:, m:] - np.eye(n - m)).max(initial=0.0)
    largest = max(1.0, np.abs(total(np.abs(rows) @ np.abs(r))).max(initial=0.0))
    if contact_error > ORTHOGONALITY * largest or skewness > 100 * ORTHOGONALITY:
        raise AccuracyError(
            f"the {modes.method} basis is inaccurate: the contact displacements are wrong by "
            f"{contact_error:.1e}, the orthogonality by {skewness:.1e}",
            kind=ErrorKind.BASIS,
        )


COUPLING = 1e-3
"""A smaller relative change of the frequencies by the skew part of the tangent does not count."""


def project(structure: Structure, basis: ReducedBasis, nonlinear: bool = True) -> ReducedModel:
    """Project a structure on a basis, with the exact polynomials of its forces.

    Args:
        structure: the structure.
        basis: the basis.
        nonlinear: False gives the linear model of the tangent at the equilibrium, with its skew
            part by static follower pressures. Pressures that vary in time then have constant
            directions.

    Returns:
        The reduced model; its elastic force needs no mesh.

    Raises:
        SceneError: the internal force of the structure is not a polynomial.
    """
    r = basis.vectors
    pressure = None
    if nonlinear:
        elastic = structure.elastic_polynomial(r)
        n = r.shape[1]  # exactly symmetric, as the file of the model stores it
        elastic = elastic._replace(cubic=paired_cubic(unique_cubic(elastic.cubic, n), n))
        pressure = structure.pressure_polynomial(r)
    else:
        force = structure.inner(r, structure.rest_force[:, None])[:, 0]
        stiffness, none = structure.inner(r, structure.stiffness_times(r)), np.zeros((0, 0))
        elastic = ElasticPolynomial(force, stiffness, none, none)
        pressure = None if structure.symmetric else _skew_pressure(structure, r, elastic.stiffness)
    bolts = structure.bolts.moved(
        lambda rows: structure.comm.allreduce(rows @ np.column_stack([structure.equilibrium, r]))
    )
    terms = projected_terms(structure, r)
    return reduced_model(elastic=elastic, pressure=pressure, bolts=bolts, **terms)


def _skew_pressure(structure: Structure, r: Array, stiffness: Array) -> PressurePolynomial | None:
    """The skew parts of the tangents of the static follower pressures on vectors R (local, n).

    Args:
        structure: the structure.
        r: the vectors R.
        stiffness: (n, n) symmetric part of the stiffness, N/m.

    Returns:
        Linear forces; None if they change no frequency by more than `COUPLING`.
    """
    found = structure.pressure_polynomial(r)
    sizes = static_factors(structure.load_histories)[found.numbers]
    skew = 0.5 * (found.linear - found.linear.transpose(0, 2, 1))
    skew[sizes == 0.0] = 0.0
    mass = structure.inner(r, structure.mass_times(r))
    both = np.linalg.solve(mass, stiffness), np.linalg.solve(mass, np.tensordot(sizes, skew, 1))
    plain, coupled = (
        np.sort_complex(np.sqrt(np.linalg.eigvals(matrix).astype(complex)))
        for matrix in (both[0], both[0] - both[1])
    )
    if np.all(np.abs(coupled - plain) <= COUPLING * np.abs(plain)):
        return None
    return PressurePolynomial(found.numbers, skew, np.zeros((len(skew), 0, *skew.shape[1:])))


def project_intrusively(structure: Structure, basis: ReducedBasis) -> DenseModel:
    """Project a structure on a basis, with the full internal force evaluated at every call.

    Mashayekhi and Zucca (2024) evaluate the elastic force in this way. The result equals that of
    `project` to round-off, and is much slower.
    """
    r, u0 = basis.vectors, structure.equilibrium
    rest = structure.energy(u0)

    def elastic(q: Array) -> tuple[Array, Array]:
        u = u0 + r @ q
        force = structure.inner(r, structure.internal_force(u))
        return force, structure.inner(r, structure.tangent_times(u, r))

    def energy(q: Array) -> float:
        return float(structure.energy(u0 + r @ q) - rest)

    return DenseModel(
        elastic=elastic,
        energy=energy,
        linear=False,
        gauss_points=structure.gauss_points,
        **projected_terms(structure, r),
    )


def projected_gyroscopic(structure: Structure, r: Array) -> Array:
    """Project the gyroscopic matrix on vectors R (local, n).

    Returns:
        Rᵀ G R (n, n), skew, N s/m; (0, 0) where no Coriolis force acts.
    """
    if structure.gyroscopic is None:
        return np.zeros((0, 0))
    return np.asarray(structure.inner(r, structure.gyroscopic_times(r)))


def projected_velocity_matrix(structure: Structure, r: Array) -> Array:
    """Project the gyroscopic matrix and the viscous damping on vectors R (local, n).

    Returns:
        Rᵀ D R (n, n), N s/m; (0, 0) without such forces.
    """
    found = projected_gyroscopic(structure, r)
    if not structure.viscous.acts:
        return found
    viscous = np.asarray(structure.inner(r, structure.viscous.times(r)))
    viscous = 0.5 * (viscous + viscous.T)
    return found + viscous if found.size else viscous


def projected_terms(structure: Structure, r: Array) -> dict[str, Any]:
    """All arguments of a reduced model except its elastic force, by their names."""
    u0, total = structure.equilibrium, structure.comm.allreduce
    return {
        "mass": structure.inner(r, structure.mass_times(r)),
        "damping": structure.mass_damping,
        "loads": structure.inner(r, structure.load_vectors),
        "load_histories": structure.load_histories,
        "points": structure.points,
        "contact_rows": total(structure.contact_rows @ r),
        "contact_offset": total(structure.contact_rows @ u0),
        "probe": total(structure.probe_rows @ r),
        "probe_offset": total(structure.probe_rows @ u0),
        "velocity_matrix": projected_velocity_matrix(structure, r),
    }

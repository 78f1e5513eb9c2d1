"""Craig–Bampton frequencies printed by MSC Nastran for a bar of two superelements.

The numbers come from MSC Nastran output files shipped with NASTRAN_CoFE (testing/superelements,
cantilever_bar). The bar has ten Euler–Bernoulli elements in plane bending, lumped translational
mass and massless rotations; it is clamped at the first node and cut at the sixth. A part keeps w
and θ of the cut as masters, and its modes of lowest frequency with both held.
"""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.linalg import eigh, solve

Array = NDArray[np.float64]

LENGTH, AREA, INERTIA, YOUNG, DENSITY = 1.0, 0.1, 0.01, 2.9e7, 7.357e-4
FULL = ["349.7288", "2167.324", "6007.803", "11650.23"]
CRAIG_BAMPTON = {
    0: ["359.0738", "2934.100"],
    1: ["349.7555", "2182.490", "6733.634", "18222.00"],
    2: ["349.7299", "2168.126", "6011.365", "11851.45"],
    3: ["349.7289", "2167.436", "6008.068", "11670.88"],
}


def bar(elements: int) -> tuple[Array, Array]:
    """Stiffness and mass of a free bar, (w, θ) node after node; every element gives half its mass
    to each end."""
    h = LENGTH
    bend = np.array([[12, 6 * h, -12, 6 * h], [6 * h, 4 * h**2, -6 * h, 2 * h**2]])
    bend = (
        np.vstack((bend, [[-12, -6 * h, 12, -6 * h], [6 * h, 2 * h**2, -6 * h, 4 * h**2]]))
        * YOUNG
        * INERTIA
        / h**3
    )
    stiffness, mass = np.zeros((2, 2 * elements + 2, 2 * elements + 2))
    for first in range(0, 2 * elements, 2):
        stiffness[first : first + 4, first : first + 4] += bend
        mass[[first, first + 2], [first, first + 2]] += DENSITY * AREA * h / 2
    return stiffness, mass


def frequencies(stiffness: Array, mass: Array) -> Array:
    """The finite frequencies in Hz, ascending: eigenvalues 1/ω² of the mass in the metric of the
    stiffness."""
    inverse = eigh(mass, stiffness, eigvals_only=True)[::-1]
    finite = inverse[inverse > 1e-12 * inverse[0]]
    return np.asarray(1.0 / (2 * np.pi * np.sqrt(finite)))


def held_inverse(stiffness: Array, masters: Array) -> tuple[Array, Array]:
    """Constraint modes G (BᵀG)⁻¹ and the inverse of the stiffness with fixed masters, K⁻¹ − G
    (BᵀG)⁻¹ Gᵀ, with G = K⁻¹ B. Neither changes when springs are added at the masters, K + s B Bᵀ,
    which makes the stiffness of a free part regular."""
    scale = np.abs(stiffness).max()
    grounded = solve(
        stiffness + scale * masters @ masters.T, np.eye(len(stiffness)), assume_a="pos"
    )
    attachment = grounded @ masters
    constraint = attachment @ np.linalg.inv(masters.T @ attachment)
    return constraint, grounded - constraint @ attachment.T


def craig_bampton(stiffness: Array, mass: Array, masters: Array, modes: int) -> Array:
    """The basis [constraint modes, fixed-interface modes of lowest frequency] of a part; each
    column of B is a master."""
    constraint, inverse = held_inverse(stiffness, masters)
    root = np.sqrt(np.diag(mass))  # of a diagonal mass
    inverse_squares, shapes = np.linalg.eigh(root[:, None] * inverse * root)
    last = np.argsort(inverse_squares)[::-1][:modes]
    fixed = inverse @ (root[:, None] * shapes[:, last]) / inverse_squares[last]
    return np.hstack((constraint, fixed))


def parts() -> list[tuple[Array, Array, Array]]:
    """K, M, B of the clamped part (nodes 2 to 6) and the free part (nodes 6 to 11); masters are w
    and θ of node 6."""
    stiffness, mass = bar(5)
    clamped = stiffness[2:, 2:], mass[2:, 2:], np.eye(10)[:, -2:]
    free = stiffness, mass, np.eye(12)[:, :2]
    return [clamped, free]


def coupled(clamped_modes: int, free_modes: int) -> tuple[Array, Array]:
    """Reduced stiffness and mass of the two parts, which share (w, θ) of node 6, with this many
    modes per part."""
    first, second = 2 + clamped_modes, 2 + clamped_modes + free_modes
    result = np.zeros((2, second, second))
    for part, (stiffness, mass, masters) in enumerate(parts()):
        own = (np.r_[0:first], np.r_[0:2, first:second])[part]
        basis = craig_bampton(stiffness, mass, masters, len(own) - 2)
        for total, matrix in zip(result, (stiffness, mass), strict=True):
            total[np.ix_(own, own)] += basis.T @ matrix @ basis
    return result[0], result[1]


def assert_printed(values: Array, printed: list[str]) -> None:
    """Equal in all seven printed digits."""
    assert [f"{value:#.7g}" for value in values[: len(printed)]] == printed


def test_frequencies_of_full_model_match_nastran() -> None:
    stiffness, mass = bar(10)
    assert_printed(frequencies(stiffness[2:, 2:], mass[2:, 2:]), FULL)


@pytest.mark.parametrize("modes", CRAIG_BAMPTON)
def test_craig_bampton_frequencies_match_nastran(modes: int) -> None:
    """Reference: frequencies of a bar of two superelements, whole and by Craig–Bampton | MSC
    Nastran, output of NASTRAN_CoFE | 349.7555, 2182.490 Hz, … | equal | all seven digits
    """
    assert_printed(frequencies(*coupled(modes, modes)), CRAIG_BAMPTON[modes])


def test_craig_bampton_with_all_modes_equals_full_model() -> None:
    """The clamped part has four inner translations and the free part five: with as many modes the
    reduction is exact."""
    for (stiffness, mass, masters), finite in zip(parts(), (4, 5), strict=True):
        inverse = held_inverse(stiffness, masters)[1]
        assert (
            np.linalg.matrix_rank(inverse @ mass, tol=1e-12 * np.abs(inverse @ mass).max())
            == finite
        )
    assert_printed(frequencies(*coupled(4, 5)), FULL)


@pytest.mark.parametrize("part", [0, 1])
def test_constraint_modes_match_partitioned_matrices(part: int) -> None:
    """G (BᵀG)⁻¹ = [I; −K_ss⁻¹ K_sm] for the free part too; the inverse with fixed masters is
    K_ss⁻¹; fixed-interface modes vanish at the masters."""
    stiffness, mass, masters = parts()[part]
    held = masters.any(axis=1)
    inside = np.linalg.inv(stiffness[np.ix_(~held, ~held)])
    constraint, inverse = held_inverse(stiffness, masters)
    np.testing.assert_allclose(constraint[held], np.eye(2), atol=1e-10)
    np.testing.assert_allclose(
        constraint[~held], -inside @ stiffness[np.ix_(~held, held)], atol=1e-10
    )
    np.testing.assert_allclose(
        inverse[np.ix_(~held, ~held)], inside, atol=1e-10 * np.abs(inside).max()
    )
    fixed = craig_bampton(stiffness, mass, masters, 3)[:, 2:]
    assert np.abs(fixed[held]).max() < 1e-9 * np.abs(fixed).max()
    np.testing.assert_allclose(fixed.T @ mass @ fixed, np.eye(3), atol=1e-9)

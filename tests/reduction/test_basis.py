"""The basis: contact displacements first and exact, the rest orthonormal, dependent vectors
named."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from support import enriched

from fenicsrom.errors import AccuracyError, ErrorKind
from fenicsrom.reduction.basis import DEPENDENCE, build_basis, extended_space
from fenicsrom.reduction.beam import SerialCommunicator

Array = NDArray[np.float64]


def inner(a: Array, b: Array) -> Array:
    return a.T @ (WEIGHTS[:, None] * b)


N = 12
WEIGHTS = np.linspace(1.0, 3.0, N)
ROWS = np.eye(2, N) + 0.1 * np.eye(2, N, 3)
MASTERS = np.linalg.pinv(ROWS) + (np.eye(N) - np.linalg.pinv(ROWS) @ ROWS)[:, 5:7]


def make(vectors: Array, labels: list[str], masters: Array = MASTERS) -> Any:
    structure: Any = SimpleNamespace(mass_inner=inner, comm=SerialCommunicator())
    modes: Any = SimpleNamespace(method="rubin", masters=masters, rows=ROWS[: masters.shape[1]])
    return build_basis(structure, modes, vectors, labels)


def test_basis_has_identity_block_orthonormal_rest_and_labels() -> None:
    vectors = np.random.default_rng(0).standard_normal((N, 3)) * [1e-6, 1.0, 1e6]
    basis = make(vectors, ["1V", "2V", "1V1V"])
    assert basis.labels == ("1S", "2S", "1V", "2V", "1V1V")
    assert (basis.size, basis.masters, basis.dropped, basis.method) == (5, 2, {}, "rubin")
    np.testing.assert_allclose(ROWS @ basis.vectors, np.eye(2, 5), atol=1e-12)
    np.testing.assert_array_equal(basis.vectors[:, :2], MASTERS)
    np.testing.assert_allclose(inner(basis.vectors, basis.vectors)[2:, 2:], np.eye(3), atol=1e-12)
    # in order: each is made of those before it
    outside = vectors - projection(basis.vectors[:, :4]) @ vectors
    np.testing.assert_allclose(outside[:, :2], 0.0, atol=1e-12)
    assert np.linalg.norm(outside[:, 2]) > 1e4
    assert 1.0 <= basis.condition < 100


def projection(block: Array) -> Array:
    q, _ = np.linalg.qr(block)
    return q @ q.T


def test_dependent_vectors_are_dropped_and_named() -> None:
    rng = np.random.default_rng(1)
    v, w, noise = rng.standard_normal((3, N))
    vectors = np.stack(
        [v, 5 * v + 1e-10 * noise, MASTERS @ [1.0, -2.0], v + 1e-3 * w, 0 * v, w], axis=1
    )
    basis = make(vectors, ["1V", "2V", "3V", "4V", "1V1V", "5V"])
    assert basis.labels == ("1S", "2S", "1V", "4V")
    assert set(basis.dropped) == {"2V", "3V", "1V1V", "5V"}
    assert all(left <= DEPENDENCE for left in basis.dropped.values())
    # what is measured is what a vector adds relative to its own size, whatever its unit
    scaled = make(
        vectors * [1e9, 1e-9, 1e9, 1e-9, 1.0, 1e9], ["1V", "2V", "3V", "4V", "1V1V", "5V"]
    )
    assert scaled.labels == basis.labels
    np.testing.assert_allclose(scaled.vectors, basis.vectors, atol=1e-9)


def test_masters_that_do_not_fit_the_rows_are_refused() -> None:
    with pytest.raises(AccuracyError) as caught:
        make(np.random.default_rng(2).standard_normal((N, 1)), ["1V"], 1.001 * MASTERS)
    assert caught.value.kind is ErrorKind.BASIS


def test_basis_without_contact_or_enrichment_is_made() -> None:
    none = make(np.eye(N)[:, :2], ["1V", "2V"], np.zeros((N, 0)))
    assert none.labels == ("1V", "2V") and none.masters == 0
    np.testing.assert_allclose(inner(none.vectors, none.vectors), np.eye(2), atol=1e-14)
    plain = make(np.zeros((N, 0)), [])
    assert plain.labels == ("1S", "2S")
    np.testing.assert_array_equal(plain.vectors, MASTERS)


@pytest.mark.parametrize(
    ("name", "method"),
    [
        ("beam2d", "craig-bampton"),
        ("beam3d", "rubin"),
        ("bent2d", "rubin"),
        ("bent3d", "craig-bampton"),
    ],
)
def test_basis_of_solid_is_exact_at_the_contact(
    name: str, method: str, request: pytest.FixtureRequest
) -> None:
    solid = request.getfixturevalue(name)
    modes, theta, basis = enriched(solid, method, 2)
    m, d = basis.masters, solid.dimension
    assert m == d and basis.labels[: m + 2] == (*(f"{k + 1}S" for k in range(d)), "1V", "2V")
    np.testing.assert_allclose(solid.contact_rows @ basis.vectors, np.eye(m, basis.size), atol=1e-9)
    gram = solid.mass_inner(basis.vectors, basis.vectors)
    np.testing.assert_allclose(gram[m:, m:], np.eye(basis.size - m), atol=1e-9)
    assert basis.size + len(basis.dropped) == m + 2 + theta.shape[1]
    # nothing is lost: all vectors lie in the span, in the mass norm and relative to their size
    block = np.concatenate([modes.normal, modes.static, theta], axis=1)
    block = block / np.sqrt(np.diag(solid.mass_inner(block, block)))
    outside = block - basis.vectors @ np.linalg.solve(gram, solid.mass_inner(basis.vectors, block))
    assert np.sqrt(np.diag(solid.mass_inner(outside, outside))).max() < 2 * DEPENDENCE


@pytest.mark.parametrize("name", ["beam2d", "bent3d"])
def test_rubin_spans_modes_and_attachment_modes(name: str, request: pytest.FixtureRequest) -> None:
    """span{Phi, Psi^r} = span{Phi, G}: the static response to contact forces is exact for any
    number of modes."""
    solid = request.getfixturevalue(name)
    attachment = solid.factor.solve(solid.contact_rows.T.toarray())
    for count in (1, 4):
        modes, _, basis = enriched(solid, "rubin", count, [])
        k = solid.inner(basis.vectors, solid.stiffness_times(basis.vectors))
        reduced = np.linalg.solve(k, solid.inner(basis.vectors, solid.contact_rows.T.toarray()))
        # the static compliance of the contact point from the reduced model is that of a solve
        exact = solid.contact_rows @ attachment
        np.testing.assert_allclose(
            reduced[: basis.masters], exact, rtol=0, atol=1e-7 * np.abs(exact).max()
        )
        u = basis.vectors @ reduced
        np.testing.assert_allclose(u, attachment, rtol=0, atol=1e-7 * np.abs(attachment).max())
        # and the frequencies are those of its modes
        squares = np.linalg.eigvals(
            np.linalg.solve(solid.mass_inner(basis.vectors, basis.vectors), k)
        )
        np.testing.assert_allclose(np.sort(squares.real)[:count], modes.omega**2, rtol=1e-5)


def one_by_one(vectors: Array) -> tuple[Array, list[int]]:
    """Gram-Schmidt vector by vector, repeated: the vectors (N, kept) and their numbers."""
    kept: list[Array] = []
    numbers = []
    for k, vector in enumerate(vectors.T):
        v = vector - MASTERS @ (ROWS @ vector)
        v /= np.sqrt(vector @ (WEIGHTS * vector))
        for _ in range(4):
            for other in kept:
                v = v - other * (other @ (WEIGHTS * v))
            v = v - MASTERS @ (ROWS @ v)
        size = np.sqrt(v @ (WEIGHTS * v))
        if size > DEPENDENCE:
            for _ in range(4):
                v = v / np.sqrt(v @ (WEIGHTS * v))
                for other in kept:
                    v = v - other * (other @ (WEIGHTS * v))
            kept.append(v)
            numbers.append(k)
    return np.array(kept).T, numbers


def test_blocks_give_the_vectors_of_gram_schmidt() -> None:
    rng = np.random.default_rng(5)
    vectors = rng.standard_normal((N, 9))
    # parts outside of the vectors before: at the ends of blocks, and around the threshold
    for k, part in ((2, 1e-2), (3, 1e-5), (5, 3e-7), (6, 2e-8), (8, 1e-4)):
        vectors[:, k] = vectors[:, :k] @ rng.standard_normal(k) + part * rng.standard_normal(N)
    labels = [f"{k + 1}V" for k in range(9)]
    basis = make(vectors, labels)
    expected, numbers = one_by_one(vectors)
    assert set(basis.dropped) == {"7V"} and basis.labels[2:] == tuple(labels[k] for k in numbers)
    # a vector with an independent part of 3e-7 has nine digits
    np.testing.assert_allclose(basis.vectors[:, 2:], expected, rtol=0, atol=1e-8)
    np.testing.assert_allclose(
        inner(basis.vectors[:, 2:], basis.vectors[:, 2:]), np.eye(8), rtol=0, atol=1e-13
    )


@pytest.mark.parametrize("least", [1e-7, 1e-12])
def test_space_extended_by_nearly_dependent_vectors_is_orthonormal(least: float) -> None:
    """14 vectors, whose independent parts go down to `least`, add at most 13 to 19 of 32."""
    rng = np.random.default_rng(1)

    def orthogonal(rows: int, columns: int) -> Array:
        return np.linalg.qr(rng.standard_normal((rows, columns)))[0]

    for _ in range(10):
        axes = orthogonal(32, 32)
        mass = axes * np.geomspace(1e-6, 1.0, 32) @ axes.T
        roots = axes / np.sqrt(np.geomspace(1e-6, 1.0, 32))  # roots^T M roots = I
        space = roots @ orthogonal(32, 19)
        vectors = roots @ orthogonal(32, 14) * np.geomspace(1.0, least, 14) @ orthogonal(14, 14)
        extended = extended_space(lambda a, b, m=mass: a.T @ m @ b, space, vectors)
        assert 19 + 6 < extended.shape[1] <= 32
        gram = extended.T @ mass @ extended
        np.testing.assert_allclose(gram, np.eye(len(gram)), rtol=0, atol=1e-10)

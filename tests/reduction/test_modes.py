"""Component modes against dense linear algebra, and known frequencies of the paper's beam."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import scipy.linalg
from numpy.typing import NDArray
from scipy.sparse import csr_array
from support import STOCKY, beam_scene, dense, free_unknowns, make_solid, refusal

pytest.importorskip("dolfinx")

from fenicsrom.errors import ErrorKind
from fenicsrom.reduction.modes import (
    PAIR_TOLERANCE,
    align_modes,
    component_modes,
    contact_frequencies,
)
from fenicsrom.scene import Basis

Array = NDArray[np.float64]

METHODS = ["rubin", "craig-bampton"]


@pytest.fixture(scope="module")
def stocky() -> Any:
    """A short beam with 48 free unknowns, contact at a node."""
    return make_solid(beam_scene(2, STOCKY))


@pytest.fixture(scope="module", params=["plane", "bent", "two contacts"])
def body(request: pytest.FixtureRequest) -> Any:
    """Bodies small enough for dense matrices: contact at a node, about a deformed equilibrium, at
    two points."""
    if request.param == "plane":
        return request.getfixturevalue("stocky")
    if request.param == "bent":
        return request.getfixturevalue("bent3d")
    point = {"preload": 1.0, "friction": 0.5, "normal_stiffness": 1.0, "tangential_stiffness": 1.0}
    both = [
        point | {"group": "tip", "normal": [1.0, 0.0]},
        point | {"node": [0.5, 0.1], "normal": [0.0, 1.0]},
    ]
    return make_solid(beam_scene(2, STOCKY, contacts=both))


def matrices(solid: Any) -> tuple[NDArray[np.int64], Array, Array, Array]:
    """The free unknowns, and K, M and B of these unknowns."""
    keep = free_unknowns(solid)
    return (
        keep,
        dense(solid.stiffness, keep),
        dense(solid.mass, keep),
        solid.contact_rows.T.toarray()[keep],
    )


def test_frequencies_of_stuck_contacts_are_those_of_a_body_on_springs(body: Any) -> None:
    _, k, m, b = matrices(body)
    springs = np.geomspace(1e5, 1e9, b.shape[1])
    springs[-1] = 0.0
    found = contact_frequencies(body, springs, 4)
    for hertz, stiffness in zip(found.T, (k, k + b @ np.diag(springs) @ b.T), strict=True):
        squares = scipy.linalg.eigh(stiffness, m, eigvals_only=True, subset_by_index=[0, 3])
        np.testing.assert_allclose((2.0 * np.pi * hertz) ** 2, squares, rtol=1e-7)


@pytest.mark.parametrize("method", METHODS)
def test_normal_modes_match_dense_eigenvectors(body: Any, method: str) -> None:
    keep, k, m, b = matrices(body)
    found = component_modes(body, Basis(method=method, modes=5))
    z = scipy.linalg.null_space(b.T) if method == "craig-bampton" else np.eye(keep.size)
    squares, vectors = scipy.linalg.eigh(z.T @ k @ z, z.T @ m @ z)
    np.testing.assert_allclose(found.omega**2, squares[:5], rtol=1e-8)
    # each lies in the span of the dense modes of its frequency, or of its pair
    for column, square in zip(found.normal[keep].T, squares, strict=False):
        same = z @ vectors[:, np.abs(squares / square - 1) < 2 * PAIR_TOLERANCE]
        assert np.linalg.norm(same.T @ m @ column) == pytest.approx(1.0, abs=1e-8)
    if method == "craig-bampton":
        assert np.abs(b.T @ found.normal[keep]).max() < 1e-9 * np.abs(found.normal).max()
    assert found.labels[:5] == ("1V", "2V", "3V", "4V", "5V")
    assert found.labels[5:] == tuple(f"{n + 1}S" for n in range(b.shape[1]))
    np.testing.assert_array_equal(
        found.vectors, np.concatenate([found.normal, found.static], axis=1)
    )
    np.testing.assert_allclose(found.frequencies_hz, np.sqrt(squares[:5]) / (2 * np.pi), rtol=1e-8)


@pytest.mark.parametrize("method", METHODS)
def test_normal_modes_are_orthogonal(beam3d: Any, method: str) -> None:
    found = component_modes(beam3d, Basis(method=method, modes=6))
    np.testing.assert_allclose(beam3d.mass_inner(found.normal, found.normal), np.eye(6), atol=1e-9)
    stiffness = beam3d.inner(found.normal, beam3d.stiffness_times(found.normal))
    scale = np.outer(found.omega, found.omega)
    np.testing.assert_allclose(stiffness / scale, np.eye(6), atol=1e-5)


def test_first_frequency_matches_the_paper(beam2d: Any, beam3d: Any) -> None:
    """Reference: first frequency of the paper's beam, plane solid and solid | recomputed, same
    meshes | 3.2800, 3.2867 Hz | 3.28002, 3.28669 Hz | 0.02 %
    """
    assert component_modes(beam2d, Basis(method="rubin", modes=1)).frequencies_hz[
        0
    ] == pytest.approx(3.2800, rel=2e-4)
    assert component_modes(beam3d, Basis(method="rubin", modes=1)).frequencies_hz[
        0
    ] == pytest.approx(3.2867, rel=2e-4)


def test_constraint_modes_of_node_are_unit_displacements(stocky: Any) -> None:
    keep, k, _, b = matrices(stocky)
    found = component_modes(stocky, Basis(method="craig-bampton", modes=1)).static[keep]
    masters = np.argmax(b, axis=0)
    slaves = np.setdiff1d(np.arange(keep.size), masters)
    assert np.array_equal(b[masters], np.eye(2))
    np.testing.assert_allclose(found[masters], np.eye(2), atol=1e-10)
    expected = -np.linalg.solve(k[np.ix_(slaves, slaves)], k[np.ix_(slaves, masters)])
    np.testing.assert_allclose(found[slaves], expected, rtol=0, atol=1e-9 * np.abs(expected).max())


def test_constraint_modes_are_loaded_at_contact_only(body: Any) -> None:
    keep, k, _, b = matrices(body)
    found = component_modes(body, Basis(method="craig-bampton", modes=0)).static[keep]
    np.testing.assert_allclose(b.T @ found, np.eye(b.shape[1]), atol=1e-8)
    forces = k @ found
    beside = forces - b @ np.linalg.lstsq(b, forces, rcond=None)[0]
    assert np.abs(beside).max() < 1e-9 * np.abs(k).max() * np.abs(found).max()


@pytest.mark.parametrize("count", [0, 4])
def test_residual_flexibility_is_sum_over_omitted_modes(body: Any, count: int) -> None:
    keep, k, m, b = matrices(body)
    squares, vectors = scipy.linalg.eigh(k, m)
    # whole pairs only: what is left out is then unique
    count += int(
        0 < count < squares.size and squares[count] / squares[count - 1] - 1 < 2 * PAIR_TOLERANCE
    )
    left = vectors[:, count:]
    expected = left @ ((left.T @ b) / squares[count:, None])
    found = component_modes(body, Basis(method="rubin", modes=count))
    all_of_it = np.abs(vectors @ ((vectors.T @ b) / squares[:, None])).max()
    np.testing.assert_allclose(found.static[keep], expected, rtol=0, atol=1e-8 * all_of_it)
    # and from G the masters are those of Craig-Bampton
    np.testing.assert_allclose(
        found.masters,
        component_modes(body, Basis(method="craig-bampton", modes=0)).static,
        atol=1e-7,
    )


@pytest.mark.parametrize(("cells", "angle"), [("structured", 90.0), ("simplex", 30.0)])
def test_mode_pairs_of_square_section_align_with_load(cells: str, angle: float) -> None:
    across = [0.0, float(np.sin(np.radians(angle))), float(np.cos(np.radians(angle)))]
    load = {"group": "load", "direction": across, "force": 1.0, "frequency": 3.2}
    solid = make_solid(
        beam_scene(3, (f"geometry.cells='{cells}'", "contacts.0.at='mean'"), loads=[load])
    )
    for method in METHODS:
        found = component_modes(solid, Basis(method=method, modes=4))
        for pair in (0, 2):
            apart = found.omega[pair + 1] / found.omega[pair] - 1
            # tetrahedra are stiffer across one diagonal than the other
            assert apart < (1e-6 if cells == "structured" else PAIR_TOLERANCE)
            first, second = (solid.load_vectors[:, 0] @ found.normal[:, pair + n] for n in (0, 1))
            assert first > 0
            assert abs(second) < 1e-6 * first, (
                f"{method} {cells}: {second / first:.1e} at {apart:.1e} apart"
            )


def test_mode_pair_cut_by_number_of_modes_aligns_with_load(beam3d: Any) -> None:
    one, two = (
        component_modes(beam3d, Basis(method="rubin", modes=count)).normal for count in (1, 2)
    )
    assert one.shape[1] == 1
    np.testing.assert_allclose(one[:, 0], two[:, 0], atol=1e-6 * np.abs(one).max())
    twist = beam3d.load_vectors[:, 0] @ two
    assert abs(twist[1]) < 1e-6 * twist[0]


def test_close_modes_of_blades_keep_their_frequencies() -> None:
    """Three blades, all loaded: two of equal frequency, and one 0.2 % stiffer that stays alone."""
    none = np.zeros((0, 3))
    structure: Any = SimpleNamespace(
        inner=lambda a, b: a.T @ b,
        mass_inner=lambda a, b: a.T @ b,
        load_vectors=np.ones((3, 1)),
        contact_rows=csr_array(none),
        probe_rows=none,
        translations=lambda: none.T,
    )
    aligned = align_modes(structure, np.array([1.0, 1.0, 1.004]), np.eye(3))
    half = np.sqrt(0.5)
    np.testing.assert_allclose(np.abs(aligned[:, 2]), [0, 0, 1], atol=1e-15)
    np.testing.assert_allclose(aligned[:, 0], [half, half, 0], atol=1e-15)


@pytest.mark.parametrize("method", METHODS)
def test_signs_of_modes_do_positive_work_with_load(beam2d: Any, method: str) -> None:
    found = component_modes(beam2d, Basis(method=method, modes=6))
    work = beam2d.load_vectors[:, 0] @ found.normal
    moved = np.abs(work) > 1e-6 * np.abs(work).max()
    assert moved.sum() >= 4
    assert np.all(work[moved] > 0)


def test_number_of_modes_zero_is_allowed_and_too_many_is_refused(stocky: Any) -> None:
    none = component_modes(stocky, Basis(method="craig-bampton", modes=0))
    assert (
        none.normal.shape == (stocky.local, 0)
        and none.omega.size == 0
        and none.labels == ("1S", "2S")
    )
    free = free_unknowns(stocky).size
    with refusal(ErrorKind.RANGE, "basis.modes", names=f" {free},"):
        component_modes(stocky, Basis(method="rubin", modes=free + 1))
    with refusal(ErrorKind.RANGE, "basis.modes", names=f" {free - 2},"):
        component_modes(stocky, Basis(method="craig-bampton", modes=free))


def test_scene_without_contact_has_only_normal_modes() -> None:
    solid = make_solid(beam_scene(2, STOCKY, contacts=None))
    found = component_modes(solid, Basis(method="rubin", modes=2))
    assert (
        found.labels == ("1V", "2V")
        and found.static.shape[1] == 0
        and found.flexibility_condition == 1.0
    )

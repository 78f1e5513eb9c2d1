"""Equilibria of the solid with few factorisations: the same as by Newton's method in full."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy.sparse
from numpy.typing import NDArray

pytest.importorskip("dolfinx")

from petsc4py import PETSc
from support import beam_scene, dense, free_unknowns, make_solid, random_field

from fenicsrom.errors import ConvergenceError, ErrorKind
from fenicsrom.fem.base.linalg import Factorisation
from fenicsrom.fem.equilibrium import statics as prediction
from fenicsrom.fem.equilibrium import statics as statics_module
from fenicsrom.fem.equilibrium.statics import Statics
from fenicsrom.fem.solid.finer import FinerSolid
from fenicsrom.scene import read_scene

Array = NDArray[np.float64]


def newton_in_full(solid: Any, load: Array, start: Array) -> Array:
    """Newton's method on the free unknowns with a new dense tangent in each iteration."""
    keep, u = free_unknowns(solid), start.copy()
    for _ in range(40):
        change = np.linalg.solve(
            dense(solid.tangent(u), keep), (load - solid.internal_force(u))[keep]
        )
        u[keep] += change
        if np.abs(change).max() < 1e-13 * np.abs(u).max():
            return u
    raise AssertionError("Newton's method did not converge")


@pytest.fixture
def factorisations(monkeypatch: pytest.MonkeyPatch) -> list[None]:
    """A list that grows by one with each factorisation."""
    found: list[None] = []
    update = Factorisation.update

    def counted(self: Factorisation) -> None:
        found.append(None)
        update(self)

    monkeypatch.setattr(Factorisation, "update", counted)
    return found


@pytest.mark.parametrize("name", ["bent2d", "bent3d"])
def test_equilibrium_is_that_of_full_newton(name: str, request: pytest.FixtureRequest) -> None:
    solid = request.getfixturevalue(name)
    expected = newton_in_full(solid, solid.static_load, solid.equilibrium)
    scale = np.abs(expected).max()
    np.testing.assert_allclose(solid.equilibrium, expected, rtol=0, atol=1e-10 * scale)
    keep = free_unknowns(solid)
    stiffness = dense(solid.tangent(solid.equilibrium), keep)
    np.testing.assert_array_equal(dense(solid.stiffness, keep), stiffness)


def test_mixed_tangent_lacks_the_stress_of_the_square_of_the_change(bent2d: Any) -> None:
    keep = free_unknowns(bent2d)
    u, change = random_field(bent2d, 0.02, 1), random_field(bent2d, 0.01, 2)
    c, zero = change[keep], np.zeros_like(u)
    lacking = (dense(bent2d.tangent(u), keep) - dense(bent2d.tangent(u, None, change), keep)) @ c
    # the part of K(c) c that is cubic in c is three times grad c S(grad c^T grad c / 2)
    plus, minus, rest = (dense(bent2d.tangent(at), keep) for at in (change, -change, zero))
    cubic = (0.5 * (plus + minus) - rest) @ c
    np.testing.assert_allclose(lacking, cubic / 3.0, rtol=0, atol=1e-9 * np.abs(cubic).max())


def test_far_equilibrium_takes_few_factorisations(factorisations: list[None]) -> None:
    push = {"group": "tip", "direction": [0.0, 1.0], "force": 2000.0}
    solid = make_solid(beam_scene(2, loads=[push], contacts=None))
    assert np.abs(solid.equilibrium).max() > 0.5  # m, of a beam of 2.54 m
    assert len(factorisations) <= 8  # with the first one at rest and the last one


def test_finer_elements_start_at_the_equilibrium_of_the_coarser(
    factorisations: list[None], monkeypatch: pytest.MonkeyPatch
) -> None:
    push = {"group": "tip", "direction": [0.0, 1.0], "force": 2000.0}
    scene = beam_scene(2, loads=[push], contacts=None)
    solid, counts, found = make_solid(scene), [len(factorisations)], []
    for predict in (FinerSolid._predicted, lambda _: None):  # then from the undeformed body
        monkeypatch.setattr(FinerSolid, "_predicted", predict)
        found.append(FinerSolid(scene, solid).equilibrium)
        counts.append(len(factorisations))
    size = np.abs(found[1]).max()
    np.testing.assert_allclose(found[0], found[1], rtol=0, atol=1e-10 * size)
    assert counts[1] - counts[0] < counts[2] - counts[1]


@pytest.mark.slow
def test_predicted_equilibrium_at_speed_saves_factorisations(
    factorisations: list[None], monkeypatch: pytest.MonkeyPatch
) -> None:
    """The demo's fan blade, whose linear displacement at speed is four times too large."""
    demo = Path(__file__).parents[2] / "demos" / "blade_rub.toml"
    scene = read_scene(demo, ["geometry.parameters.elements_across=4"])
    plain = make_solid(scene)
    without = len(factorisations)
    predictions, predict = [], prediction.predicted_equilibrium

    def predicted(body: Any) -> Array | None:
        predictions.append(predict(body))
        return predictions[-1]

    monkeypatch.setattr(prediction, "UNKNOWNS", 0)
    monkeypatch.setattr(prediction, "predicted_equilibrium", predicted)
    found = make_solid(scene)
    size = np.abs(plain.equilibrium).max()
    np.testing.assert_allclose(predictions[0], plain.equilibrium, rtol=0, atol=0.02 * size)
    np.testing.assert_allclose(found.equilibrium, plain.equilibrium, rtol=0, atol=1e-10 * size)
    assert len(factorisations) - without == 3 < without


@pytest.mark.slow
def test_shaft_above_its_critical_speed_is_predicted_where_it_gets_as_it_spins_up(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """It has several equilibria. Newton's method from rest reaches an unstable one in one step."""
    changes = ("geometry.parameters.length=1", "geometry.parameters.elements_along=8")
    changes += ("geometry.parameters.load_at=0.5", "geometry.parameters.height=0.05")
    changes += ("geometry.parameters.width=0.1", "material.young=1e8")
    rotation = {"speed_rpm": 100.0, "axis": [1.0, 0.0, 0.0], "point": [0.0, 0.1, 0.001]}
    scene = beam_scene(3, changes, contacts=None, probe={"group": "tip"}, rotation=rotation)
    assert make_solid(scene).unstable == 1
    monkeypatch.setattr(prediction, "UNKNOWNS", 0)
    found, ramped = make_solid(scene), make_solid(scene)
    assert found.unstable == 0
    assert ramped.rotation is not None
    u, keep, goal = np.zeros(ramped.local), free_unknowns(ramped), ramped.rotation.omega_squared
    for part in np.linspace(0.0, 1.0, 41)[1:]:
        ramped.rotation.omega_squared = part * goal
        for _ in range(20):
            residual = ramped.residual(u, part * ramped.static_load)[keep]
            change = np.linalg.solve(dense(ramped.tangent(u), keep), residual)
            u[keep] -= change
            if np.abs(change).max() < 1e-11:
                break
    np.testing.assert_allclose(found.equilibrium, u, rtol=0, atol=1e-8 * np.abs(u).max())


def test_load_path_gives_the_equilibria_of_its_parts(
    bent2d: Any, factorisations: list[None]
) -> None:
    force = bent2d.load_vectors[:, 0] * 0.2 * bent2d.loads[0].size
    parts = [0.25, 0.5, 0.75, 1.0]
    before = dense(bent2d.stiffness, free_unknowns(bent2d))
    path = bent2d.load_path(force, parts, 1e-9)
    used = len(factorisations)
    for part, u in zip(parts, path.T, strict=True):
        expected = newton_in_full(bent2d, bent2d.rest_force + part * force, bent2d.equilibrium)
        np.testing.assert_allclose(u, expected, rtol=0, atol=1e-8 * np.abs(expected).max())
    assert used <= 3  # the factor at the equilibrium serves most of them
    np.testing.assert_array_equal(dense(bent2d.stiffness, free_unknowns(bent2d)), before)


@pytest.mark.parametrize(
    ("name", "plain", "counted"),
    [("LARGEST_WEIGHT", 0.0, "solve"), ("LAST_CORRECTIONS", 0, "update")],
    ids=["acceleration", "kept factor"],
)
def test_load_path_saves_work_with_the_same_equilibria(
    name: str, plain: float, counted: str, bent2d: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    force = bent2d.load_vectors[:, 1] * 0.4 * bent2d.loads[1].size
    calls, method = [0], getattr(Factorisation, counted)

    def counting(*arguments: Any) -> Any:
        calls[-1] += 1
        return method(*arguments)

    monkeypatch.setattr(Factorisation, counted, counting)
    path = bent2d.load_path(force, np.arange(1, 11) / 10.0, 1e-7)
    calls.append(0)
    monkeypatch.setattr(statics_module, name, plain)
    expected = bent2d.load_path(force, np.arange(1, 11) / 10.0, 1e-7)
    assert calls[0] < calls[1]
    np.testing.assert_allclose(path, expected, rtol=0, atol=1e-7 * np.abs(expected).max())


def test_state_that_is_no_equilibrium_is_refused(bent2d: Any) -> None:
    matrix = bent2d.stiffness.copy()
    statics = Statics(bent2d, Factorisation(matrix, "fenicsrom_test"), overwrite=True)
    statics.finish(bent2d.equilibrium, bent2d.static_load)
    with pytest.raises(ConvergenceError, match="residual") as caught:
        statics.finish(1.001 * bent2d.equilibrium, bent2d.static_load)
    assert len(caught.value.decrements) == 1 and caught.value.decrements[0] > 0.0


def test_failed_equilibrium_carries_the_decrements(
    bent2d: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(statics_module, "STATIC_ITERATIONS", 2)
    monkeypatch.setattr(statics_module, "SMALLEST_LOAD_STEP", 0.5)
    factor = Factorisation(bent2d.stiffness.copy(), "fenicsrom_test")
    statics = Statics(bent2d, factor, overwrite=True)
    rest = np.zeros_like(bent2d.equilibrium)
    with pytest.raises(ConvergenceError) as caught:
        statics.follow(rest, 0.0 * bent2d.static_load, bent2d.static_load, 0.0)
    assert len(caught.value.decrements) == 2 and min(caught.value.decrements) > 0.0


def test_too_little_memory_is_no_singular_matrix() -> None:
    """MUMPS may take 1 MB, or the matrix has a row of zeros."""
    side = scipy.sparse.diags_array([[2.0] * 12, [-1.0] * 11, [-1.0] * 11], offsets=[0, 1, -1])
    one = scipy.sparse.eye_array(12)
    plane = scipy.sparse.kron(side, one) + scipy.sparse.kron(one, side)
    space = scipy.sparse.kron(plane, one) + scipy.sparse.kron(scipy.sparse.kron(one, one), side)
    zero = scipy.sparse.diags_array(np.arange(space.shape[0], dtype=np.float64))
    options = PETSc.Options()
    for matrix, limited, kind in (
        (space, True, ErrorKind.MEMORY),
        (zero, False, ErrorKind.CONVERGENCE),
    ):
        rows = scipy.sparse.csr_array(matrix)
        csr = (rows.indptr, rows.indices, rows.data)
        held = PETSc.Mat().createAIJ(rows.shape, csr=csr, comm=PETSc.COMM_SELF)
        if limited:
            options["fenicsrom_test_mat_mumps_icntl_23"] = 1
        try:
            with pytest.raises(ConvergenceError) as caught:
                Factorisation(held, "fenicsrom_test")
        finally:
            options.delValue("fenicsrom_test_mat_mumps_icntl_23")
        assert caught.value.kind is kind


@pytest.mark.parametrize("stiffness", [1e-20, 1e20])
def test_soft_and_stiff_matrices_have_factors(stiffness: float) -> None:
    side = scipy.sparse.diags_array([[2.0] * 12, [-1.0] * 11, [-1.0] * 11], offsets=[0, 1, -1])
    rows = scipy.sparse.csr_array(stiffness * side)
    csr = (rows.indptr, rows.indices, rows.data)
    factor = Factorisation(
        PETSc.Mat().createAIJ(rows.shape, csr=csr, comm=PETSc.COMM_SELF), "fenicsrom_test"
    )
    load = np.arange(1.0, 13.0)
    expected = np.linalg.solve(side.toarray(), load)
    assert stiffness * factor.solve(load[:, None])[:, 0] == pytest.approx(expected, rel=1e-12)
    assert factor.negative_eigenvalues() == 0
    factor.destroy(matrix=True)

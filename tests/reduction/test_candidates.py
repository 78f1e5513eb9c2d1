"""The vectors that a basis leaves out and that an error estimate may add to it."""

from __future__ import annotations

from contextlib import nullcontext
from dataclasses import replace

import numpy as np
import pytest
from support import beam_scene

from fenicsrom.arrays import Array
from fenicsrom.reduction.basis import ReducedBasis
from fenicsrom.reduction.beam import BeamStructure, beam_structure
from fenicsrom.reduction.candidates import extended_basis, missing_derivatives
from fenicsrom.reduction.modes import component_modes
from fenicsrom.reduction.stages import Reduction
from fenicsrom.scene import Basis, Scene

SECTION = {"length": 1.0, "height": 0.05, "width": 0.0254, "elements": 10, "load_at": 0.5}
SLENDER = {"length": 2.54, "height": 0.0254, "width": 0.0254, "elements": 20, "load_at": 0.7}


def extended(scene: Scene) -> tuple[BeamStructure, Reduction, ReducedBasis]:
    """The beam of a scene, its reduction, and the basis with its candidates."""
    beam = beam_structure(scene)
    found = Reduction(beam, scene, lambda stage: nullcontext())
    return beam, found, extended_basis(beam, scene.basis, found)


def reduced(method: str, derivatives: object = "none") -> tuple[BeamStructure, Reduction, Array]:
    """A beam, its reduction with one mode, and the basis with its candidates."""
    scene = beam_scene(2, reference={"beam": True, "beam_section": SECTION})
    basis = replace(scene.basis, method=method, modes=1, derivatives=derivatives)
    beam, found, more = extended(replace(scene, basis=basis))
    return beam, found, more.vectors


@pytest.mark.parametrize("method", ["rubin", "craig-bampton"])
def test_candidates_extend_the_basis_and_rest_at_the_contact(method: str) -> None:
    beam, found, vectors = reduced(method)
    n, m = found.basis.size, found.basis.masters
    np.testing.assert_allclose(vectors[:, :n], found.basis.vectors, atol=1e-9)
    assert np.abs(beam.contact_rows @ vectors[:, n:]).max() < 1e-9 * np.abs(vectors).max()
    gram = beam.mass_inner(vectors[:, m:], vectors[:, m:])
    np.testing.assert_allclose(gram, np.eye(gram.shape[0]), atol=1e-8)


@pytest.mark.parametrize("method", ["rubin", "craig-bampton"])
def test_candidates_hold_next_modes_load_and_missing_derivatives(method: str) -> None:
    beam, found, basis = reduced(method)
    more = component_modes(beam, Basis(method=method, modes=4))
    held = [more.normal[:, 1:], beam.factor.solve(beam.load_vectors)]
    for vectors in held:
        rest = vectors - basis @ np.linalg.lstsq(basis, vectors, rcond=None)[0]
        assert np.linalg.norm(rest) < 1e-7 * np.linalg.norm(vectors)
    labels = missing_derivatives(found.modes, more, found.selection, found.derivatives)
    assert {"1V1V", "1V1S", "1V2V", "2V2V"} <= set(labels) and len(set(labels)) == len(labels)


@pytest.mark.parametrize("method", ["rubin", "craig-bampton"])
def test_candidates_hold_deflections_under_inertia_of_contact_deflections(method: str) -> None:
    """Along the axis, too, where none of the next modes moves."""
    beam, found, basis = reduced(method)
    held = found.modes.inverse.solve(beam.mass_times(found.modes.masters))
    rest = held - basis @ np.linalg.lstsq(basis, held, rcond=None)[0]
    assert np.all(np.linalg.norm(rest, axis=0) < 1e-6 * np.linalg.norm(held, axis=0))


@pytest.mark.parametrize("elements", [5, 7])
def test_combinations_of_derivatives_are_independent(elements: int) -> None:
    """The derivatives of bending modes are axial: at most as many as elements are independent.

    Other candidates of a coarse mesh may move along the axis, too; together they hold all of it.
    """
    scene = beam_scene(
        2,
        contacts=None,
        probe={"group": "tip"},
        reference={"beam": True, "beam_section": SLENDER | {"elements": elements, "load_at": 1.0}},
    )
    basis = replace(scene.basis, modes=1, derivatives="none")
    beam, _, more = extended(replace(scene, basis=basis))
    assert sum(label.endswith("D") for label in more.labels) in (elements - 1, elements)
    axial = np.eye(beam.local)[:, ::3]
    rest = axial - more.vectors @ np.linalg.lstsq(more.vectors, axial, rcond=None)[0]
    assert np.linalg.norm(rest) < 1e-6


@pytest.mark.parametrize("nonlinear", [True, False])
def test_candidates_hold_derivatives_only_of_nonlinear_structure(nonlinear: bool) -> None:
    scene = beam_scene(
        2,
        (f"geometrically_nonlinear={str(nonlinear).lower()}",),
        reference={"beam": True, "beam_section": SECTION},
    )
    basis = replace(scene.basis, modes=1, derivatives="none")
    _, _, more = extended(replace(scene, basis=basis))
    assert any(label.endswith("D") for label in more.labels) is nonlinear


def test_candidates_hold_all_modes_of_coarse_mesh() -> None:
    """Two elements have six free unknowns; with the contact held, four are left."""
    scene = beam_scene(2, reference={"beam": True, "beam_section": SECTION | {"elements": 2}})
    basis = replace(scene.basis, method="craig-bampton", modes=2, derivatives="none")
    beam, _, more = extended(replace(scene, basis=basis))
    assert beam.free == 6 and more.masters == 2
    assert {"1V", "2V", "3V", "4V"} <= set(more.labels)


def test_kept_derivatives_are_not_missing() -> None:
    _, found, _ = reduced("rubin", ("1V1V",))
    labels = missing_derivatives(found.modes, found.modes, found.selection, found.derivatives)
    assert "1V1V" not in labels and "1V1S" in labels


@pytest.mark.parametrize(
    ("part", "before", "direction"), [(0.2, 0, [1, 0]), (0.4, 0, [0.3, 1]), (0.4, 9, [0.3, 1])]
)
def test_candidates_judge_an_axial_motion(part: float, before: int, direction: list[float]) -> None:
    """Below the first axial frequency; the next modes bend, and so do the loads before the last."""
    load = {"group": "load", "at": "centre", "force": 1.0, "frequency": 3.2}
    scene = beam_scene(
        2,
        ("geometrically_nonlinear=false",),
        loads=[load | {"direction": [0, 1]}] * before + [load | {"direction": direction}],
        contacts=None,
        probe={"group": "tip"},
        reference={"beam": True, "beam_section": SLENDER},
    )
    scene = replace(scene, basis=replace(scene.basis, modes=2))
    beam, found, more = extended(scene)
    pushed, axial = beam.load_vectors[:, before], beam.probe_rows[0]
    # the first axial frequency is pi c / 2 L
    square = (part * 0.5 * np.pi / 2.54) ** 2 * 207e9 / 7801.0

    def response(r: Array) -> float:
        stiffness = r.T @ (beam.stiffness - square * beam.mass) @ r
        return float(axial @ r @ np.linalg.solve(stiffness, r.T @ pushed))

    exact = response(np.eye(beam.local))
    error, left = (abs(response(r) / exact - 1.0) for r in (found.basis.vectors, more.vectors))
    assert error > 0.003 and left < 0.1 * error

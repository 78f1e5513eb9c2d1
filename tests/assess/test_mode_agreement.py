"""Modes of reduced models beside those of the full model, on the 1D beam."""

from __future__ import annotations

from contextlib import nullcontext
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from support import beam_scene

from fenicsrom.assess.errors.comparisons import MOST_COMPARED, mode_agreement
from fenicsrom.reduction.beam import BeamStructure, beam_structure
from fenicsrom.reduction.modes import component_modes
from fenicsrom.reduction.stages import Reduction
from fenicsrom.scene import Basis, Scene


def beam_in_contact(**basis: Any) -> Scene:
    section = {"length": 1.0, "height": 0.05, "width": 0.0254, "elements": 10, "load_at": 0.5}
    scene = beam_scene(2, reference={"beam": True, "beam_section": section})
    return replace(scene, basis=replace(scene.basis, elastic_force="projection", **basis))


@pytest.fixture(scope="module")
def beam() -> BeamStructure:
    return beam_structure(beam_in_contact())


def test_full_basis_gives_the_identity(beam: BeamStructure) -> None:
    found = mode_agreement(beam, np.eye(beam.local))
    assert found.mac.shape == (MOST_COMPARED, beam.local)
    np.testing.assert_allclose(found.mac, np.eye(*found.mac.shape), atol=1e-6)
    np.testing.assert_allclose(found.reduced_hz[:MOST_COMPARED], found.full_hz, rtol=1e-6)


def test_mixed_modes_give_known_values(beam: BeamStructure) -> None:
    """A basis of φ₁ and φ₂ cos a + φ₃ sin a: cos² a and sin² a, and ω² between ω₂² and ω₃².

    The scale of a vector does not matter.
    """
    modes = component_modes(beam, Basis(modes=3))
    one, two, three = modes.normal.T
    cosine, sine = 0.8, 0.6
    mixed = np.column_stack([5.0 * (cosine * two + sine * three), one])
    found = mode_agreement(beam, mixed)
    np.testing.assert_allclose(found.mac, np.eye(2) * [1.0, cosine**2], atol=1e-7)
    np.testing.assert_allclose(found.represented, [1.0, cosine**2], atol=1e-7)
    squares = modes.frequencies_hz**2
    mean = np.sqrt(cosine**2 * squares[1] + sine**2 * squares[2])
    np.testing.assert_allclose(found.reduced_hz, [modes.frequencies_hz[0], mean], rtol=1e-7)
    third = mode_agreement(beam, np.column_stack([mixed, 1e-3 * one + two]))
    assert third.represented == pytest.approx(1.0) and third.partners == [0, 1, 2]


@pytest.mark.parametrize("method", ["rubin", "craig-bampton"])
def test_frequencies_of_a_basis_are_upper_bounds(method: str) -> None:
    """Rayleigh and Ritz; a Rubin basis has its normal modes, which are free at the contact."""
    scene = beam_in_contact(method=method, modes=2, derivatives="none")
    structure = beam_structure(scene)
    basis = Reduction(structure, scene, lambda stage: nullcontext()).basis
    found = mode_agreement(structure, basis.vectors)
    assert np.all(found.reduced_hz[: len(found.full_hz)] >= found.full_hz * (1.0 - 1e-7))
    own = np.diag(found.mac)[:2]
    assert np.all(own > (1.0 - 1e-9 if method == "rubin" else 0.99))
    assert np.all(found.represented <= 1.0 + 1e-9)

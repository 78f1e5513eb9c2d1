"""Modal derivatives along the principal directions of a motion."""

from __future__ import annotations

from contextlib import nullcontext
from dataclasses import replace

import numpy as np
import pytest
from support import beam_scene

from fenicsrom.reduction.beam import BeamStructure, beam_structure
from fenicsrom.reduction.derivatives import (
    REST,
    PrincipalDirections,
    all_pairs,
    combinations,
    enough,
    principal_directions,
)
from fenicsrom.reduction.snapshots import MODE_PHASES, linear_model, mode_snapshots
from fenicsrom.reduction.stages import Reduction, derivatives_along

SECTION = {"length": 1.0, "height": 0.05, "width": 0.0254, "elements": 10, "load_at": 0.5}


def reduction(*overrides: str) -> tuple[BeamStructure, Reduction]:
    """A beam, and the stages of its reduced model."""
    scene = beam_scene(2, overrides, reference={"beam": True, "beam_section": SECTION})
    beam = beam_structure(scene)
    return beam, Reduction(beam, scene, lambda stage: nullcontext())


def snapshots(beam: BeamStructure, found: Reduction) -> tuple[np.ndarray, PrincipalDirections]:
    """Snapshots (n, s) of three directions with falling sizes, and their principal directions."""
    vectors = found.modes.vectors
    rng = np.random.default_rng(1)
    stiffness = beam.inner(vectors, beam.stiffness_times(vectors))
    sizes = np.array([1.0, 0.1, 0.3 * REST]) / np.sqrt(np.diag(stiffness)[:3])
    coordinates = np.zeros((vectors.shape[1], 60))
    coordinates[:3] = sizes[:, None] * rng.standard_normal((3, 60))
    return vectors @ coordinates, principal_directions(beam, vectors, coordinates)


def test_principal_directions_hold_the_motion_but_for_its_rest() -> None:
    beam, found = reduction()
    u, principal = snapshots(beam, found)
    p, a = principal.vectors, principal.amplitudes
    np.testing.assert_allclose(p.T @ beam.stiffness @ p, np.eye(p.shape[1]), atol=1e-7)
    energy = np.mean(np.einsum("is,ij,js->s", u, beam.stiffness, u))
    assert principal.energy == pytest.approx(energy, rel=1e-8)
    rest = u - p @ a
    left = np.mean(np.einsum("is,ij,js->s", rest, beam.stiffness, rest))
    assert p.shape[1] == 2 and 0.0 < left <= REST**2 * energy
    assert np.all(np.diff(np.linalg.norm(a, axis=1)) < 0.0)
    np.testing.assert_allclose(a @ a.T, np.diag(np.diag(a @ a.T)), atol=1e-9 * np.sum(a**2))


def test_derivatives_along_directions_combine_those_of_pairs_of_modes() -> None:
    """θ(x, y) is bilinear: the derivative along two sums of modes is a sum over all pairs."""
    beam, found = reduction()
    modes = found.modes
    principal = snapshots(beam, found)[1]
    inside = np.linalg.lstsq(modes.vectors, principal.vectors, rcond=None)[0]
    labels = tuple(all_pairs(modes.labels))
    pairs = derivatives_along(beam, found._scene.basis, modes, labels)
    along = derivatives_along(beam, found._scene.basis, modes, ("1P2P",), principal)[:, 0]
    index = {label: k for k, label in enumerate(modes.labels)}
    wanted = np.zeros_like(along)
    for label, vector in zip(labels, pairs.T, strict=True):
        i, j = index[label[:2]], index[label[2:]]
        factor = inside[i, 0] * inside[j, 1]
        wanted += (factor if i == j else factor + inside[j, 0] * inside[i, 1]) * vector
    np.testing.assert_allclose(along, wanted, atol=1e-6 * np.abs(wanted).max())


@pytest.mark.parametrize(("force", "some"), [(1000.0, True), (1e-3, False)])
def test_basis_has_derivatives_only_of_a_large_motion(force: float, some: bool) -> None:
    _, found = reduction(f"loads.0.force={force}", "contacts.0.friction=0.0")
    assert bool(found.derivatives.labels) is some
    assert set(found.derivatives.labels) <= set(found.basis.labels)
    assert all(size > 0.0 for size in found.derivatives.sizes.values())


def test_derivatives_of_the_basis_leave_little_of_their_energy() -> None:
    """The sum of the energies that stay out is at most REST² of the energy of the motion."""
    beam, found = reduction("loads.0.force=1000.0")
    principal, modes = found.selection.principal, found.modes
    assert principal is not None
    weights = principal.weights()
    vectors = derivatives_along(beam, found._scene.basis, modes, tuple(weights), principal)
    left, energies = combinations(beam, modes, found.basis, vectors * list(weights.values()))
    assert np.sum(energies) <= 1.01 * REST**2 * principal.energy
    np.testing.assert_allclose(np.diag(left.T @ beam.stiffness @ left), energies, rtol=1e-6)


def test_enough_counts_the_largest_energies() -> None:
    energies = np.array([4.0, 2.0, 1.0, 0.5])
    assert [enough(energies, rest) for rest in (8.0, 3.6, 1.5, 0.4, 0.0)] == [0, 1, 2, 4, 4]
    assert enough(np.zeros(0), 0.0) == 0


def test_threshold_of_the_pairs_does_not_matter_along_directions() -> None:
    beam, found = reduction("loads.0.force=1000.0")
    assert found.selection.weights == {} and found.selection.derivatives == ()
    plain = replace(found._scene.basis, differentiation="central-difference")
    other = Reduction(beam, replace(found._scene, basis=plain), lambda stage: nullcontext())
    np.testing.assert_allclose(
        list(other.derivatives.sizes.values())[:1], list(found.derivatives.sizes.values())[:1]
    )


def test_backbone_adds_the_mode_at_its_largest_amplitude() -> None:
    """The loads are small; the amplitudes of the mode ask for derivatives."""
    quiet = ("loads.0.force=1e-3", "contacts.0.friction=0.0")
    _, without = reduction(*quiet)
    beam, found = reduction(*quiet, "backbone.first=1e-4", "backbone.last=0.05")
    assert not without.derivatives.labels and found.derivatives.labels
    linear = linear_model(beam, found.modes)
    coordinates = mode_snapshots(found._scene, linear.model)
    assert coordinates.shape == (linear.model.size, 2 * MODE_PHASES)
    for part in np.split(coordinates, 2, axis=1):  # sticking, open
        moved = linear.model.probe @ part
        assert np.abs(moved).max() == pytest.approx(0.05, rel=1e-9)

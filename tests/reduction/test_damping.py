"""Viscous damping: stiffness-proportional and modal, the same in all models of a structure."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import scipy.linalg
from support import beam_scene, enriched, fixed_steps, no_contacts, refusal

from fenicsrom.arrays import Array
from fenicsrom.errors import ErrorKind
from fenicsrom.online.model.matrices import model_arrays
from fenicsrom.online.model.model import Problem, reduced_model
from fenicsrom.online.model.polynomial import ElasticPolynomial
from fenicsrom.online.motion.motion import Motion
from fenicsrom.online.run.march import integrate
from fenicsrom.online.run.simulate import simulate
from fenicsrom.reduction.basis import (
    ReducedBasis,
    project_intrusively,
    projected_terms,
    projected_velocity_matrix,
)
from fenicsrom.reduction.beam import BeamStructure, beam_structure
from fenicsrom.scene import Scene

SECTION = {"length": 1.0, "height": 0.05, "width": 0.0254, "elements": 10, "load_at": 0.5}


def damped_scene(damping: dict[str, Any], *overrides: str, **tables: Any) -> Scene:
    """A beam without mass-proportional damping."""
    reference = {"beam": True, "beam_section": SECTION}
    changes = ("material.mass_damping=0", *overrides)
    return beam_scene(2, changes, reference=reference, damping=damping, **tables)


def basis_of(beam: BeamStructure, method: str, modes: int) -> ReducedBasis:
    """Component modes without derivatives."""
    return enriched(beam, method, modes, wanted=())[2]


def damping_ratios(mass: Array, velocity: Array, stiffness: Array) -> tuple[Array, Array]:
    """Frequencies in rad/s and damping ratios of a linear model, the lowest frequency first."""
    n = len(mass)
    inverse = np.linalg.inv(mass)
    lower = np.concatenate([-inverse @ stiffness, -inverse @ velocity], axis=1)
    values = np.linalg.eigvals(np.block([[np.zeros((n, n)), np.eye(n)], [lower]]))
    values = values[values.imag > 0.0]
    values = values[np.argsort(np.abs(values))]
    return np.abs(values), -values.real / np.abs(values)


def reduced_ratios(beam: BeamStructure, method: str, modes: int) -> tuple[Array, Array]:
    """`damping_ratios` of a reduced model of the beam."""
    r = basis_of(beam, method, modes).vectors
    mass, stiffness = beam.mass_inner(r, r), beam.inner(r, beam.stiffness_times(r))
    return damping_ratios(mass, projected_velocity_matrix(beam, r), stiffness)


def test_modal_ratios_are_those_of_the_first_modes() -> None:
    beam = beam_structure(damped_scene({"ratios": [0.02, 0.0, 0.01]}))
    _, ratios = reduced_ratios(beam, "rubin", 4)
    np.testing.assert_allclose(ratios[:4], [0.02, 0.0, 0.01, 0.0], rtol=1e-6, atol=1e-9)


def test_single_ratio_is_that_of_the_given_number_of_modes() -> None:
    beam = beam_structure(damped_scene({"ratios": 0.03, "modes": 2}))
    _, ratios = reduced_ratios(beam, "rubin", 3)
    np.testing.assert_allclose(ratios[:3], [0.03, 0.03, 0.0], rtol=1e-6, atol=1e-9)


def test_stiffness_damping_grows_with_frequency() -> None:
    beam = beam_structure(damped_scene({"stiffness": 1e-5}))
    omega, ratios = reduced_ratios(beam, "rubin", 3)
    np.testing.assert_allclose(ratios[:3], 0.5e-5 * omega[:3], rtol=1e-6)


def test_craig_bampton_basis_has_the_damping_of_the_body() -> None:
    """The damped modes are those of the body without contact, not those of the basis."""
    beam = beam_structure(damped_scene({"ratios": [0.02, 0.01]}))
    _, ratios = reduced_ratios(beam, "craig-bampton", 8)
    np.testing.assert_allclose(ratios[:2], [0.02, 0.01], rtol=1e-4)


def test_damping_matrix_of_all_unknowns_is_that_of_its_definition() -> None:
    beam = beam_structure(damped_scene({"stiffness": 2e-5, "ratios": [0.02, 0.01]}))
    squares, modes = scipy.linalg.eigh(beam.stiffness, beam.mass)
    expected = 2e-5 * beam.stiffness
    for k, ratio in enumerate([0.02, 0.01]):
        image = beam.mass @ modes[:, k]
        expected += 2.0 * ratio * np.sqrt(squares[k]) * np.outer(image, image)
    assert beam.viscous.acts
    found = beam.viscous.times(np.eye(beam.size))
    np.testing.assert_allclose(found, expected, atol=1e-9 * np.abs(expected).max())


def test_undamped_structure_has_no_velocity_matrix() -> None:
    beam = beam_structure(damped_scene({"ratios": [0.0]}))
    assert not beam.viscous.acts
    assert projected_velocity_matrix(beam, np.eye(beam.size)).shape == (0, 0)


def test_more_ratios_than_modes_are_refused() -> None:
    with refusal(ErrorKind.RANGE, "damping.ratios"):
        beam_structure(damped_scene({"ratios": 0.01, "modes": 100}))


def free_decay(scheme: str, damping: dict[str, Any], steps: int) -> tuple[Motion, float]:
    """The free linear motion of the full beam from its first mode, and its frequency in rad/s."""
    beam = beam_structure(damped_scene(damping, "geometrically_nonlinear=false", contacts=None))
    squares, modes = beam.eigenmodes(beam.factor, 1)
    omega = float(np.sqrt(squares[0]))
    model = beam.full_model()
    model.loads = 0.0 * model.loads
    shape = 0.01 * modes[:, 0] / np.abs(modes[:, 0]).max()
    motion = integrate(
        Problem(model, no_contacts(), fixed_steps(scheme, steps, 10 * 2.0 * np.pi / omega), None),
        start=(shape, np.zeros(beam.size), np.zeros((0, 2))),
    )
    return motion, omega


@pytest.mark.slow
@pytest.mark.parametrize("scheme", ["discrete-gradient", "average-acceleration"])
def test_free_motion_decays_with_the_damping_ratio(scheme: str) -> None:
    """Reference: decay of a free motion with a damping ratio | exp(−2ζωt) | closed form | agrees |
    0.2 %
    """
    motion, omega = free_decay(scheme, {"ratios": [0.01]}, 1000)
    energy = motion.kinetic + motion.elastic
    assert energy[-1] / energy[0] == pytest.approx(
        np.exp(-0.02 * omega * motion.time[-1]), rel=2e-3
    )


def test_energy_balances_with_all_kinds_of_damping() -> None:
    motion, _ = free_decay("discrete-gradient", {"stiffness": 1e-4, "ratios": [0.02, 0.01]}, 400)
    assert motion.relative_imbalance < 1e-12
    assert motion.damping_dissipation[-1] > 0.5 * (motion.kinetic + motion.elastic)[0]
    assert np.all(np.diff(motion.damping_dissipation) >= 0.0)


def test_compiled_model_gives_motion_of_the_plain_one() -> None:
    """The projected plain model and the compiled polynomial one of a linear beam."""
    scene = damped_scene(
        {"stiffness": 1e-4, "ratios": [0.02]},
        "geometrically_nonlinear=false",
        "time.periods=3",
        "time.steady='march'",
        "time.steps_per_period=100",
    )
    beam = beam_structure(scene)
    basis = basis_of(beam, "rubin", 3)
    r = basis.vectors
    elastic = ElasticPolynomial(
        np.zeros(basis.size),
        beam.inner(r, beam.stiffness_times(r)),
        np.zeros((0, 0)),
        np.zeros((0, 0)),
    )
    compiled = reduced_model(elastic=elastic, **projected_terms(beam, r))
    motion = simulate(compiled, scene)
    plain = simulate(project_intrusively(beam, basis), scene)
    assert motion.relative_imbalance < 1e-12
    np.testing.assert_allclose(motion.displacement, plain.displacement, atol=1e-12)
    arrays = model_arrays(compiled)
    assert np.linalg.eigvalsh(arrays.damping).min() > 0.0 and not arrays.gyroscopic.any()

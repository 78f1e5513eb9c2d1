"""Errors near a resonance: shift and peak against closed forms of oscillators, and a finer beam."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from support import beam_scene, first, linear_model

from fenicsrom.assess.errors import estimates, verdicts
from fenicsrom.assess.errors.resonance import same_phase
from fenicsrom.errors import AccuracyError, ErrorKind
from fenicsrom.online.model.model import Problem, ReducedModel, reduced_model
from fenicsrom.online.model.polynomial import ElasticPolynomial
from fenicsrom.online.motion.measures import amplitude
from fenicsrom.online.motion.motion import Motion
from fenicsrom.online.run.march import end_of
from fenicsrom.online.run.simulate import load_histories, simulate
from fenicsrom.online.store.archive import StoredModel
from fenicsrom.scene import Scene

RATIO = 0.002
"""Damping ratio of the oscillators, whose frequency is about 1 Hz."""

OMEGA = 2.0 * np.pi


def shaken(frequency: float, steps: int = 200, force: float = 1.0, *more: str) -> Scene:
    """A load of a frequency near 1 Hz."""
    changes = (
        f"loads.0.frequency={frequency}",
        f"loads.0.force={force}",
        f"material.mass_damping={2.0 * RATIO * OMEGA}",
        *more,
    )
    scene = beam_scene(
        2, changes, contacts=None, probe={"group": "tip"}, geometrically_nonlinear=False
    )
    return replace(scene, time=scene.time.changed(steps_per_period=steps, periods=200))


def of_frequency(factor: float, scene: Scene, cubic: float = 0.0) -> ReducedModel:
    """q'' + 2 ratio omega q' + (factor omega)^2 (q + cubic q^3) = load."""
    square = (factor * OMEGA) ** 2
    damping, histories = float(scene.material.mass_damping), load_histories(scene)
    if not cubic:
        loads = dict(loads=[[1.0]], load_histories=histories)
        return linear_model(1.0, square, damping=damping, **loads)
    elastic = ElasticPolynomial(
        np.zeros(1),
        np.full((1, 1), square),
        np.zeros((1, 1)),
        np.full((1, 1), 3.0 * cubic * square),
    )
    parts: tuple[Any, ...] = (*first(0, 1), np.eye(2, 1), np.zeros(2))
    return reduced_model(np.eye(1), damping, elastic, np.eye(1), histories, *parts)


def both(
    frequency: float, factor: float, cubic: float = 0.0, force: float = 1.0
) -> tuple[Scene, Motion, ReducedModel, float, Motion]:
    """The motion of the oscillator of 1 Hz, another one, and its shift and motion."""
    scene = shaken(frequency, force=force)
    motion = simulate(of_frequency(1.0, scene, cubic), scene, keep_coordinates=True)
    other = of_frequency(factor, scene, cubic)
    shift, found = same_phase(Problem.of(other, scene), scene, end_of(motion))
    return scene, motion, other, shift, found


@pytest.mark.parametrize("frequency", [1.0, 0.997, 1.02])
@pytest.mark.parametrize("error", [0.01, -0.03])
def test_motion_of_same_phase_is_that_of_the_closed_form(frequency: float, error: float) -> None:
    """An oscillator of mass 1 has the phase c w / (k - w^2) and the amplitude F sin(phase) / (c w),
    so that equal phases give w'^2 + w' (k - w^2) / w - k' = 0 and a' / a = w / w'.
    """
    _, motion, _, shift, found = both(frequency, 1.0 + error)
    angle = OMEGA / 200.0  # the steps follow the frequency
    own = 2.0 * np.tan(angle / 2.0) / angle * frequency  # as the trapezoid sees it
    half = 0.5 * (1.0 - own**2) / own
    expected = (np.hypot(half, 1.0 + error) - half) / own - 1.0
    assert shift == pytest.approx(expected, abs=2e-6)
    ratio = np.linalg.norm(amplitude(found)) / np.linalg.norm(amplitude(motion))
    assert ratio == pytest.approx(1.0 / (1.0 + shift), rel=1e-4)


def test_resonance_of_hardening_oscillator_is_followed_past_its_fold() -> None:
    """The softer one has no large motion at this frequency. On the backbone, w^2 is k (1 + 3/4 b
    a^2) and a = F / (c w), so that the shift is that of the root of k (1 + 3/4 b a^2).

    Reference: shift of the resonance of two oscillators | closed form; backbone | – | agrees |
    2e-6; 2 %
    """
    scene, motion, other, shift, found = both(1.0075, 0.99, cubic=4.0, force=0.01)
    own, theirs = float(amplitude(motion)[0]), float(amplitude(found)[0])
    hard = 0.75 * 4.0
    expected = np.sqrt(0.99**2 * (1.0 + hard * theirs**2) / (1.0 + hard * own**2)) - 1.0
    assert shift == pytest.approx(expected, rel=0.02)
    assert theirs == pytest.approx(own / (1.0 + shift), rel=0.02)
    at_frequency = estimates.mesh_errors(motion, estimates.nested_motion(other, scene, motion))
    assert not at_frequency.amplitude < 0.5


def judged(frequency: float, factor: float) -> dict[str, estimates.MotionErrors]:
    """The estimates of the oscillator, whose mesh is judged by another one."""
    scene = shaken(frequency)
    model = of_frequency(1.0, scene)
    motion, errors = simulate(model, scene, keep_coordinates=True), {}
    meshes = model, of_frequency(factor, scene), [0]
    verdicts.estimate_errors(model, None, scene, motion, errors, meshes=meshes)
    return errors


def test_mesh_is_judged_by_shift_and_peak_on_a_resonance() -> None:
    found = judged(1.0, 1.01)["mesh"]
    assert found.shift == pytest.approx(0.015, rel=0.02)
    assert found.amplitude == pytest.approx(0.015, rel=0.05)
    assert found.at_frequency > 1.0 and found.largest < verdicts.MESH_ERROR


@pytest.mark.parametrize(("frequency", "factor", "near"), [(1.0, 1.06, True), (0.5, 1.06, False)])
def test_mesh_that_is_too_coarse_is_refused_on_and_away_from_a_resonance(
    frequency: float, factor: float, near: bool
) -> None:
    with pytest.raises(AccuracyError) as caught:
        judged(frequency, factor)
    assert caught.value.kind == ErrorKind.MESH
    assert ("near a resonance" in str(caught.value)) == near


def test_step_is_judged_by_its_period_error_on_a_resonance() -> None:
    """The trapezoid of step h has the frequency 2 / h atan(omega h / 2)."""
    scene = shaken(1.0, steps=40)
    model = of_frequency(1.0, scene)
    motion, errors = simulate(model, scene), dict[str, estimates.MotionErrors]()
    verdicts.estimate_errors(model, None, scene, motion, errors)
    found = errors["time step"]
    # the frequency w of the loads at which the oscillator resonates with n steps in a period
    own, coarse = (OMEGA / n / np.tan(np.pi / n) / 2.0 for n in (40, 20))
    expected = coarse / own - 1.0
    assert found.shift == pytest.approx(estimates.STEP_SAFETY * abs(expected), rel=0.05)
    assert found.at_frequency > verdicts.TIME_ERROR > found.largest


@pytest.mark.slow
def test_bending_beam_on_coarse_mesh_has_the_true_shift_of_its_resonance() -> None:
    """A nonlinear beam of four elements, shaken at its resonance, against one of sixteen."""
    pytest.importorskip("dolfinx")
    from fenicsrom import build_model

    def beam(elements: int, frequency: float) -> StoredModel:
        changes = (
            f"geometry.parameters.elements_along={elements}",
            "geometry.parameters.load_at=0.5",
            f"loads.0.frequency={frequency}",
            "loads.0.force=0.3",
            "material.mass_damping=0.2",
            "time.steps_per_period=60",
            "basis.modes=2",
        )
        return build_model(beam_scene(2, changes, contacts=None, probe={"group": "tip"}))

    frequencies = [float(beam(n, 3.3).frequencies_hz[0]) for n in (4, 16)]
    coarse, fine = (beam(n, f) for n, f in zip((4, 16), frequencies, strict=True))
    motion, moved = (one.simulate(keep_coordinates=True) for one in (coarse, fine))
    errors: dict[str, estimates.MotionErrors] = {}
    verdicts.estimate_errors(coarse.model, None, coarse.scene, motion, errors, meshes=coarse.meshes)
    mesh, true = errors["mesh"], frequencies[0] / frequencies[1] - 1.0
    assert mesh.at_frequency > 1.0
    assert true < mesh.shift < 2.0 * true
    apart = np.linalg.norm(amplitude(motion)) / np.linalg.norm(amplitude(moved)) - 1.0
    assert abs(apart) < mesh.amplitude < verdicts.MESH_ERROR

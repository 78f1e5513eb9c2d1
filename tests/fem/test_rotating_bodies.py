"""Rotating bodies against closed forms and another integrator: point masses, damping, Coriolis."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

pytest.importorskip("dolfinx")

from scipy.integrate import solve_ivp
from support import beam_scene, make_solid

import fenicsrom
from fenicsrom.online.model.matrices import model_arrays
from fenicsrom.online.run.simulate import simulate
from fenicsrom.scene.reading.step_size import with_time

LENGTH, HEIGHT, YOUNG = 2.54, 0.0254, 207e9
RPM = 30.0 / np.pi
AXIAL = "material.poisson=0.0"


def test_tip_mass_at_speed_vibrates_as_on_a_string_with_bending_stiffness() -> None:
    """A light cantilever with the mass m at its tip, clamped on the axis z, has the tension
    N = m Omega^2 L. Its tip has the stiffness N / (L - tanh(k L) / k) with k^2 = N / EI against a
    force across, along the axis; in the plane of rotation m Omega^2 less."""
    mass, speed = 10.0, 20.0
    scene = beam_scene(
        3,
        ("geometry.parameters.elements_along=40", AXIAL, "material.density=1.0"),
        contacts=None,
        attachments=[{"group": "tip", "mass": mass}],
        rotation={"speed_rpm": speed * RPM, "axis": [0.0, 0.0, 1.0]},
    )
    solid = make_solid(scene)
    solid.spin(speed)
    squares, modes = solid.eigenmodes(solid.factor, 2)
    tension = mass * speed**2 * LENGTH
    k = np.sqrt(tension / (YOUNG * HEIGHT**4 / 12.0))
    flap = tension / (LENGTH - np.tanh(k * LENGTH) / k) / mass
    np.testing.assert_allclose(squares, [flap - speed**2, flap], rtol=2e-3)
    across = np.array([np.sum(modes[axis::3] ** 2, axis=0) for axis in range(3)])
    assert np.argmax(across, axis=0).tolist() == [1, 2]
    still = 3.0 * YOUNG * HEIGHT**4 / 12.0 / LENGTH**3 / mass
    assert flap > 3.0 * still  # the tension counts


def shaft(speed: float, alpha: float, *overrides: str) -> Any:
    """A square cantilever that turns about its own axis at a speed in rad/s, stored."""
    scene = beam_scene(
        3,
        (
            "geometry.parameters.elements_along=10",
            f"material.mass_damping={alpha!r}",
            "geometrically_nonlinear=false",
            *overrides,
        ),
        contacts=None,
        rotation={"speed_rpm": speed * RPM, "axis": [1.0, 0.0, 0.0], "coriolis": True},
        basis={"modes": 2, "derivatives": "none"},
    )
    return fenicsrom.build_model(scene)


def test_damping_that_turns_with_the_shaft_destabilises_it_at_its_critical_speed() -> None:
    """In the turning frame w = u_y + i u_z of a round shaft with damping alpha obeys
    w'' + (alpha + 2 i Omega) w' + (omega^2 - Omega^2) w = 0, so one whirl grows where Omega is
    above omega. Its rate near omega tells this speed."""
    alpha = 0.4
    omega = np.sqrt(shaft(0.0, alpha).model.elastic.stiffness[0, 0])
    rates = []
    for part in (0.6, 0.9):
        found = model_arrays(shaft(part * omega, alpha))
        speed = part * omega
        n = found.mass.shape[0]
        inverse = np.linalg.inv(found.mass)
        state = np.block(
            [
                [np.zeros((n, n)), np.eye(n)],
                [-inverse @ found.stiffness, -inverse @ (found.damping + found.gyroscopic)],
            ]
        )
        rates.append(np.linalg.eigvals(state).real.max())
        half = 0.5 * alpha + 1j * speed
        root = np.sqrt(half**2 - omega**2 + speed**2)
        assert rates[-1] == pytest.approx(max((-half + root).real, (-half - root).real), rel=1e-3)
    assert rates[0] < rates[1] < 0.0
    onset = 0.9 - rates[1] * 0.3 / (rates[1] - rates[0])
    assert onset == pytest.approx(1.0, abs=5e-3)


def test_motion_with_coriolis_force_equals_that_of_another_integrator() -> None:
    """A force along y moves the shaft across, too, against an explicit scheme of eighth order."""
    stored = shaft(10.0, 0.5, "time.periods=2", "time.steady='march'")
    arrays, load = model_arrays(stored), stored.scene.loads[0]
    n, inverse = stored.size, np.linalg.inv(arrays.mass)
    velocity = arrays.damping + arrays.gyroscopic

    def rate(t: float, y: np.ndarray) -> np.ndarray:
        force = load.size * np.sin(2.0 * np.pi * load.frequency * t) * arrays.loads[:, 0]
        force -= velocity @ y[n:] + arrays.elastic_force(y[:n])
        return np.concatenate([y[n:], inverse @ force])

    march = solve_ivp(
        rate, (0.0, 1.0), np.zeros(2 * n), "DOP853", rtol=1e-10, atol=1e-12, dense_output=True
    )
    errors = []
    for steps in (100, 200, 400):
        motion = simulate(stored.model, with_time(stored.scene, steps_per_period=steps))
        exact = arrays.probe_offset + (arrays.probe_rows @ march.sol(motion.time)[:n]).T
        size = np.abs(exact).max(axis=0)
        errors.append(np.abs(motion.displacement[:, 0] - exact).max() / size.max())
    assert size[2] > 0.2 * size[1] > 0.005  # the Coriolis force moves it across
    assert errors[-1] < 1e-3
    slopes = np.log2(np.array(errors[:-1]) / errors[1:])
    np.testing.assert_allclose(slopes, 2.0, atol=0.1)

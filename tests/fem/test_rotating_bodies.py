"""Rotating bodies against closed forms and another integrator: point masses, damping, Coriolis."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("dolfinx")

from scipy.integrate import solve_ivp
from support import beam_scene, make_solid

import fenicsrom
from fenicsrom.notes import NoteKind, note_of
from fenicsrom.online.model.matrices import model_arrays
from fenicsrom.online.run.simulate import simulate
from fenicsrom.scene import Scene, parse_scene
from fenicsrom.scene.reading.reading import with_time

pytestmark = pytest.mark.slow

LENGTH, HEIGHT, YOUNG = 2.54, 0.0254, 207e9
RPM = 30.0 / np.pi
AXIAL = "material.poisson=0.0"


def test_tip_mass_at_speed_vibrates_as_on_a_string_with_bending_stiffness() -> None:
    """A light cantilever with the mass m at its tip, clamped on the axis z, has the tension
    N = m Omega^2 L. Its tip has the stiffness N / (L - tanh(k L) / k) with k^2 = N / EI against a
    force across, along the axis; in the plane of rotation m Omega^2 less.

    Reference: lag and flap of a tip mass on a turning cantilever | string with bending stiffness
    | closed form | agree | 0.1 %
    """
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


def turning(speed: float, alpha: float, *overrides: str) -> Scene:
    """A square cantilever that turns about its own axis at a speed in rad/s."""
    return beam_scene(
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


def shaft(speed: float, alpha: float, *overrides: str) -> Any:
    """The model of `turning`."""
    return fenicsrom.build_model(turning(speed, alpha, *overrides))


def test_damping_that_turns_with_the_shaft_destabilises_it_at_its_critical_speed() -> None:
    """In the turning frame w = u_y + i u_z of a round shaft with damping alpha obeys
    w'' + (alpha + 2 i Omega) w' + (omega^2 - Omega^2) w = 0, so one whirl grows where Omega is
    above omega. Its rate near omega tells this speed.

    Reference: shaft with damping that turns with it: growth rate; critical speed | closed form |
    Ω = ω | agree | 0.1 %; 0.5 %
    """
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
    """A force along y moves the shaft across, too, against an explicit scheme of eighth order.

    Reference: motion of a shaft with Coriolis force | scipy, order 8, same matrices | its motion
    | 0.1 % at 400 steps; order 2 | 0.1 %
    """
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


DISK = """// A square shaft along x with a square disk; both ends are clamped.
y[] = {-0.06, -0.012, 0.012, 0.06};
For i In {0:3}
  For j In {0:3}
    Point(1 + 4*i + j) = {0.2, y[i], y[j]};
  EndFor
EndFor
For i In {0:3}
  For j In {0:2}
    Line(101 + 3*i + j) = {1 + 4*i + j, 2 + 4*i + j};
    Line(201 + 3*i + j) = {1 + 4*j + i, 5 + 4*j + i};
  EndFor
EndFor
For i In {0:2}
  For j In {0:2}
    k = 1 + 3*i + j;
    Curve Loop(k) = {101 + 3*i + j, 201 + 3*(j + 1) + i, -(104 + 3*i + j), -(201 + 3*j + i)};
    Plane Surface(k) = {k};
  EndFor
EndFor
Transfinite Curve {101:112, 201:212} = 2;
Transfinite Surface {1:9};
disk[] = Extrude {0.02, 0, 0} { Surface{5, 1, 2, 3, 4, 6, 7, 8, 9}; Layers{1}; };
one[] = Extrude {-0.2, 0, 0} { Surface{5}; Layers{3}; };
two[] = Extrude {0.38, 0, 0} { Surface{disk[0]}; Layers{5}; };
Physical Volume("solid") = {1:11};
Physical Surface("left") = {one[0]};
Physical Surface("right") = {two[0]};
"""


def test_shaft_with_a_disk_matches_calculix_below_and_above_its_critical_speed(
    tmp_path: Path,
) -> None:
    """CalculiX 2.20, *COMPLEX FREQUENCY, CORIOLIS after *FREQUENCY (20 modes) and *STATIC with
    CENTRIF, on the same 102 straight C3D10. The critical speed is 14,500 rpm; above it the two
    lowest eigenvalues of the stiffness are negative. The scene has no loads and no times.

    Reference: six frequencies of a shaft with a disk, below and above its critical speed | CalculiX
    2.20, same cells | 140.767 to 1383.683 Hz; 56.387 to 1297.942 Hz | agree | 0.1 %
    """
    (tmp_path / "shaft.geo").write_text(DISK)
    scene = parse_scene(
        {
            "geometry": {"mesh": "shaft.geo", "dimension": 3, "cells": "simplex"},
            "material": {"young": 2.1e11, "poisson": 0.3, "density": 7850.0},
            "supports": [{"group": "left"}, {"group": "right"}],
            "rotation": {"speed_rpm": 6000.0, "axis": [1.0, 0.0, 0.0], "coriolis": True},
            "campbell": {"speeds_rpm": [0.0, 6000.0, 18000.0], "modes": 6},
        },
        "shaft",
        tmp_path,
        unloaded=True,
    )
    found = fenicsrom.campbell(scene)
    below, above = np.sort(found.frequencies_hz[1:], axis=1)
    np.testing.assert_allclose(
        below, [140.7670, 337.9701, 394.0870, 712.8684, 884.1972, 1383.683], rtol=1e-3
    )
    np.testing.assert_allclose(
        above, [56.38711, 394.0273, 535.0263, 537.7668, 1049.880, 1297.942], rtol=1e-3
    )
    assert found.mac.min() > 0.9  # a mesh splits the pairs at rest by 1.3 %
    doubts = ("unstable", "swapped", "lost", "whirl")
    assert not [text for text in found.warnings if any(word in text for word in doubts)]


def test_shaft_above_its_critical_speed_whirls_by_damping_only() -> None:
    """The growth in a revolution is that of the closed form of the test above.

    Reference: growth in a turn of a shaft at 1.3 times its critical speed | closed form | closed
    form | agrees | 2 %
    """
    omega = np.sqrt(shaft(0.0, 0.0).model.elastic.stiffness[0, 0])
    speed = 1.3 * omega
    held = make_solid(turning(speed, 0.0))
    assert held.unstable == 0 and not held.warnings
    alpha = 0.4
    solid = make_solid(turning(speed, alpha))
    half = 0.5 * alpha + 1j * speed
    rate = (-half + np.sqrt(half**2 - omega**2 + speed**2)).real
    (told,) = solid.warnings
    assert solid.unstable == 2 and note_of(told).kind is NoteKind.UNSTABLE
    growth = float(told.split("grows by ")[1].split(" %")[0])
    assert growth == pytest.approx(100.0 * np.expm1(rate * 2.0 * np.pi / speed), rel=0.02)
    # the search for another equilibrium runs away: few elements
    alone = "rotation.coriolis=false", "geometry.parameters.elements_along=2"
    still = make_solid(turning(speed, 0.0, *alone))
    assert still.unstable == 2 and "rotation.coriolis" in still.warnings[0]

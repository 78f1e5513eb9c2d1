"""The backbone of a rotating cantilever: centrifugal forces turn its hardening into softening.

A slender inextensible cantilever, clamped on the axis, moves in the flap plane without Coriolis
force. With eta = Omega L^2 sqrt(rho A / E I) the backbone of its first mode is

    omega^2 / omega_1^2 = 1 + c (w_tip / L)^2

to the order given. The coefficients were recomputed independently for a beam. A model that
condenses the derivative statically, without its inertia, gives 0.6134 at rest.
"""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("dolfinx")

from support import beam_scene, enriched, make_solid, no_contacts

from fenicsrom.online.curves.nonlinear_mode import ModeContinuation, linear_modes
from fenicsrom.online.model.model import Problem
from fenicsrom.online.periodic.shooting import recorded_motion
from fenicsrom.reduction.basis import project
from fenicsrom.scene import Time

LENGTH, THICKNESS = 2.54, 0.0254
UNIT = np.sqrt(207e9 * THICKNESS**2 / 12.0 / (7801.0 * LENGTH**4))  # rad/s
RPM = 30.0 / np.pi
FREQUENCY = {0.0: 3.5160, 1.0: 3.6816, 2.0: 4.1373}
COEFFICIENT = {0.0: 0.03877, 1.0: -0.00819, 2.0: -0.10880}
SIGN_CHANGE = 0.90
SETTINGS = Time.of(scheme="generalised-alpha", spectral_radius=0.0, periods=1, steps_per_period=200)
"""The scheme damps the axial motion, whose steps are too long to follow it. Schemes that conserve
energy find internal resonances with it that belong to the steps."""
SMALL, LARGE = 1e-3, 1e-2  # amplitudes of the tip, as parts of the length


def flap(eta: float) -> tuple[float, float]:
    """First frequency in `UNIT` and coefficient c of a solid that is thin along the axis."""
    sizes = (
        "geometry.parameters.elements_along=40",
        f"geometry.parameters.width={THICKNESS}",
        f"geometry.parameters.height={2.0 * THICKNESS}",
        "material.poisson=0.0",
        "material.mass_damping=0.0",
    )
    rotation = {"speed_rpm": eta * UNIT * RPM, "axis": [0.0, 0.0, 1.0], "coriolis": False}
    probe = {"group": "tip", "at": "centre"}
    solid = make_solid(beam_scene(3, sizes, contacts=None, probe=probe, rotation=rotation))
    _, _, basis = enriched(solid, "rubin", 1)
    model = project(solid, basis)
    problem = Problem(model, no_contacts(3), SETTINGS, None)
    mode = linear_modes(problem)[0]
    tip = np.abs(model.probe @ mode.shape)
    assert int(np.argmax(tip)) == 2  # along the axis
    first, last = (part * LENGTH / tip[2] for part in (SMALL, LARGE))
    path = ModeContinuation(problem, mode, first, last)
    found = []
    for value in (path.low, path.high):
        point = path.at_parameter(path.linear_start(), value)
        assert point is not None
        assert abs(path.damping_ratio(point)) < 1e-6
        motion = recorded_motion(path.problem_at(point.s, point.parameter), point.z)
        assert motion.coordinates is not None
        tip_amplitude = float(np.ptp(motion.coordinates @ model.probe[2])) / 2.0
        found.append((path.frequency(point), tip_amplitude / LENGTH))
    (slow, small), (fast, large) = found
    return mode.omega / UNIT, ((fast / slow) ** 2 - 1.0) / (large**2 - small**2)


@pytest.mark.slow
def test_backbone_of_a_rotating_cantilever_matches_beam_theory() -> None:
    """Reference: hardening c of a rotating cantilever, η = 0, 1, 2 | recomputed for a beam |
    0.0388, −0.0082, −0.1088 | 0.0385, −0.0080, −0.1077 | 0.005
    """
    found = {eta: flap(eta) for eta in (*FREQUENCY, SIGN_CHANGE - 0.03, SIGN_CHANGE + 0.03)}
    for eta, frequency in FREQUENCY.items():
        assert found[eta][0] == pytest.approx(frequency, rel=1e-3)
        assert found[eta][1] == pytest.approx(COEFFICIENT[eta], abs=0.005)
    assert found[SIGN_CHANGE - 0.03][1] > 0.0 > found[SIGN_CHANGE + 0.03][1]

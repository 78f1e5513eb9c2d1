"""Supports that move together: displacement, transmissibility, and response over the frequency."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp
from scipy.linalg import eigh
from support import assert_tangent, beam_scene, linear_model, no_contacts

from fenicsrom.online.contact.points import ContactPoints, no_points
from fenicsrom.online.kernels.numbers import STEP
from fenicsrom.online.model.loads import (
    displacement_sines,
    factors,
    histories_of,
    support_displacement,
)
from fenicsrom.online.model.model import Problem
from fenicsrom.online.motion.measures import absolute_displacement
from fenicsrom.online.motion.motion import Motion
from fenicsrom.online.periodic.shooting import frequency_family
from fenicsrom.online.run.simulate import load_histories, simulate
from fenicsrom.reduction.beam import beam_model, beam_structure
from fenicsrom.scene import Load, Scene

Array = NDArray[np.float64]

TIME = np.linspace(0.0, 2.0, 41)
SLANTED = (0.6, 0.8)
HISTORIES: dict[str, dict[str, Any]] = {
    "table": {"table": [[0.3, 0.0], [0.8, 2.0], [1.1, -1.0], [1.6, 0.5]]},
    "pulse": {"pulse": {"start": 0.13, "duration": 0.7}},
    "sweep": {"frequency": 2.0, "phase": 0.4, "sweep": {"to": 5.0, "duration": 1.3}},
}


@pytest.mark.parametrize("history", list(HISTORIES))
def test_supports_start_at_rest_and_follow_their_acceleration(history: str) -> None:
    load = Load.of(direction=SLANTED, support_acceleration=3.0, **HISTORIES[history])
    found = support_displacement([load], TIME, 2)
    histories = histories_of([load])
    march = solve_ivp(
        lambda t, y: [y[1], factors(histories, t)[0]],
        (0.0, TIME[-1]),
        [0.0, 0.0],
        t_eval=TIME,
        max_step=0.01,
        rtol=1e-10,
        atol=1e-12,
    )
    np.testing.assert_allclose(found, np.outer(march.y[0], SLANTED), rtol=0, atol=1e-7)


def test_displacement_of_a_ramp_is_a_cubic() -> None:
    load = Load.of(
        direction=[1.0, 0.0], support_acceleration=6.0, table=[[0.0, 0.0], [1.0, 1.0], [2.0, 1.0]]
    )
    after = np.maximum(TIME - 1.0, 0.0)
    cubic = np.minimum(TIME, 1.0) ** 3 + 3.0 * after + 3.0 * after**2
    np.testing.assert_allclose(support_displacement([load], TIME, 2)[:, 0], cubic, atol=1e-14)


@pytest.mark.parametrize(
    "history",
    [
        {"frequency": 3.0, "phase": 0.7},
        {"frequency": 1.5, "harmonics": [[1, 1.0, 0.2], [3, 0.3, -1.0]]},
    ],
    ids=["sine", "harmonics"],
)
def test_given_displacement_has_its_second_derivative_as_load(history: dict[str, Any]) -> None:
    load = Load.of(direction=SLANTED, support_displacement=0.01, **history)
    h = 1e-4
    around = [support_displacement([load], TIME + k * h, 2) for k in (-1, 0, 1)]
    second = (around[0] - 2.0 * around[1] + around[2]) / h**2
    histories = histories_of([load])
    given = np.array([factors(histories, t)[0] for t in TIME])
    np.testing.assert_allclose(second, np.outer(given, SLANTED), atol=1e-5 * np.abs(given).max())
    same = support_displacement([load.by_acceleration()], TIME, 2)
    np.testing.assert_allclose(same, around[1], atol=1e-16)


def shaken(*overrides: str, **load: Any) -> Scene:
    """A linear cantilever whose supports move across it; the 1D beam stands for it."""
    return beam_scene(
        2,
        ("time.steady='march'", *overrides),
        contacts=None,
        probe={"group": "tip"},
        geometrically_nonlinear=False,
        loads=[{"direction": [0.0, 1.0], **load}],
        reference={
            "beam": True,
            "beam_section": {
                "length": 2.54, "height": 0.0254, "width": 0.0254, "elements": 8, "load_at": 0.75,
            },
        },
    )  # fmt: skip


def absolute_amplitude(scene: Scene, points: ContactPoints, motion: Motion) -> Array:
    """Half of peak-to-peak of the absolute displacement of the probe over the last period."""
    part = motion.last_period()
    return np.asarray(np.ptp(absolute_displacement(scene, points, motion)[part, 0], axis=0) / 2.0)


@pytest.mark.parametrize("ratio", [0.5, 1.0, 2.0])
def test_oscillator_on_a_shaker_has_the_transmissibility_of_the_closed_form(ratio: float) -> None:
    """sqrt(1 + (2 zeta r)²) / sqrt((1 - r²)² + (2 zeta r)²), with its dashpot to the supports.

    Reference: transmissibility of an oscillator at r = 0.5, 1, 2 | closed form | √(1 + (2ζr)²) /
    √((1 − r²)² + (2ζr)²) | agrees | 0.05 %
    """
    zeta, omega = 0.1, 2.0 * np.pi
    scene = shaken(
        f"material.mass_damping={2.0 * zeta * omega}",
        "time.steps_per_period=400",
        "time.steady_tolerance=1e-8",
        "time.periods=80",
        support_displacement=0.01,
        frequency=ratio,
    )
    model = linear_model(
        np.eye(1),
        omega**2 * np.eye(1),
        damping=scene.material.mass_damping,
        loads=[[-1.0]],
        load_histories=load_histories(scene),
    )
    model = model._replace(probe=np.array([[0.0], [1.0]]))
    motion = simulate(model, scene)
    found = absolute_amplitude(scene, no_points(2), motion)[1] / 0.01
    damped = (2.0 * zeta * ratio) ** 2
    exact = np.sqrt((1.0 + damped) / ((1.0 - ratio**2) ** 2 + damped))
    assert found == pytest.approx(exact, rel=5e-4)


@pytest.mark.slow
def test_cantilever_on_a_shaker_is_the_sum_of_its_modes() -> None:
    """Tip of the 1D beam below its first frequency; its first mode alone is within 2 %.

    Reference: tip of a shaken linear cantilever | sum over its modes | closed form | agrees |
    0.03 %
    """
    alpha, frequency, size = 12.0, 3.0, 9.81
    scene = shaken(
        f"material.mass_damping={alpha}",
        "time.steps_per_period=200",
        "time.steady_tolerance=1e-6",
        "time.periods=60",
        support_acceleration=size,
        frequency=frequency,
    )
    motion = simulate(beam_model(scene), scene)
    body = beam_structure(scene)
    squares, modes = eigh(body.stiffness, body.mass)
    omega = 2.0 * np.pi * frequency
    pushed = modes.T @ body.load_vectors[:, 0]
    each = (body.probe_rows @ modes)[1] * pushed * size / (squares - omega**2 + 1j * alpha * omega)
    relative = np.ptp(motion.displacement[motion.last_period(), 0, 1]) / 2.0
    assert relative == pytest.approx(abs(each.sum()), rel=3e-4)
    assert relative == pytest.approx(abs(each[0]), rel=0.02)
    found = absolute_amplitude(scene, body.points, motion)[1]
    assert found == pytest.approx(abs(each.sum() - size / omega**2), rel=3e-4)
    # rigid translation: all of the mass but what moves with the clamp
    mass = 7801.0 * 2.54 * 0.0254**2
    rigid = np.zeros(body.size)
    rigid[1::3] = 1.0
    assert -rigid @ body.load_vectors[:, 0] == pytest.approx(mass * (1.0 - 0.5 / 8.0), rel=1e-12)


@pytest.mark.parametrize("key", ["support_displacement", "support_acceleration"])
def test_response_over_the_frequency_keeps_what_is_given(key: str) -> None:
    scene = shaken(frequency=3.0, **{key: 0.02})
    histories = load_histories(scene)
    model = linear_model(np.eye(1), np.eye(1), loads=[[1.0]], load_histories=histories)
    displaced = displacement_sines(scene.loads)
    family = frequency_family(Problem(model, no_contacts(), None, 1.0 / 3.0), displaced=displaced)
    other = load_histories(replace(scene, loads=(scene.loads[0].changed(frequency=4.5),)))
    found = family(4.5)
    np.testing.assert_allclose(found.model.load_histories.sines, other.sines, rtol=1e-14)
    assert_tangent(
        lambda x: family(float(x[0])).model.load_histories.sines[0, :2],
        lambda x: family(float(x[0])).varied.model.load_histories.sines[0, :2, None].imag / STEP,
        np.array([4.5]),
    )

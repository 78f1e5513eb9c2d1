"""Curves of periodic motions over the speed of rotation, with the two modes of `test_interaction`.

Their frequencies follow the speed, and their motions are known exactly.
"""

from __future__ import annotations

import numpy as np
import pytest
from support import beam_scene, refusal
from test_interaction import two_modes

import fenicsrom as fr
from fenicsrom.assess.curves.response_problem import family_of, start_motion
from fenicsrom.errors import ErrorKind
from fenicsrom.online.store.archive import StoredModel

pytestmark = pytest.mark.slow

TABLE = "response={{parameter='rotation.speed_rpm', first={}, last={}}}"


def over_speeds(first: float, last: float, *changes: str, **contact: float) -> StoredModel:
    """The model with a curve over the speed."""
    return two_modes(TABLE.format(first, last), *changes, **contact)


@pytest.mark.parametrize(
    "rpm, amplitude, force, multiplier",
    [
        (1500.0, 3.404186e-5, 12.16375, 0.9418),
        (4100.0, 4.701505e-4, 29.91217, 0.9783),
        (4400.0, 9.430262e-4, 331.30685, 0.9798),
        (5000.0, 5.605279e-5, 80.15742, 0.9822),
        (7000.0, 3.832306e-4, 190.78964, 0.9872),
    ],
)
def test_motion_at_a_speed_is_the_exact_one(
    rpm: float, amplitude: float, force: float, multiplier: float
) -> None:
    """Half radial range, peak force and largest Floquet multiplier over half a revolution.

    Reference: two modes rub, curve at five speeds: largest multiplier | exact motion | 0.9418 to
    0.9872 | agrees | 1e-4
    """
    stored = over_speeds(1000.0, 9000.0).over_speeds(1000.0, 9000.0)
    motion = start_motion(stored, family_of(stored), rpm)
    assert motion.amplitude[0, 0] == pytest.approx(amplitude, rel=5e-3)
    assert motion.record.force[:, :, 0].max() == pytest.approx(force, rel=1e-2)
    assert np.sqrt(abs(motion.multipliers[0])) == pytest.approx(multiplier, abs=1e-4)
    assert motion.stable


@pytest.mark.parametrize(
    "rpm, exact, errors",
    [
        (4400.0, 9.430262e-4, (1.4e-2, 3.5e-3, 8.7e-4, 2.2e-4)),
        pytest.param(7000.0, 3.832306e-4, (6.3e-2, 1.5e-2, 3.7e-3, 9.2e-4), marks=pytest.mark.slow),
    ],
)
def test_errors_of_the_step_are_of_second_order(
    rpm: float, exact: float, errors: tuple[float, ...]
) -> None:
    """With 150, 300, 600 and 1200 steps per revolution, from the limit of short steps; the lobe's
    argument at 300 m changes that by less than 2e-4.

    Reference: two modes rub, 4400 rpm, 150 to 1200 steps: error | exact motion | 1.4e-2 to 2.2e-4 |
    agrees | 5 % of the error
    """
    found = []
    for steps in (150, 300, 600, 1200):
        stored = over_speeds(4000.0, 8000.0, f"time.steps_per_period={steps}")
        wide = stored.over_speeds(4000.0, 8000.0)
        motion = start_motion(wide, family_of(wide), rpm)
        found.append(motion.amplitude[0, 0])
    limit = (4.0 * found[3] - found[2]) / 3.0
    assert limit == pytest.approx(exact, rel=3e-4)
    np.testing.assert_allclose(np.array(found) / limit - 1.0, errors, rtol=0.05)


def test_curve_passes_the_exact_peak() -> None:
    """The motion at 4650 rpm, 4.16e-3 m +- 1 %, that a run reaches from lower speeds only."""
    found = fr.response(over_speeds(4400.0, 4652.0))
    points = found.curves[0].points
    assert points[-1].parameter == 4652.0 and found.unfinished is None
    speeds = [point.parameter for point in points]
    amplitudes = [point.amplitude[0, 0] for point in points]
    assert np.interp(4650.0, speeds, amplitudes) == pytest.approx(4.16e-3, rel=0.015)
    assert max(amplitudes) == pytest.approx(4.57e-3, rel=0.01)


def test_unsuitable_scenes_are_refused() -> None:
    with refusal(ErrorKind.RANGE, "response.last"):
        over_speeds(1000.0, 9001.0)
    with refusal(ErrorKind.CONFLICT, "response.parameter", names="engine_order"):
        over_speeds(
            1000.0,
            9000.0,
            "loads.0={group='load', at='centre', direction=[0.0, 1.0], force=1.0, frequency=3.0}",
        )
    with refusal(ErrorKind.CONFLICT, "geometrically_nonlinear"):
        over_speeds(1000.0, 9000.0, "geometrically_nonlinear=false")
    with refusal(ErrorKind.CONFLICT, "response.parameter", names="surface.spin"):
        over_speeds(1000.0, 9000.0, "contacts.0.surface.spin=3.0")
    with refusal(ErrorKind.CONFLICT, "response.parameter", names="speeds_rpm"):
        beam_scene(2, ("rotation={speed_rpm=100.0}", TABLE.format(50.0, 100.0)))

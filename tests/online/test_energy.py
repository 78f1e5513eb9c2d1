"""The energy verdict: energy that is created, lost, or given by friction."""

from __future__ import annotations

from contextlib import nullcontext
from dataclasses import replace

import numpy as np
import pytest
from support import oscillator

from fenicsrom.errors import AccuracyError, ErrorKind
from fenicsrom.online.motion.motion import (
    SCHEME_TOLERANCE,
    check_energy,
    check_scheme,
    energy_errors,
    friction_gains_energy,
)


def test_created_and_lost_energy_is_refused() -> None:
    _, _, motion = oscillator()
    check_energy(motion)
    ramp, most = (
        np.linspace(0.0, 1.0, motion.time.size),
        float(np.max(motion.kinetic + motion.elastic)),
    )
    for share, refused in ((0.9e-2, False), (1.1e-2, True)):
        with pytest.raises(AccuracyError, match="created") if refused else nullcontext():
            check_energy(
                replace(
                    motion, damping_dissipation=motion.damping_dissipation + share * most * ramp
                )
            )
    # lost energy acts as damping: it is compared with the work of the loads too
    most += float(np.max(motion.work))
    for share, refused in ((0.9e-2, False), (1.1e-2, True)):
        with pytest.raises(AccuracyError, match="lost") if refused else nullcontext():
            check_energy(
                replace(
                    motion, damping_dissipation=motion.damping_dissipation - share * most * ramp
                )
            )
    gift = (
        np.where(np.arange(motion.time.size) % 2 == 1, -0.1, 0.0) * motion.damping_dissipation[-1]
    )
    with pytest.raises(AccuracyError, match="friction gives energy"):
        check_energy(replace(motion, friction_dissipation=gift, work=motion.work + gift))
    rounding = np.where(np.arange(motion.time.size) == 7, -1e-15 * most, 0.0)
    undamped = replace(
        motion,
        friction_dissipation=rounding,
        work=motion.work - motion.damping_dissipation,
        damping_dissipation=0.0 * motion.damping_dissipation,
    )
    check_energy(undamped)
    with pytest.raises(
        AccuracyError, match="friction gives energy"
    ):  # damping before the first record does not count
        check_energy(
            replace(
                motion,
                friction_dissipation=gift,
                work=motion.work + gift,
                damping_dissipation=motion.damping_dissipation
                + 1e5 * motion.damping_dissipation[-1],
            )
        )


def test_energy_errors_read_a_known_imbalance() -> None:
    _, _, motion = oscillator()
    ramp = np.linspace(0.0, 1.0, motion.time.size)
    found = energy_errors(replace(motion, kinetic=motion.kinetic + ramp))
    assert found.created == pytest.approx(1.0, abs=1e-9) and found.lost == pytest.approx(0.0)
    friction = np.where(np.arange(motion.time.size) >= 7, -0.25, 0.0)
    found = energy_errors(replace(motion, friction_dissipation=friction))
    assert found.friction_gain == found.largest_friction_gain == 0.25


@pytest.mark.parametrize("scheme", SCHEME_TOLERANCE)
def test_scheme_balance_is_refused_beyond_its_tolerance(scheme: str) -> None:
    """Lost energy counts for every scheme except generalised-alpha."""
    _, _, motion = oscillator()
    found = energy_errors(motion)
    most = SCHEME_TOLERANCE[scheme] * (found.energy + found.work)
    ramp = np.linspace(0.0, 1.0, motion.time.size)
    for part in (0.9, 1.1, -1.1):
        off = motion.contact_energy + part * most * ramp
        refused = part > 1.0 or (part < -1.0 and scheme != "generalised-alpha")
        with pytest.raises(AccuracyError) if refused else nullcontext() as error:
            check_scheme(replace(motion, contact_energy=off), scheme)
        if error is not None:
            assert error.value.kind is ErrorKind.ENERGY


def test_friction_that_gives_energy_in_one_step_is_found() -> None:
    _, _, motion = oscillator()
    steady = np.linspace(0.0, 1.0, motion.time.size)
    assert not friction_gains_energy(replace(motion, friction_dissipation=steady))
    gift = np.where(np.arange(motion.time.size) == 7, -1e-6, 0.0)
    assert friction_gains_energy(replace(motion, friction_dissipation=gift))

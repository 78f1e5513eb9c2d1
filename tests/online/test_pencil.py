"""Growth of small motions in a turning frame against the closed form of a Jeffcott rotor."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from fenicsrom.online.model.pencil import growing, roots

Array = NDArray[np.float64]
OMEGA = 100.0  # rad/s, critical speed
MASS = 2.0  # kg


def jeffcott(speed: float, damping: float) -> tuple[Array, Array, Array]:
    """M, D and K of a disk on a round shaft in the frame that turns, damped by alpha M."""
    turn = np.array([[0.0, -1.0], [1.0, 0.0]])
    velocity = MASS * (damping * np.eye(2) + 2.0 * speed * turn)
    return MASS * np.eye(2), velocity, MASS * (OMEGA**2 - speed**2) * np.eye(2)


def whirls(speed: float, damping: float) -> NDArray[np.complex128]:
    """w = y + i z obeys w'' + (alpha + 2 i Omega) w' + (omega^2 - Omega^2) w = 0."""
    half = 0.5 * damping + 1j * speed
    root = np.sqrt(half**2 - OMEGA**2 + speed**2)
    return np.array([-half + root, -half - root])


@pytest.mark.parametrize("speed", [30.0, 99.0, 101.0, 250.0])
@pytest.mark.parametrize("damping", [0.0, 0.5])
def test_rotor_grows_only_by_its_damping_above_the_critical_speed(
    speed: float, damping: float
) -> None:
    """Reference: growth rate of a Jeffcott rotor, four speeds | closed form | its roots | agree |
    1e-9
    """
    exact = whirls(speed, damping)
    exact = np.concatenate([exact, exact.conj()])
    found = roots(*jeffcott(speed, damping))
    for root in exact:
        assert np.abs(found - root).min() < 1e-9 * OMEGA
    grows = growing(*jeffcott(speed, damping))
    assert grows.size == (2 if damping and speed > OMEGA else 0)
    if grows.size:
        assert grows[0].real == pytest.approx(exact.real.max(), rel=1e-6)


@pytest.mark.parametrize("second", [3.0, 0.4, -0.2])
def test_rotor_with_unequal_stiffness_is_unstable_between_its_critical_speeds(
    second: float,
) -> None:
    """A negative determinant of K gives a real root that grows; two negative stiffnesses may be
    held by the Coriolis force, and without it they are not."""
    speed = 1.1 * OMEGA
    mass, velocity, stiffness = jeffcott(speed, 0.0)
    stiffness[1, 1] = second * MASS * OMEGA**2
    det = stiffness[0, 0] * stiffness[1, 1]
    # lambda^4 + (k1 + k2 + 4 Omega^2) lambda^2 + k1 k2 = 0 in terms of m
    half = 0.5 * (np.trace(stiffness) / MASS + 4.0 * speed**2)
    squares = -half + np.array([1.0, -1.0]) * np.sqrt(half**2 - det / MASS**2)
    found = growing(mass, velocity, stiffness)
    assert found.size == np.sum(squares > 0.0) == (1 if det < 0.0 else 0)
    if found.size:
        assert found[0] == pytest.approx(np.sqrt(squares.max()), rel=1e-9)
    free = growing(mass, np.zeros((0, 0)), stiffness)
    assert free.size == (1 if det < 0.0 else 2)

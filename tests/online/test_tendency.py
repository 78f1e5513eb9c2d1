"""Marches that tend to a periodic motion, and others."""

from __future__ import annotations

from contextlib import nullcontext
from typing import Any

import numpy as np
import pytest
from support import duffing, no_contacts

from fenicsrom.errors import ConvergenceError
from fenicsrom.online.model.model import Problem
from fenicsrom.online.periodic import steady
from fenicsrom.online.periodic.shooting import PeriodicMotion, Shooting, solve, start_variables
from fenicsrom.online.periodic.steady import CALM, MarchedPath
from fenicsrom.scene import Time

UPPER, LOWER = (1.30722027, 0.87306771), (-0.24849689, 0.02338837)


def path_from(x: float, v: float) -> MarchedPath:
    """A march of the oscillator with two stable motions."""
    model, period = duffing(0.05, 1.0, 0.3, 1.5)
    shooting = Shooting(
        Problem(model, no_contacts(), Time.of(periods=3, steps_per_period=100), period)
    )
    start = np.array([x]), np.array([v]), np.zeros((0, 2))
    return MarchedPath(shooting, shooting.scaled(start_variables(shooting, start)))


def motion_at(x: float, v: float) -> PeriodicMotion:
    """The periodic motion near a state."""
    path = path_from(x, v)
    return solve(path.shooting, path.states[0])


class Rounding(Shooting):
    """An equation whose residual has an error of a size relative to the variables."""

    size = 0.0
    noise = np.random.default_rng(1)

    def march(self, s: Any, *args: Any, **options: Any) -> Any:
        found = super().march(s, *args, **options)
        assert found is not None
        error = self.noise.normal(size=s.size)
        return found[0] + self.size * np.linalg.norm(s) / np.linalg.norm(error) * error, *found[1:]


@pytest.mark.parametrize(("size", "is_found"), [(3e-9, True), (3e-7, False)])
def test_residual_that_cannot_be_reduced_is_rounding_if_it_is_small(
    size: float, is_found: bool
) -> None:
    path = path_from(*UPPER)
    shooting = Rounding(path.shooting.problem)
    shooting.size = size
    with nullcontext() if is_found else pytest.raises(ConvergenceError):
        found = solve(shooting, path.states[0])
        assert size / 10.0 < found.residuals[-1] <= 1e-8
        assert found.z == pytest.approx(motion_at(*UPPER).z, rel=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize("start", [(0.0, 0.0), (2.0, -1.0), (-1.0, 1.5), (0.5, -2.0)])
def test_march_tends_to_one_of_two_motions_from_a_state_that_it_reaches_later(
    start: tuple[float, float],
) -> None:
    upper, lower = motion_at(*UPPER), motion_at(*LOWER)
    path = path_from(*start)
    assert not path.tends_to(upper, 2) and not path.tends_to(lower, 2)
    found = [path.tends_to(upper, 60), path.tends_to(lower, 60)]
    assert path.reaches(300)
    ends = [np.linalg.norm(path.states[-1] - path.shooting.scaled(m.z)) for m in (upper, lower)]
    assert min(ends) < 1e-3 < max(ends)
    assert found == [ends[0] < ends[1], ends[1] < ends[0]]


def test_states_after_the_first_are_tried() -> None:
    """(1) holds as soon as for a march that begins where the first one is after 30 periods."""
    motion = motion_at(*LOWER)
    whole = path_from(0.0, 0.0)
    assert whole.reaches(60)
    late = MarchedPath(whole.shooting, whole.states[30])
    needed = next(k for k in range(1, 40) if late.tends_to(motion, k))
    assert whole.tends_to(motion, 30 + needed)


def test_long_march_tells_how_far_it_is(
    caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(steady, "TOLD", -1.0)
    with caplog.at_level("INFO", "fenicsrom"):
        path_from(0.0, 0.0).tends_to(motion_at(*LOWER), 3)
    assert [text.split(",")[0] for text in caplog.messages] == [
        f"  period {k} of at most 3" for k in range(3)
    ]


def test_calm_state_is_the_first_that_changes_little_in_a_period() -> None:
    path = path_from(0.0, 0.0)
    assert path.calm_state(0) is path.states[0] and len(path.states) == 1
    assert path.calm_state(3) is path.states[3]
    calm = path.calm_state(300)
    changes = [
        np.linalg.norm(b - a) / np.linalg.norm(b)
        for a, b in zip(path.states, path.states[1:], strict=False)
    ]
    assert calm is path.states[-1] and changes[-1] <= CALM < min(changes[:-1])

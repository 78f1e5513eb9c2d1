"""The time integration: a scheme, a span of time and the choice of the step.

The given keys select one kind of span and one kind of step.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Any

from fenicsrom.scene.base.rules import choice, integer, number
from fenicsrom.scene.base.tables import OneOf, changed, from_keys

SCHEMES = ("average-acceleration", "generalised-alpha", "discrete-gradient")
GENERALISED_ALPHA = "generalised-alpha"
STEADY = ("newton", "march")


@dataclass(frozen=True, kw_only=True)
class Periodic:
    """A run until the motion repeats, with loads that repeat.

    Attributes:
        periods: largest number of periods. A steady motion ends earlier.
        steady_tolerance: relative change over a period of a steady motion; 0 runs all periods.
            Default: the larger of 1e-5 and `tolerance`.
        steady: "newton" finds the periodic motion by Newton's method after 5, 10, 20, ... periods
            and judges its stability. "march" runs until the motion repeats.
    """

    periods: Annotated[int, integer(1, 1_000_000)] = 100
    steady_tolerance: Annotated[float | None, number(least=0.0, below=1.0)] = None
    steady: Annotated[str, choice(*STEADY)] = "newton"


@dataclass(frozen=True, kw_only=True)
class Duration:
    """A run for a given time, with loads that do not repeat or without loads.

    Attributes:
        duration: time to integrate, if loads do not repeat.
    """

    duration: Annotated[float, number(above=0.0, unit="s")]


@dataclass(frozen=True, kw_only=True)
class EquilibriumOnly:
    """No run: all loads are static, so only the equilibrium is computed."""


@dataclass(frozen=True, kw_only=True)
class FixedStep:
    """A fixed step.

    Attributes:
        step: fixed step, with `duration`.
    """

    step: Annotated[float, number(above=0.0, unit="s")]


@dataclass(frozen=True, kw_only=True)
class StepsPerPeriod:
    """A fixed step as a fraction of the period.

    Attributes:
        steps_per_period: fixed steps in a period, if loads repeat. Default: 200.
    """

    steps_per_period: Annotated[int, integer(4, 1_000_000)]


@dataclass(frozen=True, kw_only=True)
class StepsPerRevolution:
    """Steps of equal angles at a speed of rotation that varies.

    Attributes:
        steps_per_revolution: steps in a revolution, with rotation.history.
    """

    steps_per_revolution: Annotated[int, integer(4, 1_000_000)]


@dataclass(frozen=True, kw_only=True)
class Tolerance:
    """An adaptive step.

    Attributes:
        tolerance: adaptive step with a relative local error of a hundredth of this value.
    """

    tolerance: Annotated[float, number(above=0.0, below=1.0)]


@dataclass(frozen=True, kw_only=True)
class NoStep:
    """No step, because only the equilibrium is computed."""


Span = Periodic | Duration | EquilibriumOnly
Stepping = FixedStep | StepsPerPeriod | StepsPerRevolution | Tolerance | NoStep
SPANS = OneOf.by_keys(EquilibriumOnly, Duration, Periodic)
STEPPINGS = OneOf.by_keys(NoStep, FixedStep, StepsPerPeriod, StepsPerRevolution, Tolerance)


@dataclass(frozen=True, kw_only=True)
class Time:
    """The time integration.

    Attributes:
        scheme: time integration scheme.
        spectral_radius: spectral radius of generalised-alpha at infinite frequency; 0.8 by default.
        span: how long to run.
        stepping: how the step is chosen; 200 steps per period by default if the loads repeat.
    """

    scheme: Annotated[str, choice(*SCHEMES)] = "discrete-gradient"
    spectral_radius: Annotated[float | None, number(least=0.0, most=1.0)] = None
    span: Annotated[Span, SPANS] = EquilibriumOnly()
    stepping: Annotated[Stepping, STEPPINGS] = NoStep()

    @classmethod
    def of(cls, **keys: Any) -> Time:
        """Make a time table from its keys in a scene file, such as `duration=1.0, step=1e-3`."""
        return from_keys(cls, keys)

    def changed(self, **keys: Any) -> Time:
        """Give this table with other values of some keys.

        A key that chooses another alternative removes the keys that it excludes: `tolerance`
        removes `steps_per_period`.
        """
        return changed(self, keys)

    @property
    def periods(self) -> int | None:
        """The largest number of periods; None with a duration."""
        return self.span.periods if isinstance(self.span, Periodic) else None

    @property
    def steady_tolerance(self) -> float | None:
        """The change over a period that counts as steady; None with a duration."""
        return self.span.steady_tolerance if isinstance(self.span, Periodic) else None

    @property
    def steady(self) -> str | None:
        """How the reduced model reaches its steady state; None with a duration."""
        return self.span.steady if isinstance(self.span, Periodic) else None

    @property
    def duration(self) -> float | None:
        """The time to run in s; None with loads that repeat."""
        return self.span.duration if isinstance(self.span, Duration) else None

    @property
    def step(self) -> float | None:
        """The fixed step in s; None if the step is chosen otherwise."""
        return self.stepping.step if isinstance(self.stepping, FixedStep) else None

    @property
    def steps_per_period(self) -> int | None:
        """The number of steps in a period; None if the step is chosen otherwise."""
        return self.stepping.steps_per_period if isinstance(self.stepping, StepsPerPeriod) else None

    @property
    def steps_per_revolution(self) -> int | None:
        """The number of steps in a revolution; None if the step is chosen otherwise."""
        found = self.stepping
        return found.steps_per_revolution if isinstance(found, StepsPerRevolution) else None

    @property
    def tolerance(self) -> float | None:
        """The tolerance of an adaptive step; None for a fixed step."""
        return self.stepping.tolerance if isinstance(self.stepping, Tolerance) else None

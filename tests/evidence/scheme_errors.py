"""The errors of the time integration schemes by step size: the evidence for the default scheme.

A model runs to its steady state by every scheme, with every number of steps per period and every
tolerance. Each run is made like a run of a user, whose energy and time step are checked, and
compared with a run of `REFERENCE` steps per period of the discrete gradient, which the other
schemes confirm. Four relative errors are measured
(`Errors`). The order p of error = c h^p is fitted to each of them over the short steps. Every
scheme is of second order where the motion is smooth; a scheme keeps that order at contact events
only if it locates them.

A steady amplitude is read at the steps. Even for an exact motion, the largest value misses the peak
by up to (pi/steps)^2/2. The orders of a scheme are therefore fitted to the displacements at equal
instants: over the last period (`cycle`), and over the first periods from rest (`path`), where no
phase error of the steady state adds up.
"""

from __future__ import annotations

import math
import time as clock
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import numpy as np

from fenicsrom.arrays import Array
from fenicsrom.assess.errors.estimates import step_errors
from fenicsrom.assess.errors.verdicts import check_error
from fenicsrom.errors import AccuracyError, ConvergenceError, ErrorKind, SceneError
from fenicsrom.online.motion.measures import (
    amplitude,
    difference,
    has_settled,
    interpolated,
    is_unsteady,
    peak_normal_force,
)
from fenicsrom.online.motion.motion import Motion, check_energy
from fenicsrom.online.run.simulate import simulate
from fenicsrom.scene import Scene
from fenicsrom.scene.reading.reading import with_time

SCHEMES = ("discrete-gradient", "average-acceleration", "generalised-alpha")
STEPS = (25, 50, 100, 200, 400, 800)  # a period
TOLERANCES = (1e-2, 1e-3, 1e-4)
REFERENCE = 6400  # steps per period of the reference of all runs
PATH = 4  # periods from rest, in which each of the paper's cases slips, and all but one lift off
ASYMPTOTIC = 100  # the order is fitted from this number of steps per period on
CLEAR = (
    3.0  # an error is fitted if it exceeds this multiple of the difference between the references
)
USUAL = 200  # steps per period, the default of a scene
SECOND = 1.8  # a fitted order below this is not called second order


class Errors(NamedTuple):
    """Relative errors of a motion; None where there is nothing to compare.

    Attributes:
        amplitude: error of the printed amplitudes, or of the root mean squares if the motion has
            not settled.
        cycle: error of the displacements at the same instants of the last period, root mean square.
        force: error of the largest normal force of the last period.
        path: error of the displacements at the same instants of the first `PATH` periods, root mean
            square.
    """

    amplitude: float | None = None
    cycle: float | None = None
    force: float | None = None
    path: float | None = None


@dataclass(frozen=True)
class Run:
    """A motion by one scheme.

    Attributes:
        scheme: its name.
        steps: per period; None with a tolerance.
        tolerance: None with a number of steps.
        refused: the reason why there is no result, or why it is rejected; empty if it is accepted.
        kind: kind of the error, if the run is refused.
        errors: errors of the motion, if there is a motion.
        imbalance: relative imbalance of the energy ledger.
        created: the part of the imbalance that is created energy; the rest is lost energy.
        settled: whether its amplitudes repeat.
        steady: whether the motion repeats.
        periods: number of periods run.
        taken: mean number of steps per period.
        seconds: run time of the integration.
    """

    scheme: str
    steps: int | None
    tolerance: float | None
    refused: str = ""
    kind: ErrorKind | None = None
    errors: Errors = field(default_factory=Errors)
    imbalance: float | None = None
    created: float | None = None
    settled: bool | None = None
    steady: bool | None = None
    periods: int | None = None
    taken: float | None = None
    seconds: float | None = None


@dataclass(frozen=True)
class Series:
    """All runs of a model.

    Attributes:
        name: name of the case.
        runs: the runs, ordered by scheme, number of steps and tolerance.
        agreement: the largest errors of the other schemes at `REFERENCE` steps: the uncertainty of
            the errors.
        events: number of changes of the contact state on the path, by kind.
        failure: the reason why there are no runs; empty if there are runs.
    """

    name: str
    runs: tuple[Run, ...] = ()
    agreement: Errors = field(default_factory=Errors)
    events: tuple[tuple[str, int], ...] = ()
    failure: str = ""

    def of(self, scheme: str) -> list[Run]:
        """The runs of a scheme with a number of steps."""
        return [run for run in self.runs if run.scheme == scheme and run.steps is not None]

    def order(self, scheme: str, measure: str) -> float | None:
        """The fitted order of an error, `Errors.<measure>`; None with fewer than three runs."""
        least = CLEAR * (getattr(self.agreement, measure) or 0.0)
        points = [
            (run.steps, error)
            for run in self.of(scheme)
            if run.steps is not None
            and run.steps >= ASYMPTOTIC
            and (run.settled or measure == "path")
            if (error := getattr(run.errors, measure)) is not None and error > least
        ]
        return fitted_order(*zip(*points, strict=True)) if len(points) >= 3 else None


def fitted_order(steps: Sequence[float], errors: Sequence[float]) -> float:
    """The order p in errors = c steps^-p, by least squares of the logarithms."""
    return -float(
        np.polyfit(np.log(np.asarray(steps, float)), np.log(np.asarray(errors, float)), 1)[0]
    )


# ---------------------------------------------------------------------- the runs


def series(
    name: str,
    model: Any,
    scene: Scene,
    steps: Sequence[int] = STEPS,
    tolerances: Sequence[float] = TOLERANCES,
    reference: int = REFERENCE,
) -> Series:
    """Run a model by every scheme.

    Args:
        name: name of the case.
        model: the model, which does not depend on the time integration.
        scene: its scene; the scheme and the steps of its [time] table are replaced.
        steps: numbers of steps per period.
        tolerances: tolerances of adaptive steps.
        reference: number of steps per period of the reference.

    Returns:
        The runs, or a series with the failure: the loads do not repeat, or the reference is
        refused.
    """
    instants = math.gcd(reference, *steps)
    try:
        exact = simulate(model, with_steps(scene, SCHEMES[0], reference))
    except (SceneError, ConvergenceError, AccuracyError) as error:
        return Series(
            name, failure=f"the reference of {reference} steps per period is refused: {error}"
        )
    others = []
    for scheme in SCHEMES[1:]:
        with suppress(ConvergenceError, AccuracyError):
            others.append(
                errors_of(simulate(model, with_steps(scene, scheme, reference)), exact, instants)
            )
    agreement = Errors(
        *(
            max((e for e in column if e is not None), default=None)
            for column in zip(*others, strict=True)
        )
    )
    runs = [
        _run(model, with_steps(scene, scheme, count, tolerance), exact, instants)
        for count, tolerance in [*((n, None) for n in steps), *((None, t) for t in tolerances)]
        for scheme in SCHEMES
    ]
    runs.sort(key=lambda run: (run.steps is None, SCHEMES.index(run.scheme)))
    return Series(name, tuple(runs), agreement, events(exact))


def with_steps(
    scene: Scene, scheme: str, steps: int | None, tolerance: float | None = None
) -> Scene:
    """The scene with another scheme and another number of steps per period, or a tolerance.

    Raises:
        SceneError: the loads do not repeat, so that there is no period.
    """
    given = {"steps_per_period": steps, "tolerance": tolerance}
    chosen = {key: value for key, value in given.items() if value is not None}
    if scene.period is None:
        return with_time(scene, scheme=scheme, **chosen)
    made = with_time(scene, scheme=scheme)
    # a scene file would refuse so few steps that they do not resolve the loads
    return replace(made, time=made.time.changed(**chosen))


def _run(model: Any, scene: Scene, exact: Motion, instants: int) -> Run:
    """A run of a scene, checked like a run of a user, and compared with the exact motion.

    Args:
        model: the model.
        scene: its scene.
        exact: the motion to compare with.
        instants: number of instants per period at which both have a step.
    """
    time = scene.time
    begin = clock.perf_counter()
    try:
        motion = simulate(model, scene)
    except (ConvergenceError, AccuracyError) as error:
        return Run(
            time.scheme,
            time.steps_per_period,
            time.tolerance,
            str(error),
            error.kind,
            seconds=clock.perf_counter() - begin,
        )
    reason = None
    try:
        check_energy(motion)
        check_error(
            scene, "time step", step_errors(model, scene, motion).largest, is_unsteady(motion)
        )
    except AccuracyError as error:
        reason = error
    return Run(
        time.scheme,
        time.steps_per_period,
        time.tolerance,
        str(reason or ""),
        reason.kind if reason else None,
        errors_of(motion, exact, None if time.tolerance is not None else instants),
        motion.relative_imbalance,
        _created(motion),
        has_settled(motion),
        motion.steady,
        motion.periods,
        motion.steps / motion.periods,
        motion.seconds,
    )


def _created(motion: Motion) -> float:
    """Largest created energy, relative as in `Motion.relative_imbalance`."""
    off = motion.imbalance
    most = float(np.max(np.abs(off)))
    return motion.relative_imbalance * max(float(np.max(off)), 0.0) / most if most > 0.0 else 0.0


def errors_of(motion: Motion, exact: Motion, instants: int | None) -> Errors:
    """The errors of a motion against one of many more steps.

    Args:
        motion: the motion.
        exact: the reference motion.
        instants: number of instants per period at which both have a step; None if there are none.
    """
    cycle = path = None
    if instants is not None:
        first = min(PATH, motion.periods, exact.periods)
        path = _apart(_at(motion, 0, first, instants), _at(exact, 0, first, instants))
        if has_settled(motion) and has_settled(exact):
            ends = [_at(m, m.periods - 1, m.periods, instants) for m in (motion, exact)]
            cycle = _apart(*(end - end.mean(axis=0) for end in ends))
    peak = peak_normal_force(exact)
    force = abs(peak_normal_force(motion) / peak - 1.0) if peak > 0.0 else None
    return Errors(
        difference(motion, exact) if np.any(amplitude(exact)) else None, cycle, force, path
    )


def _at(motion: Motion, first: int, last: int, instants: int) -> Array:
    """Displacements (k, P d) at the instants of the periods from first to last, m."""
    assert motion.period is not None
    times = motion.period * np.arange(first * instants + 1, last * instants + 1) / instants
    return interpolated(motion, motion.displacement, times)


def _apart(values: Array, exact: Array) -> float | None:
    """Norm of the difference, relative to the norm of the exact values."""
    size = float(np.linalg.norm(exact))
    return float(np.linalg.norm(values - exact)) / size if size > 0.0 else None


def events(motion: Motion) -> tuple[tuple[str, int], ...]:
    """The number of changes of contact state on the path, by kind."""
    state = motion.state[motion.time <= PATH * (motion.period or np.inf)]
    before, after = state[:-1], state[1:]
    kinds = {
        "changes from stick to slip": (before == 1) & (after == 0),
        "changes from slip to stick": (before == 0) & (after == 1),
        "openings": (before >= 0) & (after < 0),
        "closings": (before < 0) & (after >= 0),
    }
    return tuple((kind, int(np.sum(those))) for kind, those in kinds.items() if np.any(those))

"""Whether a motion can be relied on: each check raises an AccuracyError."""

from __future__ import annotations

from typing import Any

import numpy as np

from fenicsrom.assess.estimates import refined, step_errors
from fenicsrom.errors import AccuracyError
from fenicsrom.online.measures import is_unsteady
from fenicsrom.online.motion import Motion
from fenicsrom.scene import Scene

TIME_ERROR = 0.1  # estimated relative error by the time step above which a motion is refused
UNSETTLED_ERROR = 1.0  # the same of a motion that does not settle, whose root mean squares wander
BASIS_ERROR = (
    0.05  # relative difference from a basis with more derivatives above which a motion is refused
)
ENERGY_ERROR = 1e-2  # relative imbalance of the energy ledger above which a motion is refused


def check_time_error(scene: Scene, estimate: float, wandering: bool = False) -> None:
    """Refuse a motion whose estimated error by the time step is above `TIME_ERROR`;
    `UNSETTLED_ERROR` if it wanders.

    Raises:
        AccuracyError: it is.
    """
    allowed = UNSETTLED_ERROR if wandering else TIME_ERROR
    if estimate <= allowed:
        return
    time = scene.time
    name = next(
        name
        for name in ("tolerance", "steps_per_period", "step")
        if getattr(time, name) is not None
    )
    other = "eight times the tolerance" if name == "tolerance" else "twice the step"
    size = (
        f"an error of about {100.0 * estimate:.2g} %"
        if np.isfinite(estimate)
        else "no motion that settles, or none"
    )
    raise AccuracyError(
        f"time.{name} = {getattr(time, name):g}: the steps are too long: {other} gives {size} "
        f"(at most {100.0 * allowed:g} % is taken as converged{', of a motion that does not settle' if wandering else ''}): "
        f"a richer basis is no help, {name} = {getattr(recommended_step(scene, estimate).time, name):g} is likely enough"
        f"{'' if np.isfinite(estimate) else other_scheme(scene)}"
    )


def other_scheme(scene: Scene) -> str:
    """What to try where a motion does not settle: the end of a sentence."""
    conserves = scene.time.scheme == "discrete-gradient"
    return (
        '; or time.scheme = "generalised-alpha", which damps the waves that the steps do not resolve'
        if conserves
        else ""
    )


def check_basis_error(scene: Scene, estimate: float) -> None:
    """Refuse a motion whose estimated error by the basis is above `BASIS_ERROR`.

    Raises:
        AccuracyError: it is.
    """
    if estimate <= BASIS_ERROR:
        return
    size = (
        f"amplitudes that differ by {100.0 * estimate:.2g} %"
        if np.isfinite(estimate)
        else "no motion that settles"
    )
    raise AccuracyError(
        f"the basis is too poor: with more modes or derivatives it gives {size} (at most {100.0 * BASIS_ERROR:g} % is "
        "taken as converged): lower basis.threshold, or take derivatives = 'all' or more than basis.modes = "
        f"{scene.basis.modes}"
    )


def rejection_reason(model: Any, scene: Scene, motion: Motion) -> AccuracyError | None:
    """Why a motion is not to be relied on, as far as the model alone can tell; None if nothing
    speaks against it.
    """
    try:
        check_energy(motion)
        check_time_error(scene, step_errors(model, scene, motion).amplitude, is_unsteady(motion))
    except AccuracyError as error:
        return error
    return None


def recommended_step(scene: Scene, estimate: float) -> Scene:
    """The scene with its step halved until an error by the time step is likely below half of
    `TIME_ERROR`.

    The error is taken to fall with the step as in a scheme of first order, to which contacts that
    switch may bring it; where no estimate could be made (infinite), a quarter of the step is taken.
    """
    halvings = np.log2(estimate / (0.5 * TIME_ERROR)) if np.isfinite(estimate) else 2.0
    return refined(scene, 2 ** max(1, int(np.ceil(halvings))))

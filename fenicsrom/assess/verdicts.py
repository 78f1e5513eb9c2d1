"""Checks of a finished motion: each raises an AccuracyError with its kind."""

from __future__ import annotations

from typing import Any

import numpy as np

from fenicsrom.assess.estimates import step_errors
from fenicsrom.errors import AccuracyError, ErrorKind
from fenicsrom.online.energy import check_energy
from fenicsrom.online.measures import is_unsteady
from fenicsrom.online.motion import Motion
from fenicsrom.scene import Scene
from fenicsrom.scene.step_size import refined, step_key

# largest accepted relative error of the amplitudes due to the time step
TIME_ERROR = 0.1
# largest accepted relative error of the root mean squares of a motion that does not settle: larger,
# because the root mean squares of an irregular motion depend on when it ends
UNSETTLED_ERROR = 0.3
# largest accepted relative difference of the amplitudes from those of a richer basis
BASIS_ERROR = 0.05


def check_time_error(scene: Scene, estimate: float, unsteady: bool = False) -> None:
    """Refuse a motion whose estimated error due to the time step is too large.

    Args:
        scene: the scene of the motion.
        estimate: the relative error, infinite if there is no estimate.
        unsteady: whether the motion does not settle; the limit is then `UNSETTLED_ERROR` instead of
        `TIME_ERROR`.

    Raises:
        AccuracyError: the estimate is above the limit.
    """
    allowed = UNSETTLED_ERROR if unsteady else TIME_ERROR
    if estimate <= allowed:
        return
    name = step_key(scene)
    given, better = (getattr(s.time, name) for s in (scene, recommended_step(scene, estimate)))
    if np.isfinite(estimate):
        found, other = f"an error of about {100.0 * estimate:.2g} %", ""
    else:
        found = "a motion that does not settle, or no motion"
        other = f"{other_scheme(scene)}; or add modes that the loads may excite, basis.modes"
    raise AccuracyError(
        f"time.{name} = {given:g}: the steps are too long: a run with "
        f"{'eight times the tolerance' if name == 'tolerance' else 'twice the step'} gives {found} "
        f"(at most {100.0 * allowed:g} % is accepted"
        f"{' for a motion that does not settle' if unsteady else ''}): "
        f"try {name} = {better:g}{other}",
        kind=ErrorKind.TIME_STEP,
        key=f"time.{name}",
    )


def other_scheme(scene: Scene) -> str:
    """The end of a sentence: the scheme to try where a motion does not settle, or ""."""
    if scene.time.scheme != "discrete-gradient":
        return ""
    return (
        '; or try time.scheme = "generalised-alpha", which damps the waves that the steps do not '
        "resolve"
    )


def check_basis_error(scene: Scene, estimate: float) -> None:
    """Refuse a motion whose estimated error due to the basis is above `BASIS_ERROR`.

    Raises:
        AccuracyError: the error is above the limit.
    """
    if estimate <= BASIS_ERROR:
        return
    found = (
        f"amplitudes that differ by {100.0 * estimate:.2g} %"
        if np.isfinite(estimate)
        else "a motion that does not settle"
    )
    raise AccuracyError(
        f"the basis is too small: a basis with more modes or derivatives gives {found} "
        f"(at most {100.0 * BASIS_ERROR:g} % is accepted): lower basis.threshold, set "
        f'basis.derivatives = "all", or set basis.modes above {scene.basis.modes}',
        kind=ErrorKind.BASIS,
        key="basis",
    )


def checked(
    model: Any, scene: Scene, motion: Motion
) -> tuple[dict[str, float], AccuracyError | None]:
    """Check the energy balance of a motion, and estimate its error due to the time step.

    Args:
        model: the model that was integrated.
        scene: the scene of the motion.
        motion: the motion.

    Returns:
        Estimated relative errors by their names, of "time step" and, with contacts, of "peak force
        by the time step"; and the error of the check that the motion fails, or None.
    """
    errors: dict[str, float] = {}
    try:
        check_energy(motion)
        errors["time step"], force = step_errors(model, scene, motion)
        if scene.contacts:
            errors["peak force by the time step"] = force
        check_time_error(scene, errors["time step"], is_unsteady(motion))
    except AccuracyError as error:
        return errors, error
    return errors, None


def rejection_reason(model: Any, scene: Scene, motion: Motion) -> AccuracyError | None:
    """The error of a motion that `checked` rejects, or None."""
    return checked(model, scene, motion)[1]


def recommended_step(scene: Scene, estimate: float) -> Scene:
    """The scene with a step that likely brings the error below half of `TIME_ERROR`.

    The number of halvings assumes a scheme of first order, because contacts that switch may reduce
    the order to one. If the estimate is infinite, the step is halved twice.
    """
    halvings = np.log2(estimate / (0.5 * TIME_ERROR)) if np.isfinite(estimate) else 2.0
    return refined(scene, 2 ** max(1, int(np.ceil(halvings))))

"""The error due to the basis, measured against the full model, beside its estimate."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from fenicsrom.arrays import Array
from fenicsrom.assess.errors.estimates import MotionErrors, distances
from fenicsrom.errors import ConvergenceError
from fenicsrom.online.model.model import ReducedModel
from fenicsrom.online.model.problem import Problem
from fenicsrom.online.motion.motion import Motion
from fenicsrom.online.periodic.periodic_record import motion_of
from fenicsrom.online.periodic.shooting import Shooting, solve, start_variables
from fenicsrom.online.run.march import end_of
from fenicsrom.online.run.simulate import simulate
from fenicsrom.scene import Scene
from fenicsrom.scene.reading.step_size import with_time
from fenicsrom.words import counted

NOTABLE = 0.01  # an error against the full model must be seen if it is larger
MISSED = 3.0  # times its estimate: an error that was not seen
FULL_PERIODS = 20  # of a full model that starts from the periodic motion of the reduced model


def estimates_found(own: Mapping[str, MotionErrors]) -> dict[str, float]:
    """The estimates of a run by the names of a `fenicsrom.assess.studies.stability.Finding`.

    A finding compares motions at the frequency of the loads, also near a resonance.
    """
    found: dict[str, float] = {}
    if "time step" in own:
        found["estimate"] = max(own["time step"].amplitude, own["time step"].at_frequency)
        found["force_estimate"] = own["time step"].peak_force
    if "basis" in own:
        found["basis_estimate"] = own["basis"].amplitude
    return found


def full_distances(vectors: Array, solid: Any, scene: Scene, motion: Motion) -> MotionErrors:
    """The true errors due to the basis: the distances from the full model at the same time steps.

    The full model starts where the motion ended, if Newton's method found it, and then runs at most
    `FULL_PERIODS`.

    Args:
        vectors: (local, n) vectors of the reduced basis.
        solid: the solid.
        scene: the scene.
        motion: the motion of the reduced model.
    """
    from fenicsrom.fem.full.full import full_model

    start = None
    if motion.newton_from is not None and not motion.buckled and not scene.wears:
        q, v, sliders = end_of(motion)
        start = vectors @ q, vectors @ v, sliders
        scene = with_time(scene, periods=FULL_PERIODS)
    return distances(motion, simulate(full_model(solid), scene, start=start))


def settled_full_motion(
    solid: Any, vectors: Array, model: ReducedModel, scene: Scene, motion: Motion, full: Motion
) -> tuple[Motion, str]:
    """The periodic motion of a full model whose march did not settle, and a sentence on it.

    Newton's method starts it from the periodic motion of the reduced model
    (`fenicsrom.assess.full.full_periodic`). Where the march decays slowly, for example near an
    undamped mode, the march alone would compare a periodic motion with a transient.

    Args:
        solid: the solid.
        vectors: (local, n) vectors of the reduced basis.
        model: the reduced model.
        scene: the scene of both motions.
        motion: the motion of the reduced model.
        full: the marched motion of the full model.

    Returns:
        The motion, and a sentence. The motion is the marched one, and the sentence is empty, if the
        march has settled or Newton's method did not find the reduced motion.
    """
    from fenicsrom.assess.full.full_periodic import full_periodic_motion

    is_found = motion.newton_from is not None and motion.steady and not scene.wears
    if full.steady or not is_found or full.period is None:
        return full, ""
    assert motion.search is not None
    shooting = Shooting(Problem.of(model, scene).settled(), motion.search.periods)
    begin = f"the march of the full model did not settle within {counted(full.periods, 'period')}"
    try:
        reduced = solve(shooting, shooting.scaled(start_variables(shooting, motion.end)))
        found = full_periodic_motion(solid, vectors, shooting, reduced)
    except ConvergenceError as error:
        return full, f"{begin}; Newton's method did not find its periodic motion either: {error}"
    seconds, periods = full.seconds + found.seconds, full.periods + found.periods
    periodic = motion_of(found.record, reduced.period)
    periodic = replace(periodic, seconds=seconds, periods=periods)
    return periodic, (
        f"{begin}; its periodic motion was found by Newton's method in "
        f"{counted(found.periods, 'period')} from that of the reduced model, and its stability was "
        "not examined"
    )


def missed(error: float, estimate: float) -> str:
    """The reason why an estimate counts as too small for its true error, or ""."""
    if error <= max(NOTABLE, MISSED * estimate):
        return ""
    return f"the error against the full model is {error:.1e}, but the estimate is {estimate:.1e}"

"""The error due to the basis, measured against the full model, beside its estimate."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from fenicsrom.assess.errors.estimates import MotionErrors, distances
from fenicsrom.online.model.model import ReducedModel
from fenicsrom.online.motion.motion import Motion
from fenicsrom.online.run.march import end_of
from fenicsrom.online.run.simulate import simulate
from fenicsrom.scene import Scene
from fenicsrom.scene.step_size import with_time

if TYPE_CHECKING:
    from fenicsrom.reduction.stages import Reduction

NOTABLE = 0.01  # an error against the full model must be seen if it is larger
MISSED = 3.0  # times its estimate: an error that was not seen
FULL_PERIODS = 20  # of a full model that starts from the periodic motion of the reduced model


def candidates_of(reduction: Reduction | None, solid: Any, scene: Scene) -> ReducedModel | None:
    """The larger model that judges the basis of a reduced model; None for another model."""
    from fenicsrom.reduction.candidates import candidate_model

    return None if reduction is None else candidate_model(solid, scene.basis, reduction)


def estimates_found(own: Mapping[str, MotionErrors]) -> dict[str, float]:
    """The estimates of a run by the names of a `fenicsrom.assess.studies.stability.Finding`."""
    found: dict[str, float] = {}
    if "time step" in own:
        found["estimate"] = own["time step"].amplitude
        found["force_estimate"] = own["time step"].peak_force
    if "basis" in own:
        found["basis_estimate"] = own["basis"].amplitude
    return found


def full_distances(reduction: Reduction, solid: Any, scene: Scene, motion: Motion) -> MotionErrors:
    """The true errors due to the basis: the distances from the full model at the same time steps.

    The full model starts where the motion ended, if Newton's method found it, and then runs at most
    `FULL_PERIODS`.

    Args:
        reduction: the stages of the reduced model.
        solid: the solid.
        scene: the scene.
        motion: the motion of the reduced model.
    """
    from fenicsrom.fem.full.full import full_model

    start = None
    if motion.newton_from is not None and not motion.buckled:
        q, v, sliders = end_of(motion)
        start = reduction.basis.vectors @ q, reduction.basis.vectors @ v, sliders
        scene = with_time(scene, periods=FULL_PERIODS)
    return distances(motion, simulate(full_model(solid), scene, start=start))


def missed(error: float, estimate: float) -> str:
    """The reason why an estimate counts as too small for its true error, or ""."""
    if error <= max(NOTABLE, MISSED * estimate):
        return ""
    return f"the error against the full model is {error:.1e}, but the estimate is {estimate:.1e}"

"""Estimates of the error of a motion by its time step and by its basis."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from fenicsrom.study import Study

from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from fenicsrom.arrays import Array
from fenicsrom.errors import AccuracyError, ConvergenceError, SceneError
from fenicsrom.online.measures import amplitude, at_rest, has_settled, peak_normal_force, rms
from fenicsrom.online.motion import Motion
from fenicsrom.online.simulate import simulate
from fenicsrom.reduction.basis import ReducedBasis
from fenicsrom.reduction.derivatives import all_pairs
from fenicsrom.reduction.modes import component_modes
from fenicsrom.reduction.selection import Selection
from fenicsrom.reduction.stages import Derivatives, differentiate, enrich
from fenicsrom.scene import Scene

PHASES = 200  # at which two periods are compared


def refined(scene: Scene, factor: int = 2) -> Scene:
    """The scene with its step divided (or its tolerance, by the factor to the power 3)."""
    time = scene.time
    if time.tolerance is not None:
        return replace(scene, time=replace(time, tolerance=time.tolerance / factor**3))
    if time.steps_per_period is not None:
        return replace(scene, time=replace(time, steps_per_period=time.steps_per_period * factor))
    assert time.step is not None
    return replace(scene, time=replace(time, step=time.step / factor))


def coarser(scene: Scene) -> Scene:
    """The scene with twice its step (at most its duration) or eight times its tolerance, more than
    a scene may ask for.
    """
    time = scene.time
    if time.tolerance is not None:
        return replace(scene, time=replace(time, tolerance=8.0 * time.tolerance))
    if time.steps_per_period is not None:
        return replace(
            scene, time=replace(time, steps_per_period=max(time.steps_per_period // 2, 2))
        )
    assert time.step is not None
    assert time.duration is not None
    return replace(scene, time=replace(time, step=min(2.0 * time.step, time.duration)))


class StepErrors(NamedTuple):
    """Estimates of relative errors by the time step.

    Attributes:
        amplitude: of the amplitudes of a motion that has settled, of the root mean squares of one
            that has not, or that has no period; infinite if no other motion could be had.
        peak_force: of the largest normal force; infinite too where the step does not resolve the
            contact.
    """

    amplitude: float
    peak_force: float


def step_errors(model: Any, scene: Scene, motion: Motion) -> StepErrors:
    """Estimate the errors of a motion by its time step, from a run with twice the step.

    Amplitudes are compared where both settle, else root mean squares: of a run of a duration, over
    what it recorded. They are twice the difference: six times the error of a scheme of second
    order, twice that of one of first order, to which the switching of contacts may bring it.
    Impacts make amplitudes jump to and fro as the step changes: that of the amplitudes is at least
    a third of the distance between the last periods. Peaks of the force that a stiff contact has
    within a few steps mean nothing: their error is unknown where the mean force leans half-way to
    the end of the step (`fenicsrom.online.contact_step.lean_to_the_end`).

    Args:
        model: that was integrated.
        scene: of the motion.
        motion: the motion.
    """
    coarse = coarser(scene)
    if coarse.time == scene.time and not at_rest(
        motion
    ):  # a single step: there is none to compare with
        return StepErrors(np.inf, np.inf)
    try:
        other = simulate(model, coarse)
    except (ConvergenceError, AccuracyError):
        return StepErrors(np.inf, np.inf)
    if at_rest(motion) and at_rest(other):
        return StepErrors(0.0, 0.0)
    since = float(motion.time[0])  # what a resumed run recorded
    peak, resolved = (
        peak_normal_force(motion),
        motion.end is None or np.all(motion.end.state.trial.scratch.blending < 0.5),
    )
    apart = 2.0 * abs(peak - peak_normal_force(other, since))
    force = 0.0 if peak == apart == 0.0 else apart / peak if resolved and peak > 0.0 else np.inf
    if not has_settled(motion):
        ours, theirs = rms(motion), rms(other, since)
        size, apart = float(np.linalg.norm(ours)), float(np.linalg.norm(ours - theirs))
        return StepErrors(2.0 * apart / size if size > 0.0 else 0.0, force)
    if not has_settled(other):
        return StepErrors(np.inf, force)
    size = float(np.linalg.norm(amplitude(motion)))
    apart = 2.0 * float(np.linalg.norm(amplitude(motion) - amplitude(other)))
    shape, other_shape = _last_period(motion), _last_period(other)
    distance = float(np.linalg.norm(shape - other_shape))
    shape_size = float(np.linalg.norm(shape - shape.mean(axis=0)))
    return StepErrors(
        max(apart / size, distance / (3.0 * shape_size)) if size > 0.0 else 0.0, force
    )


def _last_period(motion: Motion) -> Array:
    """Displacements (`PHASES`, P d) at equal phases of the last period, m."""
    assert motion.period is not None
    part = motion.last_period()
    phases = motion.time[-1] - motion.period * np.arange(PHASES) / PHASES
    columns = motion.displacement[part].reshape(-1, motion.displacement[0].size).T
    return np.array([np.interp(phases, motion.time[part], column) for column in columns]).T


MORE_MODES = 2  # that a basis is completed by where it has all derivatives
MORE_DERIVATIVES = 15  # that a basis is completed by, at most, to see whether it was rich enough


def complete(study: Study, buckled: bool = False) -> ReducedBasis | None:
    """A richer basis to compare with; None if none is of use.

    With more of the derivatives that were left out, the heaviest first; if none were, or the
    preload has buckled the model and so taken it far from the state that the basis is about, with
    `MORE_MODES` more normal modes and all derivatives.
    """
    if not study.scene.geometrically_nonlinear:
        return None
    kept = study.derivatives.labels
    weights = study.selection.weights
    missing = sorted(
        set(all_pairs(study.modes.labels)) - set(kept),
        key=lambda label: (-weights.get(label, 0.0), label),
    )
    if buckled or not missing:
        return more_modes(study)
    more = differentiate(
        study.solid, study.scene.basis, study.modes, tuple(missing[:MORE_DERIVATIVES])
    )
    vectors = np.concatenate([study.derivatives.vectors, more.vectors], axis=1)
    try:
        return enrich(
            study.solid, study.modes, study.selection, Derivatives((*kept, *more.labels), vectors)
        )
    except AccuracyError:  # they depend on those that are there: nothing to learn from them
        return None


def more_modes(study: Study) -> ReducedBasis | None:
    """The basis of `MORE_MODES` more normal modes, with all derivatives; None if the body has no
    more.
    """
    wanted = study.scene.basis
    try:
        modes = component_modes(study.solid, replace(wanted, modes=wanted.modes + MORE_MODES))
        selection = Selection(modes.labels, tuple(all_pairs(modes.labels)), {}, {})
        return enrich(
            study.solid,
            modes,
            selection,
            differentiate(study.solid, wanted, modes, selection.derivatives),
        )
    except (AccuracyError, SceneError):
        return None


def basis_error(richer: Any, scene: Scene, motion: Motion) -> float:
    """Estimate of the relative error of a settled motion by its basis: how far the amplitudes of a
    richer model are from its.

    And how far the displacement it starts with, where the preload has buckled it. Infinite if that
    does not settle.

    Raises:
        ConvergenceError: the richer model fails.
    """
    other = simulate(richer, scene)
    if not has_settled(other):
        return float("inf")
    apart = 0.0
    if not (at_rest(motion) and at_rest(other)):
        size = float(np.linalg.norm(amplitude(other)))
        apart = (
            float(np.linalg.norm(amplitude(motion) - amplitude(other))) / size
            if size > 0.0
            else float("inf")
        )
    if motion.buckled or other.buckled:  # how far it has buckled too
        start, other_start = motion.displacement[0], other.displacement[0]
        apart = max(apart, float(np.linalg.norm(start - other_start) / np.linalg.norm(other_start)))
    return apart

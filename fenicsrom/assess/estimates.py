"""Estimates of the error of a motion due to its time step and due to its basis."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from fenicsrom.arrays import Array
from fenicsrom.errors import AccuracyError, ConvergenceError, SceneError
from fenicsrom.online.march import end_of
from fenicsrom.online.measures import (
    amplitude,
    at_rest,
    has_settled,
    interpolated,
    peak_normal_force,
    rms,
    times_before_end,
)
from fenicsrom.online.motion import Motion
from fenicsrom.online.simulate import simulate
from fenicsrom.reduction.basis import ReducedBasis
from fenicsrom.reduction.derivatives import all_pairs
from fenicsrom.reduction.modes import ComponentModes, component_modes
from fenicsrom.reduction.selection import Selection
from fenicsrom.reduction.stages import Derivatives, differentiate, enrich
from fenicsrom.scene import Scene
from fenicsrom.scene.step_size import coarser
from fenicsrom.scene.times import Periodic

if TYPE_CHECKING:
    from fenicsrom.reduction.protocols import Structure

PHASES = 200  # instants at which two periods are compared
CHECK_PERIODS = 18  # of a check that starts from the motion: room for two of 8 periods of the loads
MORE_MODES = 2  # normal modes added to a basis that has all derivatives of its modes
MORE_DERIVATIVES = 15  # largest number of derivatives added to a basis


class StepErrors(NamedTuple):
    """Estimates of relative errors due to the time step.

    Attributes:
        amplitude: error of the amplitudes if the motion has settled, otherwise of the root mean
            squares; infinite if the run with twice the step failed.
        peak_force: error of the largest normal force; also infinite where the step does not resolve
            the contact.
    """

    amplitude: float
    peak_force: float


def step_errors(model: Any, scene: Scene, motion: Motion) -> StepErrors:
    """Estimate the errors of a motion due to its time step, from a run with twice the step.

    The estimate is twice the difference of the amplitudes if both motions settle, and otherwise
    twice the difference of the root mean squares. The estimate is six times the error of a scheme
    of second order. It is twice the error of a scheme of first order; contacts that switch may
    reduce the order to one. Impacts may make the difference of the amplitudes small by chance. The
    estimate is therefore at least a third of the distance between the last periods of both runs. If
    a stiff contact lasts only a few steps, its peak force is not resolved. The error of this force
    counts as unknown if a contact has a blending weight of a half or more
    (`fenicsrom.online.contact_step`).

    Args:
        model: the model that was integrated.
        scene: the scene of the motion.
        motion: the motion.
    """
    coarse = coarser(scene)
    if coarse.time == scene.time and not at_rest(motion):
        return StepErrors(np.inf, np.inf)  # a single step cannot be made longer
    try:
        other = check_motion(model, coarse, motion)
    except (ConvergenceError, AccuracyError):
        return StepErrors(np.inf, np.inf)
    if at_rest(motion) and at_rest(other):
        return StepErrors(0.0, 0.0)
    force = _force_error(motion, other)
    if not has_settled(motion):
        ours, theirs = rms(motion), rms(other, _start(motion))
        size, apart = float(np.linalg.norm(ours)), float(np.linalg.norm(ours - theirs))
        return StepErrors(2.0 * apart / size if size > 0.0 else 0.0, force)
    if not has_settled(other):
        return StepErrors(np.inf, force)
    return StepErrors(_amplitude_error(motion, other), force)


def check_motion(
    model: Any, scene: Scene, motion: Motion, start: tuple[Array, ...] | None = None
) -> Motion:
    """A motion of another model, or with other steps, that checks a motion.

    If Newton's method found the motion, the check starts where it ended, and Newton's method finds
    its motion at once. Otherwise, and where this does not succeed within `CHECK_PERIODS`, the check
    runs like the motion, from rest.

    Args:
        model: the model of the check.
        scene: the scene of the check.
        motion: the motion to be checked.
        start: the end of the motion in the coordinates of the model: displacement and velocity
            (n,) and sliders (P, d); by default the models have the same coordinates.

    Raises:
        ConvergenceError: the smallest step did not converge.
        AccuracyError: the energy balance is off.
    """
    approaching = any(contact.approach for contact in scene.contacts)
    if motion.newton_from is not None and motion.steady and not approaching:
        assert isinstance(scene.time.span, Periodic)
        span = replace(scene.time.span, periods=CHECK_PERIODS)
        short = replace(scene, time=replace(scene.time, span=span))
        try:
            other = simulate(model, short, start=motion if start is None else start)
        except (ConvergenceError, AccuracyError):
            return simulate(model, scene)
        if other.newton_from is not None and other.steady:
            return other
    return simulate(model, scene)


def _start(motion: Motion) -> float:
    """Time of the first record, s: above 0 if the run was resumed."""
    return float(motion.time[0])


def _force_error(motion: Motion, other: Motion) -> float:
    """Estimated relative error of the largest normal force, infinite where it is not resolved."""
    peak = peak_normal_force(motion)
    apart = 2.0 * abs(peak - peak_normal_force(other, _start(motion)))
    if peak == apart == 0.0:
        return 0.0
    resolved = motion.end is None or np.all(motion.end.state.trial.scratch.blending < 0.5)
    return apart / peak if resolved and peak > 0.0 else np.inf


def _amplitude_error(motion: Motion, other: Motion) -> float:
    """Estimated relative error of the amplitudes, if both motions have settled."""
    size = float(np.linalg.norm(amplitude(motion)))
    if not size > 0.0:
        return 0.0
    apart = 2.0 * float(np.linalg.norm(amplitude(motion) - amplitude(other)))
    shape, other_shape = _last_period(motion), _last_period(other)
    distance = float(np.linalg.norm(shape - other_shape))
    shape_size = float(np.linalg.norm(shape - shape.mean(axis=0)))
    return max(apart / size, distance / (3.0 * shape_size))


def _last_period(motion: Motion) -> Array:
    """Displacements (`PHASES`, P d) at equal phases of the last period, m."""
    times = times_before_end(motion, np.arange(PHASES) / PHASES)
    return interpolated(motion, motion.displacement, times)


def richer_basis(
    body: Structure,
    scene: Scene,
    modes: ComponentModes,
    selection: Selection,
    derivatives: Derivatives,
    buckled: bool = False,
) -> ReducedBasis | None:
    """A richer basis to compare with, or None if there is none.

    The richer basis adds the derivatives that were left out, the largest weights first. In two
    cases it has `MORE_MODES` more normal modes and all derivatives instead: no derivative was left
    out, or the preload has buckled the model and moved it far from the state of its basis.

    Args:
        body: the structure.
        scene: its scene.
        modes: the component modes of the basis.
        selection: the modes and derivatives that were selected.
        derivatives: the derivatives of the basis.
        buckled: whether the preload has buckled the model.
    """
    if not scene.geometrically_nonlinear:
        return None
    kept = derivatives.labels
    weights = selection.weights
    missing = sorted(
        set(all_pairs(modes.labels)) - set(kept),
        key=lambda label: (-weights.get(label, 0.0), label),
    )
    if buckled or not missing:
        return _with_more_modes(body, scene, modes.omega.size + MORE_MODES)
    more = differentiate(body, scene.basis, modes, tuple(missing[:MORE_DERIVATIVES]))
    vectors = np.concatenate([derivatives.vectors, more.vectors], axis=1)
    try:
        return enrich(body, modes, selection, Derivatives((*kept, *more.labels), vectors))
    except AccuracyError:  # the new vectors depend on those of the basis
        return None


def _with_more_modes(body: Structure, scene: Scene, count: int) -> ReducedBasis | None:
    """The basis of so many normal modes with all derivatives; None if there are none."""
    wanted = scene.basis
    try:
        modes = component_modes(body, replace(wanted, modes=count))
        selection = Selection(modes.labels, tuple(all_pairs(modes.labels)), {}, {})
        derivatives = differentiate(body, wanted, modes, selection.derivatives)
        return enrich(body, modes, selection, derivatives)
    except (AccuracyError, SceneError):
        return None


def start_in(
    body: Structure, basis: ReducedBasis, richer: ReducedBasis, motion: Motion
) -> tuple[Array, ...] | None:
    """The end of a motion in the coordinates of a richer basis, by projection in the mass norm.

    Args:
        body: the structure.
        basis: the basis of the motion.
        richer: the richer basis.
        motion: the motion.

    Returns:
        Displacement and velocity (n,) and sliders (P, d); None for a motion that was marched or
        has buckled, because its check starts from rest.
    """
    if motion.newton_from is None or motion.buckled:
        return None
    gram = body.mass_inner(richer.vectors, richer.vectors)
    across = np.linalg.solve(gram, body.mass_inner(richer.vectors, basis.vectors))
    q, v, sliders = end_of(motion)
    return across @ q, across @ v, sliders


def basis_error(
    richer: Any, scene: Scene, motion: Motion, start: tuple[Array, ...] | None = None
) -> float:
    """Estimate the relative error of a settled motion due to its basis.

    The estimate is the relative distance of the amplitudes from those of a richer model. If the
    preload has buckled the model, the distance of the initial displacements counts too.

    Args:
        richer: a model with a richer basis.
        scene: the scene of the motion.
        motion: the motion.
        start: the end of the motion in the coordinates of the richer model (`start_in`), from which
            the check starts; from rest if None.

    Returns:
        The relative error, infinite if the richer model does not settle.

    Raises:
        ConvergenceError: the richer model fails.
    """
    if start is None:
        other = simulate(richer, scene)
    else:
        other = check_motion(richer, scene, motion, start)
    if not has_settled(other):
        return float("inf")
    apart = 0.0
    if not (at_rest(motion) and at_rest(other)):
        size = float(np.linalg.norm(amplitude(other)))
        difference = float(np.linalg.norm(amplitude(motion) - amplitude(other)))
        apart = difference / size if size > 0.0 else float("inf")
    if motion.buckled or other.buckled:
        start, other_start = motion.displacement[0], other.displacement[0]
        apart = max(apart, float(np.linalg.norm(start - other_start) / np.linalg.norm(other_start)))
    return apart

"""The contact problem of a time step: semismooth Newton, then nonlinear Gauss-Seidel.

The unknowns are the contact displacements x at the end of the step. With the contact displacement
x_free without contact forces, the mean contact force F(x) over the step and the Delassus operator
G (contact displacement by contact force),

    x + G F(x) = x_free.                                                                        (1)

Equation (1) is one Newton iteration of the step, condensed to the contact displacements. In it,
everything except the contact is linear, so the contact is solved in full. It is solved for the c
candidates only, the points that touch or may touch (`fenicsrom.online.contact.candidates`).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from fenicsrom.arrays import Array
from fenicsrom.online.contact.compliance import Compliance, form_delassus, is_formed
from fenicsrom.online.contact.friction import friction_limits, kept_part, positive
from fenicsrom.online.contact.law import contact_force, force_over_step, trial_normal_force
from fenicsrom.online.contact.semismooth_newton import semismooth_newton
from fenicsrom.online.contact.state import ContactStep
from fenicsrom.online.contact.surfaces import advect_with_surface, gap_discrete_gradient
from fenicsrom.online.kernels.compiled import kernel

CONTACT_ROUNDS = 100  # rounds of Gauss-Seidel and Newton before the step is rejected
SWEEPS = 10  # Gauss-Seidel sweeps of a round
BISECTIONS = 100


@kernel
def solve_contact(
    step: ContactStep, candidates: NDArray[np.int64], compliance: Compliance, free: Array
) -> bool:
    """Solve (1) by semismooth Newton, restarted from Gauss-Seidel where it cycles between states.

    Args:
        step: the step of P points. `end.x` holds a first guess on entry, and the displacement at
            the end of the step on exit; out: `scratch.mean_force` (P, d) over the step.
        candidates: (c,) the points to solve for; entries of other points are not used.
        compliance: gives G of these points, m/N.
        free: (P, d) x_free, m.

    Returns:
        True if the residual or the update fell to rounding; False if no round found a solution.
    """
    scratch, d = step.scratch, len(step.scratch.space)
    for p in candidates:
        for k in range(d):
            scratch.guess[p, k] = step.end.x[p, k]
    for attempt in range(1 + CONTACT_ROUNDS):
        if attempt == 1 and not is_formed(compliance, candidates.size * d):
            directions = scratch.directions[: candidates.size * d]
            form_delassus(compliance.rows, compliance, directions)
        if attempt > 0:
            nonlinear_gauss_seidel(step, candidates, compliance.delassus, free, attempt == 1)
        if semismooth_newton(step, candidates, compliance, free):
            return True
    return False


@kernel
def nonlinear_gauss_seidel(
    step: ContactStep, candidates: NDArray[np.int64], delassus: Array, free: Array, first: bool
) -> None:
    """Ten sweeps over all candidates, from `scratch.guess`.

    The first round takes the forces at the guess; later rounds continue from the last forces.
    """
    end, scratch, d = step.end, step.scratch, len(step.scratch.space)
    for p in candidates:
        for k in range(d):
            end.x[p, k] = scratch.guess[p, k]
        if first:
            contact_force(step, p, True)
            for k in range(d):
                scratch.held_force[p, k] = scratch.mean_force[p, k]
                scratch.held_friction[p, k] = scratch.mean_friction[p, k]
    for _ in range(SWEEPS):
        for place in range(candidates.size):
            solve_point(step, candidates, delassus, free, place)
    for p in candidates:
        for k in range(d):
            scratch.guess[p, k] = end.x[p, k]


@kernel
def _bisect_normal_force(step: ContactStep, delassus: Array, p: int, row: int) -> float:
    """Normal force of point p, N, with its friction and the forces of the others held.

    The displacement is x = rest - G (N n + T + start_weight N0 n0), with the rest in `point.place`,
    n in `point.mean_normal` and the block of `delassus` at `row`. The solution N lies between zero
    and the normal force that the law gives at N = 0.
    """
    interval, scratch, d = step.interval, step.scratch, len(step.scratch.space)
    x, friction = step.end.x[p], scratch.held_friction[p]
    n, rest = scratch.point.mean_normal, scratch.point.place
    a = 0.0 if interval.discrete_gradient else interval.start_weight
    theta = 1.0 - interval.start_weight
    low, high, force = 0.0, 0.0, 0.0
    for bisection in range(1 + BISECTIONS):
        force = 0.0 if bisection == 0 else 0.5 * (low + high)
        for k in range(d):
            x[k] = rest[k]
            for j in range(d):
                total = force * n[j] + friction[j] + a * step.start.normal[p, j]
                x[k] -= delassus[row + k, row + j] * total
        after = trial_normal_force(step.contacts, p, x, interval.end)
        if interval.discrete_gradient:
            found, _ = force_over_step(step, p, after)
        else:
            found = theta * positive(after)
        if bisection == 0:
            high = found
        elif found > force:
            low = force
        else:
            high = force
    return force


@kernel
def _project_friction(step: ContactStep, delassus: Array, p: int, row: int, force: float) -> None:
    """Write the friction of point p, a force on the disc of radius mu `force`, to `held_friction`.

    Friction is taken at the weighted point, with the initial stretch, the limits and the fraction
    of contact of `online.contact.friction`. This friction is close to the mean along the path, so
    Newton's iteration then finds the solution.
    """
    contacts, start, scratch = step.contacts, step.start, step.scratch
    interval, point, d = step.interval, scratch.point, len(scratch.space)
    x, x0, friction = step.end.x[p], start.x[p], scratch.held_friction[p]
    kt, mu = contacts.tangential_stiffness[p], contacts.friction[p]
    before = start.trial_normal_force[p]
    a, theta = interval.start_weight, 1.0 - interval.start_weight
    n, trial = point.mean_normal, point.slip_force
    stretch0, stretch = point.start_stretch, point.end_stretch
    until = interval.begin + theta * (interval.end - interval.begin)
    advect_with_surface(contacts, p, interval.begin, until, start.slider[p], stretch)
    softness, size, across, across0 = 0.0, 0.0, 0.0, 0.0
    for k in range(d):
        softness += delassus[row + k, row + k]  # an upper bound for every direction
        stretch[k] = a * x0[k] + theta * x[k] - stretch[k]
        size += n[k] ** 2
    for k in range(d):
        across += n[k] * stretch[k] / size
        across0 += n[k] * (x0[k] - start.slider[p, k]) / size
    for k in range(d):
        stretch0[k] = x0[k] - start.slider[p, k] - across0 * n[k]
        stretch[k] -= across * n[k]
    limit, fraction, kept = mu * force, 1.0, 1.0
    if not interval.discrete_gradient:
        limit = mu * (force + a * positive(before))
    elif force > 0.0:
        after = trial_normal_force(contacts, p, x, interval.end)
        limits = friction_limits(mu, before, after, force, 0.0, scratch.blending[p])
        fraction = limits.fraction
        kept, _ = kept_part(kt, stretch0, limits.first)
    softness *= fraction * fraction * theta
    total = 0.0
    for k in range(d):
        middle = kept * stretch0[k] + fraction * (stretch[k] - stretch0[k])
        trial[k] = (fraction * middle + softness * friction[k]) / (1.0 / kt + softness)
        total += trial[k] ** 2
    total = np.sqrt(total)
    factor = limit / total if total > limit else 1.0
    for k in range(d):
        friction[k] = factor * trial[k]


@kernel
def solve_point(
    step: ContactStep, candidates: NDArray[np.int64], delassus: Array, free: Array, place: int
) -> None:
    """Solve one candidate with the forces of the others held: its normal force, then its friction.

    This iteration is slow, but it does not cycle between states. The reason is that it projects the
    tangential force itself on the friction disc. A tangential force computed from the displacement
    could be far too large while the normal force is still wrong.
    """
    interval, start, scratch = step.interval, step.start, step.scratch
    d, p = len(scratch.space), candidates[place]
    x, held, point, row = step.end.x[p], scratch.held_force[p], scratch.point, place * d
    n, bend, rest = point.mean_normal, point.mean_normal_derivative, point.place
    for k in range(d):
        rest[k] = free[p, k]
        for other in range(candidates.size):
            if other != place:
                for j in range(d):
                    force = scratch.held_force[candidates[other], j]
                    rest[k] -= delassus[row + k, other * d + j] * force
    if interval.discrete_gradient:
        first, time, a = start.x[p], 0.5 * (interval.begin + interval.end), 0.0
    else:
        first, time, a = x, interval.end, interval.start_weight
    gap_discrete_gradient(step.contacts, p, first, x, time, n, bend, point.work)
    force = _bisect_normal_force(step, delassus, p, row)
    _project_friction(step, delassus, p, row, force)
    for k in range(d):
        held[k] = force * n[k] + scratch.held_friction[p, k] + a * start.normal[p, k]
    for k in range(d):
        x[k] = rest[k]
        for j in range(d):
            x[k] -= delassus[row + k, row + j] * held[j]

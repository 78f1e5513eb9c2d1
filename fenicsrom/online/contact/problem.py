"""The contact problem of a time step: semismooth Newton, then nonlinear Gauss-Seidel.

The unknowns are the contact displacements x at the end of the step. With the contact displacement
x_free under known contact forces F0, the mean contact force F(x) over the step and the Delassus
operator G (contact displacement by contact force),

    x + G (F(x) - F0) = x_free.                                                                 (1)

A time step takes the forces at its start as F0: the response of a piece that contact alone holds to
the whole force would be so large that the digits of x cancelled.

Equation (1) is one Newton iteration of the step, condensed to the contact displacements. In it,
everything except the contact is linear, so the contact is solved in full. It is solved for the c
candidates only, the points that touch or may touch.

How the displacements of contact points respond to forces at them: the Delassus operator.

With the rows R (m, n) of the contact displacements, forces F move the coordinates by -Z F and the
contact displacements by -G F,

    Z = S^-1 R^T,    G = R Z,                                                                   (2)

where S is the effective stiffness of the step. For more forces than coordinates, G has no full
rank and is not formed. Newton's equation (I + G F') u = -r, with the derivatives F' of the forces
and the residual r, then becomes

    u = -r + R dz,    (I + Z F' R) dz = Z F' r                                                  (3)

by the identity of Sherman, Morrison and Woodbury (Hager 1989, SIAM Review 31, 221-239).

The contact points that a time step solves for: those that touch or may touch.

A point that stays open has no force, and its displacement follows from the coordinates. A step
therefore solves the contact problem of its candidates only. They are chosen before the step from
its first guess. At the end of the step, all other points are checked. If one of them touches, it
becomes a candidate, and the step is solved again from its first guess. What is returned therefore
does not depend on the choice, except for rounding.
"""

from typing import Annotated, NamedTuple

import numpy as np
from numpy.typing import NDArray

from fenicsrom.arrays import Array, zeros
from fenicsrom.online.contact.coating import is_coated
from fenicsrom.online.contact.friction import friction_limits, kept_part
from fenicsrom.online.contact.law import (
    contact_force,
    force_over_step,
    start_of,
    tangential,
    trial_normal_force,
)
from fenicsrom.online.contact.state import OPEN, ContactScratch, ContactState, ContactStep
from fenicsrom.online.contact.surfaces import advect_with_surface, gap_discrete_gradient
from fenicsrom.online.kernels.compilation import kernel, part
from fenicsrom.online.kernels.dense import add_combined_rows, lu_factor, lu_solve
from fenicsrom.online.kernels.numbers import (
    Vector,
    dot,
    minus,
    plus,
    positive,
    times,
    vector,
    write_vector,
)


class Compliance(NamedTuple):
    """The response of c contact points in d dimensions, of all P with m = P d directions.

    Attributes:
        rows: (m, n) R of all points; (0, 0) if all of G is given.
        unit: (n, m + 1) its first c d columns hold Z.
        delassus: (m, m) its first c d rows and columns hold G, or only its blocks (d, d) on the
            diagonal where `is_formed` is False.
        change: (n, 1) scratch: change of the coordinates.
        weighted: (n, m) scratch: Z F' of the points that touch.
        gathered: (m, n) scratch: the rows of some points.
        jacobian: (n, n) scratch: the matrix of (3).
        pivots: (n,)
    """

    rows: Array
    unit: Annotated[Array, "n columns"]
    delassus: Array
    change: Annotated[Array, "n 1"]
    weighted: Annotated[Array, "n m"]
    gathered: Annotated[Array, "m n"]
    jacobian: Annotated[Array, "n n"]
    pivots: Annotated[NDArray[np.int64], "n"]


def compliance_of(rows: Array, delassus: Array | None = None) -> Compliance:
    """A `Compliance` of contact rows (m, n), with arrays for its results; or of a given G."""
    m, n = rows.shape
    fields = {"rows": rows, "delassus": np.zeros((m, m)) if delassus is None else delassus}
    return zeros(Compliance, fields, n=n, m=m, columns=m + 1)


def given_compliance(delassus: Array) -> Compliance:
    """The `Compliance` of a given G (c d, c d)."""
    return compliance_of(np.zeros((0, 0)), np.ascontiguousarray(delassus))


def delassus_of(compliance: Compliance) -> Array:
    """G (m, m) of a response of all points."""
    m, n = compliance.rows.shape
    return compliance.rows @ compliance.unit[:, :m] if m > n else compliance.delassus


@part
def is_formed(compliance: Compliance, size: int) -> bool:
    """Whether G is formed for so many directions."""
    n = compliance.rows.shape[1]
    return n == 0 or size <= n


@part
def form_delassus(rows: Array, compliance: Compliance, directions: NDArray[np.int64]) -> None:
    """Write all of G for the rows (m, n) of the directions (c d,) whose columns Z holds."""
    count, gathered, delassus = directions.size, compliance.gathered, compliance.delassus
    for i in range(count):
        for a in range(gathered.shape[1]):
            gathered[i, a] = rows[directions[i], a]
        for j in range(count):
            delassus[i, j] = 0.0
    add_combined_rows(gathered[:count], compliance.unit[:, :count], delassus[:count, :count])


@kernel
def add_response(
    compliance: Compliance, candidates: NDArray[np.int64], scratch: ContactScratch
) -> None:
    """Add G times the `force_change` of the candidates to their residual."""
    rows, unit, z, d = (compliance.rows, compliance.unit, compliance.change, len(scratch.space))
    for a in range(rows.shape[1]):
        z[a, 0] = 0.0
        for place in range(candidates.size):
            for j in range(d):
                z[a, 0] += unit[a, place * d + j] * scratch.force_change[candidates[place], j]
    for p in candidates:
        for k in range(d):
            for a in range(rows.shape[1]):
                scratch.residual[p, k] += rows[p * d + k, a] * z[a, 0]


@kernel
def update_in_coordinates(
    compliance: Compliance, candidates: NDArray[np.int64], count: int, scratch: ContactScratch
) -> bool:
    """Turn the residual of all candidates into Newton's update by (3); False if it has none."""
    rows, unit, jacobian = compliance.rows, compliance.unit, compliance.jacobian
    weighted, dz, n, d = (compliance.weighted, compliance.change, rows.shape[1], len(scratch.space))
    for a in range(n):
        dz[a, 0] = 0.0
        for b in range(n):
            jacobian[a, b] = 1.0 if a == b else 0.0
        for t in range(count):
            place = scratch.touching[t]
            p = candidates[place]
            for j in range(d):
                value = 0.0
                for i in range(d):
                    value += unit[a, place * d + i] * scratch.force_derivative[p, i, j]
                weighted[a, t * d + j] = value
                dz[a, 0] += value * scratch.residual[p, j]
    for t in range(count):
        row = candidates[scratch.touching[t]] * d
        for j in range(d):
            for b in range(n):
                compliance.gathered[t * d + j, b] = rows[row + j, b]
    add_combined_rows(weighted, compliance.gathered[: count * d], jacobian)
    if not lu_factor(jacobian, compliance.pivots, n):
        return False
    lu_solve(jacobian, compliance.pivots, dz, n, 1)
    for p in candidates:
        for k in range(d):
            value = -scratch.residual[p, k]
            for a in range(n):
                value += rows[p * d + k, a] * dz[a, 0]
            scratch.residual[p, k] = value
    return True


CONTACT_ITERATIONS = 25  # Newton iterations; a longer iteration counts as a cycle between states
ROUNDING = 4e-15  # relative to the displacements: a smaller residual is rounding


@kernel
def _write_residual(
    step: ContactStep,
    candidates: NDArray[np.int64],
    compliance: Compliance,
    free: Array,
) -> float:
    """Write the residual of (1) and the `force_change`; returns the largest displacement."""
    start, end, scratch = step.start, step.end, step.scratch
    change, d = scratch.force_change, len(scratch.space)
    for p in candidates:
        for k in range(d):
            change[p, k] = scratch.mean_force[p, k] - scratch.known_force[p, k]
    formed, delassus = is_formed(compliance, candidates.size * d), compliance.delassus
    scale, row = 0.0, 0
    for p in candidates:
        for k in range(d):
            value = end.x[p, k] - free[p, k]
            if formed:
                for other in range(candidates.size):
                    q = candidates[other]
                    for j in range(d):
                        value += delassus[row, other * d + j] * change[q, j]
            scratch.residual[p, k] = value
            scale = max(scale, abs(end.x[p, k]), abs(free[p, k]), abs(start.x[p, k]))
            row += 1
    if not formed:
        add_response(compliance, candidates, scratch)
    return scale


@part
def _largest_entry(candidates: NDArray[np.int64], scratch: ContactScratch) -> float:
    """The largest entry of `residual` at the candidates."""
    size = 0.0
    for p in candidates:
        for k in range(len(scratch.space)):
            size = max(size, abs(scratch.residual[p, k]))
    return size


@kernel
def _solve_touching(
    candidates: NDArray[np.int64], delassus: Array, count: int, scratch: ContactScratch
) -> bool:
    """Write Newton's update of the touching points to `update`; False if it has none."""
    d, touching, jacobian = len(scratch.space), scratch.touching, scratch.jacobian
    for t in range(count):
        row = touching[t] * d
        for k in range(d):
            scratch.update[t * d + k, 0] = -scratch.residual[candidates[touching[t]], k]
            for s in range(count):
                column, derivative = (
                    touching[s] * d,
                    scratch.force_derivative[candidates[touching[s]]],
                )
                for j in range(d):
                    value = 1.0 if s == t and j == k else 0.0
                    for i in range(d):
                        value += delassus[row + k, column + i] * derivative[i, j]
                    jacobian[t * d + k, s * d + j] = value
    m = count * d
    if not lu_factor(jacobian, scratch.pivots, m):
        return False
    lu_solve(jacobian, scratch.pivots, scratch.update, m, 1)
    return True


@kernel
def _update_all(
    candidates: NDArray[np.int64], delassus: Array, count: int, scratch: ContactScratch
) -> None:
    """Turn the residual of the candidates into the update, given that of the touching points."""
    d, touching, update = len(scratch.space), scratch.touching, scratch.update
    residual, force_change = scratch.residual, scratch.force_change
    for p in candidates:
        for k in range(d):
            residual[p, k] = -residual[p, k]
    for t in range(count):
        p = candidates[touching[t]]
        for k in range(d):
            force_change[p, k] = 0.0
            for j in range(d):
                force_change[p, k] += scratch.force_derivative[p, k, j] * update[t * d + j, 0]
    if count < candidates.size:
        row = 0
        for p in candidates:
            for k in range(d):
                for t in range(count):
                    column, q = touching[t] * d, candidates[touching[t]]
                    for j in range(d):
                        residual[p, k] -= delassus[row, column + j] * force_change[q, j]
                row += 1
    for t in range(count):
        for k in range(d):
            residual[candidates[touching[t]], k] = update[t * d + k, 0]


@kernel
def _update(
    candidates: NDArray[np.int64], compliance: Compliance, count: int, scratch: ContactScratch
) -> bool:
    """Turn the residual of all candidates into Newton's update; False if it has none."""
    if not is_formed(compliance, candidates.size * len(scratch.space)):
        return update_in_coordinates(compliance, candidates, count, scratch)
    if not _solve_touching(candidates, compliance.delassus, count, scratch):
        return False
    _update_all(candidates, compliance.delassus, count, scratch)
    return True


@kernel
def semismooth_newton(
    step: ContactStep, candidates: NDArray[np.int64], compliance: Compliance, free: Array
) -> bool:
    """Semismooth Newton for (1) from the given x; True if it converged.

    Only the points that touch are unknowns: the others follow from their forces.
    """
    scratch, d, size, remained = step.scratch, len(step.scratch.space), np.inf, np.inf
    for _ in range(CONTACT_ITERATIONS):
        count = 0
        for place in range(candidates.size):
            if contact_force(step, candidates[place]):
                scratch.touching[count] = place
                count += 1
        scale = _write_residual(step, candidates, compliance, free)
        worst = _largest_entry(candidates, scratch)
        if worst <= ROUNDING * scale:
            return True
        if not _update(candidates, compliance, count, scratch):
            return False
        last, size = size, _largest_entry(candidates, scratch)
        # rounding: neither the update nor the residual decreases (for a stiff contact that only
        # opens, the residual still decreases slowly)
        if size <= 1e-15 * scale or (
            size <= 1e-11 * scale and size >= 0.5 * last and worst >= 0.9 * remained
        ):
            return True  # the forces belong to the x at which they were evaluated
        remained = worst
        for p in candidates:
            for k in range(d):
                step.end.x[p, k] += scratch.residual[p, k]
    return False


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
            contact_force(step, p)
            for k in range(d):
                scratch.held_force[p, k] = scratch.mean_force[p, k]
                scratch.held_friction[p, k] = scratch.mean_friction[p, k]
    for _ in range(SWEEPS):
        for place in range(candidates.size):
            solve_point(step, candidates, delassus, free, place)
    for p in candidates:
        for k in range(d):
            scratch.guess[p, k] = end.x[p, k]


@part
def block_times(matrix: Array, row: int, column: int, d: int, u: Vector) -> Vector:
    """The product of the block (d, d) of a matrix that starts at an entry with a vector."""
    x, y = vector(matrix[row, column : column + d]), vector(matrix[row + 1, column : column + d])
    z = times(0.0, x)
    if d > 2:
        z = vector(matrix[row + 2, column : column + d])
    return dot(x, u), dot(y, u), dot(z, u)


@kernel
def _bisect_normal_force(
    step: ContactStep, delassus: Array, place: int, p: int, n: Vector, rest: Vector, fixed: Vector
) -> float:
    """Normal force N of point p, in N, with its friction and the forces of the others held.

    The displacement is x = rest - G (N n + fixed), with the block of `delassus` at the place of the
    point. The solution N lies between zero and the normal force that the law gives at N = 0.
    """
    contacts, interval, d = step.contacts, step.interval, len(step.scratch.space)
    start, b = start_of(step.start, p), step.scratch.blending[p]
    low, high, force = 0.0, 0.0, 0.0
    for bisection in range(1 + BISECTIONS):
        force = 0.0 if bisection == 0 else 0.5 * (low + high)
        whole = plus(times(force, n), fixed)
        x = minus(rest, block_times(delassus, place * d, place * d, d, whole))
        after = trial_normal_force(contacts, p, x, interval.end)
        found = (1.0 - interval.start_weight) * positive(after)
        if interval.discrete_gradient:
            found = force_over_step(contacts, interval, p, start, after, b)
        if bisection == 0:
            high = found
        elif found > force:
            low = force
        else:
            high = force
    write_vector(step.end.x[p], x)
    return force


@kernel
def _project_friction(
    step: ContactStep, p: int, n: Vector, softness: float, force: float, before: Vector
) -> Vector:
    """Friction of point p at end.x[p], a force on the disc of radius mu `force`, N.

    Friction is taken at the weighted point, with the initial stretch, the limits and the fraction
    of contact of `online.contact.friction`. This friction is close to the mean along the path, so
    Newton's iteration then finds the solution.

    Args:
        step: the step.
        p: the point.
        n: its normal.
        softness: trace of its block of G, an upper bound for every direction, m/N.
        force: its normal force, N.
        before: its friction of the last sweep, N.
    """
    contacts, interval, start = step.contacts, step.interval, start_of(step.start, p)
    x, kt, mu = vector(step.end.x[p]), contacts.tangential_stiffness[p], contacts.friction[p]
    a, theta = interval.start_weight, 1.0 - interval.start_weight
    until = interval.begin + theta * (interval.end - interval.begin)
    ahead = advect_with_surface(contacts, p, interval.begin, until, start.slider)
    stretch = tangential(contacts, p, n, minus(plus(times(a, start.x), times(theta, x)), ahead))
    stretch0 = tangential(contacts, p, n, minus(start.x, start.slider))
    limit, fraction, kept = mu * force, 1.0, 1.0
    if not interval.discrete_gradient:
        limit = mu * (force + a * positive(start.trial))
    elif force > 0.0:
        after = trial_normal_force(contacts, p, x, interval.end)
        b = step.scratch.blending[p]
        fraction, first, _ = friction_limits(mu, start.trial, after, force, b)
        kept = kept_part(kt, stretch0, first)
    softness *= fraction * fraction * theta
    middle = plus(times(kept, stretch0), times(fraction, minus(stretch, stretch0)))
    pulled = plus(times(fraction, middle), times(softness, before))
    trial = times(1.0 / (1.0 / kt + softness), pulled)
    size = np.sqrt(dot(trial, trial))
    return times(limit / size if size > limit else 1.0, trial)


@kernel
def solve_point(
    step: ContactStep, candidates: NDArray[np.int64], delassus: Array, free: Array, place: int
) -> None:
    """Solve one candidate with the forces of the others held: its normal force, then its friction.

    This iteration is slow, but it does not cycle between states. The reason is that it projects the
    tangential force itself on the friction disc. A tangential force computed from the displacement
    could be far too large while the normal force is still wrong.
    """
    contacts, interval, scratch = step.contacts, step.interval, step.scratch
    d, p = len(scratch.space), candidates[place]
    row, x, rest, trace = place * d, vector(step.end.x[p]), vector(free[p]), 0.0
    for other in range(candidates.size):
        held = times(-1.0, vector(scratch.known_force[candidates[other]]))
        if other != place:
            held = plus(held, vector(scratch.held_force[candidates[other]]))
        rest = minus(rest, block_times(delassus, row, other * d, d, held))
    for k in range(d):
        trace += delassus[row + k, row + k]
    first, time, a = x, interval.end, interval.start_weight
    if interval.discrete_gradient:
        first, time, a = vector(step.start.x[p]), 0.5 * (interval.begin + interval.end), 0.0
    n, rubbed = gap_discrete_gradient(contacts, p, first, x, time), vector(scratch.held_friction[p])
    pressed = times(a, vector(step.start.normal[p]))
    force = _bisect_normal_force(step, delassus, place, p, n, rest, plus(rubbed, pressed))
    rubbed = _project_friction(step, p, n, trace, force, rubbed)
    held = plus(plus(times(force, n), rubbed), pressed)
    write_vector(scratch.held_friction[p], rubbed)
    write_vector(scratch.held_force[p], held)
    write_vector(step.end.x[p], minus(rest, block_times(delassus, row, row, d, held)))


@part
def choose_candidates(step: ContactStep, all_points: bool) -> int:
    """Choose the points that touch at the start of a step or may touch at its end.

    A point may touch if it would with a trial normal force that changes twice as much as in the
    first guess. A point before an abradable layer may touch in the middle of a step.

    Args:
        step: the step; `end.x` (P, d) holds the first guess of the displacement at its end. Out:
            `is_candidate`, `candidates` and `directions` of the scratch arrays.
        all_points: choose all points.

    Returns:
        The number of candidates.
    """
    contacts, scratch = step.contacts, step.scratch
    for p in range(step.end.x.shape[0]):
        before = step.start.trial_normal_force[p]
        after = trial_normal_force(contacts, p, step.end.x[p], step.interval.end)
        stays_open = max(before, after) + abs(after - before) <= 0.0
        scratch.is_candidate[p] = all_points or is_coated(contacts, p) or not stays_open
    return list_candidates(scratch)


@part
def list_candidates(scratch: ContactScratch) -> int:
    """Write `candidates` and `directions` from `is_candidate`; returns the number of candidates."""
    d, count = len(scratch.space), 0
    for p in range(scratch.is_candidate.size):
        if scratch.is_candidate[p]:
            scratch.candidates[count] = p
            for k in range(d):
                scratch.directions[count * d + k] = p * d + k
            count += 1
    return count


@part
def add_candidates(step: ContactStep, free_displacement: Array) -> int:
    """Add the points that touch at the end of a step to its candidates.

    Args:
        step: the step; in and out: `scratch.is_candidate`; out: `candidates` and `directions`
            there, and at its end `x` and the trial normal force of the points that are no
            candidates.
        free_displacement: (P, d) the displacements at the end of the step.

    Returns:
        The number of candidates.
    """
    end, scratch = step.end, step.scratch
    for p in range(end.x.shape[0]):
        if not scratch.is_candidate[p]:
            for k in range(len(scratch.space)):
                end.x[p, k] = free_displacement[p, k]
            after = trial_normal_force(step.contacts, p, end.x[p], step.interval.end)
            end.trial_normal_force[p] = after
            scratch.is_candidate[p] = not after <= 0.0
    return list_candidates(scratch)


@part
def keep_open(p: int, end: ContactState, scratch: ContactScratch) -> None:
    """Write the state of a point that is open during the whole step: the slider follows it."""
    end.state[p] = OPEN
    for k in range(len(scratch.space)):
        end.normal[p, k] = 0.0
        end.friction[p, k] = 0.0
        end.slider[p, k] = end.x[p, k]
        scratch.mean_force[p, k] = 0.0

"""Semismooth Newton for the contact problem (1) of `fenicsrom.online.contact.problem`."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from fenicsrom.arrays import Array
from fenicsrom.online.contact.compliance import (
    Compliance,
    add_response,
    is_formed,
    update_in_coordinates,
)
from fenicsrom.online.contact.law import contact_force
from fenicsrom.online.contact.state import ContactScratch, ContactStep
from fenicsrom.online.kernels.compiled import kernel, part
from fenicsrom.online.kernels.dense import lu_factor, lu_solve

CONTACT_ITERATIONS = 25  # Newton iterations; a longer iteration counts as a cycle between states
ROUNDING = 4e-15  # relative to the displacements: a smaller residual is rounding


@kernel
def _write_residual(
    step: ContactStep,
    candidates: NDArray[np.int64],
    compliance: Compliance,
    free: Array,
    count: int,
) -> float:
    """Write the residual of (1), with `count` touching points; returns the largest displacement."""
    start, end, scratch = step.start, step.end, step.scratch
    touching, mean, d = scratch.touching, scratch.mean_force, len(scratch.space)
    formed, delassus = is_formed(compliance, candidates.size * d), compliance.delassus
    scale, row = 0.0, 0
    for p in candidates:
        for k in range(d):
            value = end.x[p, k] - free[p, k]
            if formed:
                for t in range(count):
                    column, q = touching[t] * d, candidates[touching[t]]
                    for j in range(d):
                        value += delassus[row, column + j] * mean[q, j]
            scratch.residual[p, k] = value
            scale = max(scale, abs(end.x[p, k]), abs(free[p, k]), abs(start.x[p, k]))
            row += 1
    if not formed:
        add_response(compliance, candidates, count, scratch)
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
            if contact_force(step, candidates[place], True):
                scratch.touching[count] = place
                count += 1
        scale = _write_residual(step, candidates, compliance, free, count)
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

"""The contact points that a time step solves for: those that touch or may touch.

A point that stays open has no force, and its displacement follows from the coordinates. A step
therefore solves the contact problem of its candidates only. They are chosen before the step from
its first guess. At the end of the step, all other points are checked. If one of them touches, it
becomes a candidate, and the step is solved again from its first guess. What is returned therefore
does not depend on the choice, except for rounding.
"""

from __future__ import annotations

from fenicsrom.arrays import Array
from fenicsrom.online.contact.coating import is_coated
from fenicsrom.online.contact.law import trial_normal_force
from fenicsrom.online.contact.state import OPEN, ContactScratch, ContactState, ContactStep
from fenicsrom.online.kernels.compiled import part


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

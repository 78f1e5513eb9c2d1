"""The larger model that judges a basis sees the residual of the full equations along the motion.

The candidates of a basis (`fenicsrom.reduction.candidates`) are chosen before there is a motion.
What the full motion has and no candidate holds would not show in an estimate. The residual r of the
full equations along the motion of all candidates holds it. The principal static responses K⁻¹ r
outside of the candidates, in the energy norm, join the larger model, and its motion is sought
again, until the responses, or what they change, are small.

A static response alone is no estimate of the errors at the contact and at a load: the basis holds
the static responses to forces there, so that the residual does no work on them.

These vectors judge only. A basis may take candidates: these depend on the scene and not on the
motion, so that a run that continues has the same basis.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from fenicsrom.assess.errors.comparisons import unseen
from fenicsrom.assess.errors.estimates import distances
from fenicsrom.assess.errors.sizing import Judge, judge_of
from fenicsrom.errors import AccuracyError
from fenicsrom.online.motion.measures import is_unsteady
from fenicsrom.online.motion.motion import Motion
from fenicsrom.online.store.archive import StoredModel
from fenicsrom.reduction.basis import ReducedBasis, build_basis, project
from fenicsrom.reduction.modes import ComponentModes
from fenicsrom.reduction.protocols import Structure

UNSEEN = 1e-3
"""Smaller responses, relative to the motion, or changes of the motion by them do not count."""

ROUNDS = 3
"""How often responses join the larger model; once for a motion that does not settle."""

RESPONSES = 8
"""Largest number of responses that join at once."""


def judge_with_residual(
    body: Structure,
    modes: ComponentModes,
    extended: ReducedBasis,
    stored: StoredModel,
    motion: Motion,
) -> Judge:
    """The judge of a motion, with the residual of the full equations along it. Collective.

    Args:
        body: the solid or the beam.
        modes: its component modes.
        extended: the basis of the model with its candidates.
        stored: the model.
        motion: its motion.
    """
    found, basis = judge_of(stored, motion), extended
    for _ in range(1 if is_unsteady(motion) else ROUNDS):
        before = found.motion
        if before is None:
            break
        vectors, sizes = unseen(body, modes, basis, before, stored.scene)
        count = min(int(np.sum(sizes > UNSEEN)), RESPONSES)
        if count == 0:
            break
        vectors = np.concatenate([basis.vectors[:, basis.masters :], vectors[:, :count]], axis=1)
        known = basis.size - extended.size
        labels = [f"{known + k + 1}R" for k in range(count)]
        try:
            basis = build_basis(body, modes, vectors, [*basis.labels[basis.masters :], *labels])
        except AccuracyError:  # responses that rounding does not tell from the candidates
            break
        larger = project(body, basis, body.geometrically_nonlinear)
        further = basis.labels[stored.size :]
        found = judge_of(replace(stored, candidates=larger, further=further, tables=None), motion)
        if found.motion is not None:
            change = distances(before, found.motion)
            if max(change.amplitude, change.peak_force) < UNSEEN:
                break
    return found

"""The residual of the full equations along a motion judges its basis.

The candidates of a basis (`fenicsrom.reduction.candidates`) are chosen before there is a motion.
What the full motion has and no candidate holds does not show in the motion of all candidates. The
residual r of the full equations along this motion holds it. The principal static responses K⁻¹ r
outside of all candidates, in the energy norm, join the coordinates of the model, and the motion of
this larger model is sought. It has the responses and not the candidates, at a fraction of the cost
of a model with both. As long as the responses change little, the error that they show and the error
that the candidates show are those of different directions, and are added as such
(`fenicsrom.assess.errors.estimates.together`). Otherwise the responses join all candidates, and so
do those to the residual along the motion of this model, until the responses, or what they change,
are small. The friction of bodies that touch changes little by the candidates or by the responses
alone, and more by both: there the responses join all candidates at once, at most twice.

A static response alone is no estimate of the errors at the contact and at a load: the basis holds
the static responses to forces there, so that the residual does no work on them.

These vectors judge only. A basis may take candidates: these depend on the scene and not on the
motion, so that a run that continues has the same basis.
"""

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from fenicsrom.arrays import Array
from fenicsrom.assess.errors import estimates
from fenicsrom.assess.errors.comparisons import unseen
from fenicsrom.errors import AccuracyError
from fenicsrom.online.motion.measures import is_unsteady
from fenicsrom.online.motion.motion import Motion
from fenicsrom.online.store.archive import StoredModel
from fenicsrom.reduction.basis import ReducedBasis, build_basis, project
from fenicsrom.reduction.modes import ComponentModes
from fenicsrom.reduction.protocols import Structure

UNSEEN, SEEN = 1e-3, 1e-2
"""Smaller responses, relative to the motion, or changes of the motion by them do not count.

Neither do changes up to `SEEN` that are at most half of the estimate: what follows is smaller.
"""

FAINT = 1e-5
"""Smaller responses of bodies that touch do not count: friction has little of the energy."""

ROUNDS = 3
"""How often responses join all candidates; never for a motion that does not settle."""

RESPONSES = 8
"""Largest number of responses that join at once."""

JUDGED = {False: ("amplitude", "peak_force"), True: ("probe", "dissipation", "history")}
"""The errors whose changes count, of a body and of bodies that touch."""

RESPONSE = "R"
"""The last letter of the labels of responses."""


class Judged(NamedTuple):
    """A model with the responses to the residual, and what it says of a basis.

    Attributes:
        stored: the stored model with the responses, alone or behind its candidates; without any of
            them, if the residual is small.
        errors: the estimated errors due to the basis.
    """

    stored: StoredModel
    errors: estimates.MotionErrors


def judge_with_residual(
    body: Structure,
    modes: ComponentModes,
    extended: ReducedBasis,
    stored: StoredModel,
    motion: Motion,
    other: Motion,
) -> Judged:
    """Judge the basis of a motion by its candidates and by the residual. Collective.

    Args:
        body: the solid or the beam.
        modes: its component modes.
        extended: the basis of the model with its candidates, in any order.
        stored: the model.
        motion: its motion.
        other: the motion of all coordinates of the model.
    """
    assert stored.candidates is not None
    basis = extended.part((*stored.labels, *stored.further), stored.candidates.mass)
    small = extended.part(stored.labels, stored.model.mass)
    bare = replace(stored, candidates=None, further=(), finer=None, tables=None)
    found = judge_again(bare, motion, other)[0]
    joint = stored.scene.joined
    before, along = other if joint else motion, other
    rounds = 2 if joint else 1 + ROUNDS
    for k in range(1 if is_unsteady(motion) else rounds):
        alone = k == 0 and not joint  # the responses without the candidates
        if joint or k != 1:  # the second model has the responses of the first one
            vectors, sizes = unseen(body, modes, basis, along, stored.scene)
            count = int(np.sum(sizes > (FAINT if joint else UNSEEN)))
            vectors = vectors[:, : min(count, RESPONSES)]
        if vectors.shape[1] == 0:
            break
        try:
            joined = _joined(body, modes, small if alone else basis, vectors)
        except AccuracyError:  # responses that rounding does not tell from the basis
            break
        model = project(body, joined, body.geometrically_nonlinear)
        larger = replace(bare, candidates=model, further=joined.labels[stored.size :])
        found, seen = judge_again(larger, motion, other)
        if seen is None:
            break
        change = estimates.times_distance(1.0, before, seen)
        limits = {
            name: min(max(0.5 * getattr(found.errors, name), UNSEEN), SEEN)
            for name in JUDGED[joint]
        }
        if all(getattr(change, name) <= limit for name, limit in limits.items()):
            break
        basis, before, along = (basis, other, other) if alone else (joined, seen, seen)
    return found


def _joined(
    body: Structure, modes: ComponentModes, basis: ReducedBasis, vectors: Array
) -> ReducedBasis:
    """A basis with responses (local, k) at its end; errors as `build_basis`."""
    first = 1 + sum(label.endswith(RESPONSE) for label in basis.labels)
    names = [f"{first + k}{RESPONSE}" for k in range(vectors.shape[1])]
    inner = np.concatenate([basis.vectors[:, basis.masters :], vectors], axis=1)
    return build_basis(body, modes, inner, [*basis.labels[basis.masters :], *names])


def judge_again(stored: StoredModel, motion: Motion, other: Motion) -> tuple[Judged, Motion | None]:
    """Judge a motion by a model with responses that are known; its motion comes along.

    Args:
        stored: as in `Judged`.
        motion: the motion.
        other: the motion of all coordinates of its model.
    """
    if stored.candidates is None:
        return Judged(stored, estimates.basis_errors(motion, other)), None
    seen = estimates.nested_motion(stored.candidates, stored.scene, motion)
    errors = estimates.basis_errors(motion, seen)
    if all(label.endswith(RESPONSE) for label in stored.further):
        errors = estimates.together(errors, estimates.basis_errors(motion, other))
    return Judged(stored, errors), seen

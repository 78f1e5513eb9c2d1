"""The size of a reduced model by the estimate of its error: as small as the accuracy asks.

A stored model holds N coordinates, of which it uses the first n. The motion of all N coordinates
judges that of the n (`fenicsrom.assess.errors.estimates.basis_errors`): all directions together,
because a direction that hardly moves would take many coordinates; of bodies that touch, the probe
and the energy that friction dissipates. Where the estimate is above
`basis.accuracy`, the energies of the other coordinates in the motion of the larger model,

    ½ K_ii mean(e_i²) relative to ½ mean(qᵀ K q),    (1)

say what the motion lacks. Those with the largest energies join the model: at least `AT_LEAST`,
because a mode without its derivatives can make the answer worse, and then twice as many, until the
estimate is small enough. A model that took nearly all coordinates cannot be judged by the rest:
`RESERVE` of those that the first model left out stay out. With `basis.size` a model has so many
coordinates instead. A motion that its first coordinates describe well enough keeps them: fewer
would cost another run.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from fenicsrom.arrays import Array
from fenicsrom.assess.errors.estimates import MotionErrors, basis_errors, nested_motion
from fenicsrom.assess.errors.verdicts import UNSETTLED_BASIS_ERROR, in_percent
from fenicsrom.errors import AccuracyError, ConvergenceError
from fenicsrom.notes import Note, NoteKind
from fenicsrom.online.motion.measures import has_settled, is_unsteady
from fenicsrom.online.motion.motion import Motion
from fenicsrom.online.run.march import end_of
from fenicsrom.online.run.simulate import simulate
from fenicsrom.online.store.archive import StoredModel
from fenicsrom.progress import log
from fenicsrom.reduction.interface import SETTLED
from fenicsrom.scene import Scene
from fenicsrom.words import counted

AT_LEAST = 3
"""Fewest coordinates that join a model at once."""

RESERVE = 0.3
"""Part of the coordinates beyond the first model that must be left to judge a larger one."""


@dataclass(frozen=True, eq=False)
class Sized:
    """A model whose size fits the accuracy, with its motion.

    Attributes:
        stored: the model.
        motion: its motion.
        other: the motion of all coordinates of the stored model; None if there is none.
        errors: estimated errors due to the basis.
        energies: square roots of (1) of the coordinates that joined, by their labels.
        warning: why the accuracy is not reached; None if it is.
        tried: number of coordinates of each model of the search -> its estimated error.
    """

    stored: StoredModel
    motion: Motion
    other: Motion | None
    errors: MotionErrors
    energies: dict[str, float]
    warning: Note | None = None
    tried: dict[int, float] = field(default_factory=dict)


Run = Callable[[StoredModel, tuple[Array, ...] | None], Motion]
"""Integrates a larger model as the run does, with the start `near` of `integrate`."""


def sized(stored: StoredModel, motion: Motion, run: Run) -> Sized | None:
    """Let a model take coordinates until the error due to its basis is small enough.

    Only a basis with derivatives along principal directions takes coordinates.

    Args:
        stored: the model under the scene.
        motion: its motion.
        run: integrates a larger model as the run does.

    Returns:
        The model with its motion; None if it has no further coordinates, or takes none.

    Raises:
        ConvergenceError, AccuracyError: a larger model failed where the first one did not.
        SceneError: the model has no such `basis.size`.
    """
    if stored.candidates is None or not stored.scene.basis.adapts:
        return None
    if stored.scene.basis.size is not None:
        return _of_size(stored, motion, run, stored.scene.basis.size)
    energies, tried = dict[str, float](), dict[int, float]()
    most = len(stored.further) - spare_coordinates(stored)
    other = candidate_motion(stored, motion)
    while True:
        limit = accuracy_limit(stored, motion)
        errors = basis_errors(motion, other)
        error = tried[stored.size] = limited(stored.scene, errors)
        if error <= limit:
            return Sized(stored, motion, other, errors, energies, None, tried)
        larger = None
        if other is not None:
            found = candidate_energies(stored, other)
            left = list(found)[: max(most - len(energies), 0)]
            larger, near = _enlarged(stored, motion, other, left, limit)
        if larger is None:
            warning = unreached(stored, error, limit)
            return Sized(stored, motion, other, errors, energies, warning, tried)
        energies |= {label: found[label] for label in larger.labels[stored.size :]}
        motion, other = _again(stored, larger, motion, other, run, near)
        stored = larger


def limited(scene: Scene, errors: MotionErrors) -> float:
    """The error that `basis.accuracy` limits: that of all directions together.

    Of bodies that touch, it is that of the probe: their contact displacements are micrometres. It
    is that of the energy that friction dissipates if this one is larger, and above `SETTLED`: the
    interface vectors are no better.
    """
    if not scene.joined:
        return errors.amplitude
    return max(errors.probe, errors.dissipation if errors.dissipation > SETTLED else 0.0)


def accuracy_limit(stored: StoredModel, motion: Motion) -> float:
    """The largest accepted error due to the basis: the accuracy of the scene, if it settles."""
    return UNSETTLED_BASIS_ERROR if is_unsteady(motion) else stored.scene.basis.accuracy


def candidate_motion(stored: StoredModel, motion: Motion) -> Motion | None:
    """The motion of all coordinates of a model near its motion; None if there is none."""
    assert stored.candidates is not None
    return nested_motion(stored.candidates, stored.scene, motion)


def _again(
    before: StoredModel,
    stored: StoredModel,
    earlier: Motion,
    other: Motion | None,
    run: Run,
    near: tuple[Array, ...] | None = None,
) -> tuple[Motion, Motion | None]:
    """The motion of a model of another size, and that of all coordinates, which may be the same.

    Args:
        before: the model before.
        stored: the model.
        earlier: the motion of the model before.
        other: the motion of all coordinates of the model before.
        run: as `sized`.
        near: as `integrate`.
    """
    motion = run(stored, near)
    elsewhere = near is None and motion.newton_from is not None
    if other is None or elsewhere or has_settled(motion) != has_settled(earlier):
        return motion, candidate_motion(stored, motion)
    known = (*before.labels, *before.further)
    order = [known.index(label) for label in (*stored.labels, *stored.further)]
    rows = "coordinates", "velocity", "acceleration"
    return motion, replace(other, **{name: getattr(other, name)[:, order] for name in rows})


def _of_size(stored: StoredModel, motion: Motion, run: Run, size: int) -> Sized:
    """The model with so many coordinates; other arguments and errors as `sized`."""
    stored.require_size()
    other = candidate_motion(stored, motion)
    chosen = with_size(stored, other, size)
    energies = {} if other is None else candidate_energies(stored, other)
    if chosen is not stored:
        motion, other = _again(stored, chosen, motion, other, run)
    joined = {label: energies[label] for label in chosen.labels if label in energies}
    return Sized(chosen, motion, other, basis_errors(motion, other), joined)


def with_size(stored: StoredModel, other: Motion | None, size: int) -> StoredModel:
    """A model with more or fewer coordinates, those with the largest energies (1).

    Args:
        stored: the model, whose coordinates of the contact stay.
        other: the motion of all coordinates; without it the order of the file counts.
        size: number of coordinates, from `StoredModel.least_size` to that of all coordinates.
    """
    kept = stored.size if size >= stored.size else stored.least_size - 1
    if other is None or size == stored.size:
        return stored.resized(size)
    energies = coordinate_energies(stored, other)
    among = stored.further if size >= stored.size else stored.labels[kept:]
    joining = sorted(among, key=lambda label: -energies[label])[: size - kept]
    return stored.resized((*stored.labels[:kept], *joining))


def fitted(stored: StoredModel, motion: Motion, warnings: list[Note]) -> Sized | None:
    """As `sized`, with runs from rest; a larger model that fails leaves the model as it was.

    Args:
        stored: the model under the scene.
        motion: its motion.
        warnings: receives a sentence if the accuracy is not reached.
    """

    def run(larger: StoredModel, near: tuple[Array, ...] | None) -> Motion:
        log.info(f"  {counted(larger.size, 'coordinate')}: {' '.join(larger.labels)}")
        return simulate(larger.model, larger.scene, near=near, keep_coordinates=True)

    try:
        found = sized(stored, motion, run)
    except (AccuracyError, ConvergenceError) as error:
        text = f"a reduced model with more coordinates failed: {error}"
        warnings.append(Note(NoteKind.FAILED, text))
        return None
    if found is not None and found.warning:
        warnings.append(found.warning)
    return found


def spare_coordinates(stored: StoredModel) -> int:
    """The number of coordinates that stay out of a model, to judge it."""
    return int(np.ceil(RESERVE * len(stored.further)))


def can_grow(stored: StoredModel, spare: int) -> bool:
    """Whether a model may take more coordinates, apart from those that stay out to judge it."""
    basis = stored.scene.basis
    return basis.adapts and basis.size is None and len(stored.further) > spare


def unreached(stored: StoredModel, error: float, limit: float) -> Note:
    """The warning that a model cannot reach its accuracy.

    Args:
        stored: the model.
        error: its estimated error, infinite if it is not known.
        limit: largest accepted error.
    """
    known = counted(stored.size + len(stored.further), "coordinate")
    found = f"estimated as {in_percent(error)}" if np.isfinite(error) else "not known"
    text = (
        f"basis.accuracy = {limit:g} is not reached with {stored.size} of the {known} that the "
        f"model holds: the error is {found}; run the scene with a larger basis.modes to reach it"
    )
    return Note(NoteKind.ERROR, text, "basis.accuracy")


def coordinate_energies(stored: StoredModel, other: Motion) -> dict[str, float]:
    """The square roots of (1) by the labels of all coordinates.

    Args:
        stored: the model.
        other: the motion of all coordinates.
    """
    assert stored.candidates is not None and other.coordinates is not None
    n, stiffness = stored.size, stored.candidates.elastic.stiffness
    q = other.coordinates
    whole = np.mean(np.einsum("ti,ij,tj->t", q[:, :n], stiffness[:n, :n], q[:, :n]))
    squares = np.mean(q**2, axis=0) * np.abs(np.diag(stiffness)) / abs(whole)
    return dict(zip((*stored.labels, *stored.further), np.sqrt(squares).tolist(), strict=True))


def candidate_energies(stored: StoredModel, other: Motion) -> dict[str, float]:
    """Those of `coordinate_energies` that the model leaves out, the largest first."""
    found = coordinate_energies(stored, other)
    return {label: found[label] for label in sorted(stored.further, key=lambda k: -found[k])}


def growing(labels: Sequence[str]) -> Iterator[Sequence[str]]:
    """The first `AT_LEAST` of the labels, then twice as many, and so on up to all."""
    count = 0
    while count < len(labels):
        count = min(max(AT_LEAST, 2 * count), len(labels))
        yield labels[:count]


def _enlarged(
    stored: StoredModel, motion: Motion, other: Motion, labels: list[str], limit: float
) -> tuple[StoredModel | None, tuple[Array, ...] | None]:
    """The smallest larger model whose motion is near enough to that of all coordinates.

    With it comes the start of this motion, if Newton's method found it. Where no model is near
    enough, it is the one with the least error, or the largest where no trial has a motion nearby.
    A motion that does not settle takes all coordinates that can join. None if no coordinate can.

    Args:
        stored: the model.
        motion: its motion.
        other: the motion of all coordinates.
        labels: of the coordinates that can join, the most important first.
        limit: largest accepted error.
    """
    if not labels:
        return None, None
    if is_unsteady(motion):  # each trial would run as long as the run
        return stored.resized((*stored.labels, *labels)), None
    best, begin, least = None, None, np.inf
    known = (*stored.labels, *stored.further)
    for joining in growing(labels):
        trial = stored.resized((*stored.labels, *joining))
        chosen = [known.index(label) for label in trial.labels]
        near = nested_motion(trial.model, stored.scene, motion, chosen, near=other)
        error = np.inf if near is None else limited(stored.scene, basis_errors(near, other))
        if error <= least:
            best, begin, least = trial, _start(near, motion), error
        if error <= limit:
            break
    return best, begin


def _start(near: Motion | None, motion: Motion) -> tuple[Array, ...] | None:
    """The start of a periodic motion that was found near a motion; None if there is none."""
    if near is None or motion.newton_from is None or near.coordinates is None:
        return None
    assert near.velocity is not None
    return near.coordinates[-1], near.velocity[-1], end_of(motion)[2]

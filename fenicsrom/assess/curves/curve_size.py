"""The size of a model for response curves: one for all of them.

Before the curves, a few motions of each choose the size: those at both ends of the range and at the
natural frequencies in it, and from the largest of these the top of the curve there. After the
curves, the checks of their points (`fenicsrom.assess.curves.trust`) judge the size once more. Both
compare with the motions of all coordinates that the model holds. Where the worst error is above
`basis.accuracy`, coordinates join the model by their energies in these motions, as for one motion
(`fenicsrom.assess.errors.sizing`).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from fenicsrom.assess.curves.response_problem import family_of, shooting_of, start_motion
from fenicsrom.assess.curves.response_results import Response, response_table
from fenicsrom.assess.curves.trust import Check, Richer, change, march_cost, richer_motion
from fenicsrom.assess.errors.estimates import BASIS_SAFETY
from fenicsrom.assess.errors.sizing import candidate_energies, growing, unreached
from fenicsrom.assess.jobs import Workers, run_jobs
from fenicsrom.errors import AccuracyError, ConvergenceError
from fenicsrom.online.curves.continuation import Continuation
from fenicsrom.online.curves.curve import CurvePoint
from fenicsrom.online.curves.forced_peak import climb
from fenicsrom.online.curves.nonlinear_mode import linear_modes
from fenicsrom.online.model.problem import Problem
from fenicsrom.online.periodic.periodic_record import motion_of
from fenicsrom.online.periodic.shooting import PeriodicMotion
from fenicsrom.online.store.archive import StoredModel
from fenicsrom.progress import duration, log

POINTS = 3
"""The worst points of a curve that choose its size."""

RESONANCES = 3
"""Most natural frequencies in the range at which motions are sought before the curves."""

LONG_STEP = 0.2
"""Step along a curve to its top, which need not be resolved: as `arc.LARGEST_STEP`."""


@dataclass(frozen=True, eq=False)
class Sample:
    """A motion of a curve, which judges the size of the model.

    Attributes:
        stored: the model under the scene of the curve.
        point: the motion.
        whole: the motion of all coordinates there; None if it was not found.
    """

    stored: StoredModel
    point: CurvePoint
    whole: PeriodicMotion | None

    @classmethod
    def of(cls, stored: StoredModel, point: CurvePoint) -> Sample:
        """The sample of a point, for which the motion of all coordinates is sought."""
        return cls(stored, point, _motion(stored, (*stored.labels, *stored.further), point))

    def error(self, near: CurvePoint | PeriodicMotion | None) -> float:
        """Estimated error of a motion of fewer coordinates; infinite without this motion."""
        if near is None or self.whole is None:
            return np.inf
        return BASIS_SAFETY * change(near.amplitude, self.whole.amplitude)


def model_before_curves(
    stored: StoredModel, spare: int, workers: Workers, stop: Callable[[], bool], comm: Any
) -> StoredModel | None:
    """A model with the coordinates that a few motions of each curve lack; None if they lack none.

    Args:
        stored: the model; its scene has a table [response].
        spare: number of coordinates that must stay out, to judge the others.
        workers: compute the motions, see `fenicsrom.assess.jobs`.
        stop: asked often.
        comm: MPI communicator; all ranks get the same model.

    Raises:
        KeyboardInterrupt: `stop` returned True.
    """
    families = response_table(stored.scene).families
    owns = [stored]
    if families is not None:
        owns = [stored.with_values({families.key: value}) for value in families.values]
    log.info("  a few motions of each curve choose the size of the model")
    found = run_jobs(_samples, owns, lambda *_: None, workers, stop, comm)
    samples = [each for _, made in found if not isinstance(made, Exception) for each in made]
    accuracy = stored.scene.basis.accuracy
    return enlarged(
        stored, [each for each in samples if accuracy < each.error(each.point) < np.inf], spare
    )


def _samples(stored: StoredModel, report: Callable[[float, str], None]) -> list[Sample]:
    """A few motions of the curve of a model; see `fenicsrom.assess.jobs.Job`."""
    table, family = response_table(stored.scene), family_of(stored)
    points: list[CurvePoint] = []
    for value in (table.first, table.last, *_resonances(stored)):
        report(0.0, "")
        try:
            motion = start_motion(stored, family, value)
        except (ConvergenceError, AccuracyError):
            continue
        shooting = shooting_of(stored, family)
        s = shooting.scaled(motion.z)
        path = Continuation(shooting, family, table.low, table.high, s)
        point = path.at_parameter(s, value)
        if point is not None:
            points.append(point)
            if point is max(points, key=_height):
                highest = path
    if points:
        top = climb(highest, max(points, key=_height), _height, largest_step=LONG_STEP)[0]
        points += [] if top is None else [top]
    return [Sample.of(stored, point) for point in sorted(points, key=_height)[-POINTS:]]


def _height(point: CurvePoint) -> float:
    return float(point.amplitude.max())


def _resonances(stored: StoredModel) -> Iterator[float]:
    """The lowest natural frequencies within the range of a curve over the frequency, Hz."""
    table = response_table(stored.scene)
    if table.parameter != "frequency":
        return
    try:
        modes = linear_modes(Problem.of(stored.model, stored.scene).settled())
    except ConvergenceError:
        return
    own = [mode.omega / (2.0 * np.pi) for mode in modes]
    yield from [value for value in own if table.low < value < table.high][:RESONANCES]


def cost_in_words(found: Response, larger: StoredModel) -> str:
    """What the curves of a larger model cost, by the time that those of a smaller one took."""
    points = [point for curve in found.curves for point in curve.points]
    sliders = points[0].z.size - 2 * found.size if points else 0
    ratio = march_cost(larger.size, sliders) / march_cost(found.size, sliders)
    return f"about {duration(ratio * found.seconds)}"


def worst_checks(found: Response, stored: StoredModel) -> list[tuple[StoredModel, Check]]:
    """The points of each curve with errors above the accuracy, each with the model of its curve."""
    accuracy, families = stored.scene.basis.accuracy, found.table.families
    worst = []
    for curve in found.curves:
        wrong = [each for each in curve.checks if _error(each) > accuracy]
        wrong.sort(key=_error, reverse=True)
        own = stored
        if families is not None and wrong:
            own = stored.with_values({families.key: curve.value})
        worst += [(own, each) for each in wrong[:POINTS]]
    return worst


def _error(check: Check) -> float:
    """The estimated error of an amplitude due to the basis; zero where it is not known."""
    return BASIS_SAFETY * (check.basis_error or 0.0) if check.quantity == "amplitude" else 0.0


def larger_model(found: Response, stored: StoredModel, spare: int) -> StoredModel | None:
    """A model with the coordinates that the curves lack; None if they lack none, or none is left.

    Where the accuracy is not reached, a warning joins those of the curves.

    Args:
        found: the curves of the model, with their checks.
        stored: the model.
        spare: number of coordinates that must stay out, to judge the others.
    """
    worst = worst_checks(found, stored)
    basis = stored.scene.basis
    if not worst or not basis.adapts or basis.size is not None:
        return None
    larger = enlarged(stored, [Sample.of(own, check.point) for own, check in worst], spare)
    if larger is None:
        error = max(_error(check) for _, check in worst)
        found.warnings.append(unreached(stored, error, basis.accuracy))
    return larger


def enlarged(stored: StoredModel, samples: Sequence[Sample], spare: int) -> StoredModel | None:
    """A model whose motions are near enough to samples; None if no coordinate can join.

    Args:
        stored: the model.
        samples: the motions that the model lacks coordinates for.
        spare: number of coordinates that must stay out, to judge the others.
    """
    known = [sample for sample in samples if sample.whole is not None]
    energies: dict[str, float] = {}
    for sample in known:
        whole = sample.whole
        assert whole is not None
        found = candidate_energies(sample.stored, motion_of(whole.record, whole.period))
        for label, size in found.items():
            energies[label] = max(size, energies.get(label, 0.0))
    labels = sorted(energies, key=lambda label: -energies[label])[: len(energies) - spare]
    best = None
    for chosen in growing(labels):
        best = (*stored.labels, *chosen)
        errors = (sample.error(_motion(sample.stored, best, sample.point)) for sample in known)
        if all(error <= stored.scene.basis.accuracy for error in errors):
            break
    return None if best is None else stored.resized(best)


def _motion(
    stored: StoredModel, labels: tuple[str, ...], point: CurvePoint
) -> PeriodicMotion | None:
    """The motion of a model with more coordinates at a point of the curve of a model."""
    richer = Richer(family_of(stored.resized(labels)), np.eye(len(labels), stored.size))
    return richer_motion(point, richer)

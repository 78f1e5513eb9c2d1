"""The size of the model of response curves, and checks of their points by larger models.

Before the curves, a few motions of each choose the size: those at both ends of the range and at the
natural frequencies in it, and from the largest of these the top of the curve there. After the
curves, the checks of their points (`fenicsrom.assess.curves.trust`) judge the size once more. Both
compare with the motions of all coordinates that the model holds. Where the worst error is above
`basis.accuracy`, coordinates join the model by their energies in these motions, as for one motion
(`fenicsrom.assess.errors.sizing`).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from fenicsrom.arrays import Array
from fenicsrom.assess.curves import results, trust
from fenicsrom.assess.curves.response_problem import family_of, shooting_of, start_motion
from fenicsrom.assess.errors.estimates import BASIS_SAFETY, MotionErrors
from fenicsrom.assess.errors.sizing import candidate_energies, growing, limited, unreached
from fenicsrom.assess.errors.verdicts import BASIS_ERROR, TIME_ERROR, in_percent
from fenicsrom.assess.jobs import Workers, run_jobs
from fenicsrom.errors import AccuracyError, ConvergenceError, job_error
from fenicsrom.notes import AMPLITUDES, Note, NoteKind
from fenicsrom.online.curves.continuation import Continuation, climb
from fenicsrom.online.curves.curve import CurvePoint
from fenicsrom.online.curves.nonlinear_mode import linear_modes
from fenicsrom.online.model.model import Problem
from fenicsrom.online.motion.motion import Motion
from fenicsrom.online.periodic import shooting as periodic
from fenicsrom.online.store.archive import StoredModel
from fenicsrom.progress import ask, duration, log
from fenicsrom.scene import Scene
from fenicsrom.scene.reading.overrides import in_words
from fenicsrom.words import counted

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
    whole: periodic.PeriodicMotion | None

    @classmethod
    def of(cls, stored: StoredModel, point: CurvePoint) -> Sample:
        """The sample of a point, for which the motion of all coordinates is sought."""
        return cls(stored, point, _motion(stored, (*stored.labels, *stored.further), point))

    def error(self, near: CurvePoint | periodic.PeriodicMotion | None) -> float:
        """Estimated error of a motion of fewer coordinates; infinite without this motion."""
        if near is None or self.whole is None:
            return np.inf
        if not self.stored.scene.joined:
            return BASIS_SAFETY * trust.change(near.amplitude, self.whole.amplitude)
        probe, spent = (
            BASIS_SAFETY
            * trust.change(*np.atleast_1d(getattr(near, name), getattr(self.whole, name)))
            for name in ("probe_amplitude", "friction_dissipation")
        )
        errors = MotionErrors(0.0, 0.0, (), probe=probe, dissipation=spent)
        return limited(self.stored.scene, errors)


def model_before_curves(
    stored: StoredModel, spare: int, workers: Workers, comm: Any
) -> StoredModel | None:
    """A model with the coordinates that a few motions of each curve lack; None if they lack none.

    Args:
        stored: the model; its scene has a table [response].
        spare: number of coordinates that must stay out, to judge the others.
        workers: compute the motions, see `fenicsrom.assess.jobs`.
        comm: MPI communicator; all ranks get the same model.

    Raises:
        KeyboardInterrupt: the work was asked to stop.
    """
    log.info("  a few motions of each curve choose the size of the model")
    found = run_jobs(_samples, _each_curve(stored), lambda *_: None, workers, comm)
    samples = [each for _, made in found if not isinstance(made, Exception) for each in made]
    accuracy = stored.scene.basis.accuracy
    return enlarged(
        stored, [each for each in samples if accuracy < each.error(each.point) < np.inf], spare
    )


def curve_motions(stored: StoredModel) -> list[Motion]:
    """The motions of each curve of a model that choose its size, with the peak if one was found.

    Raises:
        ConvergenceError: no curve has a motion.
    """
    found = []
    for own in _each_curve(stored):
        family = family_of(own)
        found += [periodic.recorded_motion(family(p.parameter), p.z) for p in _points(own)]
    if not found:
        raise ConvergenceError("response: no periodic motion was found on any curve")
    return found


def _each_curve(stored: StoredModel) -> list[StoredModel]:
    """The model of each curve."""
    families = results.response_table(stored.scene).families
    if families is None:
        return [stored]
    return [stored.with_values({families.key: value}) for value in families.values]


def _samples(stored: StoredModel) -> list[Sample]:
    """A few motions of the curve of a model."""
    return [Sample.of(stored, point) for point in sorted(_points(stored), key=_height)[-POINTS:]]


def _points(stored: StoredModel) -> list[CurvePoint]:
    """A few points of the curve of a model: its ends, the resonances and the peak beside them."""
    table, family = results.response_table(stored.scene), family_of(stored)
    points: list[CurvePoint] = []
    for value in (table.first, table.last, *_resonances(stored)):
        ask()
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
    return points


def _height(point: CurvePoint) -> float:
    return float(point.amplitude.max())


def _resonances(stored: StoredModel) -> Iterator[float]:
    """The lowest natural frequencies within the range of a curve over the frequency, Hz."""
    table = results.response_table(stored.scene)
    if table.parameter != "frequency":
        return
    try:
        modes = linear_modes(Problem.of(stored.model, stored.scene).settled())
    except ConvergenceError:
        return
    own = [mode.omega / (2.0 * np.pi) for mode in modes]
    yield from [value for value in own if table.low < value < table.high][:RESONANCES]


def cost_in_words(found: results.Response, larger: StoredModel) -> str:
    """What the curves of a larger model cost, by the time that those of a smaller one took."""
    points = [point for curve in found.curves for point in curve.points]
    sliders = points[0].z.size - 2 * found.size if points else 0
    ratio = trust.march_cost(larger.size, sliders) / trust.march_cost(found.size, sliders)
    return f"about {duration(ratio * found.seconds)}"


def worst_checks(
    found: results.Response, stored: StoredModel
) -> list[tuple[StoredModel, trust.Check]]:
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


def _error(check: trust.Check) -> float:
    """The estimated error of an amplitude due to the basis; zero where it is not known."""
    return BASIS_SAFETY * (check.basis_error or 0.0) if check.quantity == "amplitude" else 0.0


def larger_model(found: results.Response, stored: StoredModel, spare: int) -> StoredModel | None:
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
        found = candidate_energies(sample.stored, periodic.motion_of(whole.record, whole.period))
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
) -> periodic.PeriodicMotion | None:
    """The motion of a model with more coordinates at a point of the curve of a model."""
    richer = trust.Richer(family_of(stored.resized(labels)), np.eye(len(labels), stored.size))
    return trust.richer_motion(point, richer)


def contradictions(curve_checks: Sequence[trust.Check], scene: Scene, parameter: str) -> list[str]:
    """Sentences on the points whose stability half the step or a richer basis judges otherwise.

    Args:
        curve_checks: checks of a curve.
        scene: the scene, for units.
        parameter: name of the parameter of the curve.
    """
    said = []
    for who, name, advice in (
        ("half the time step", "finer", "increase time.steps_per_period."),
        (
            "a richer basis",
            "richer",
            'lower basis.threshold, set basis.derivatives = "all", or raise basis.modes.',
        ),
    ):
        groups: dict[tuple[str, str], list[tuple[trust.Check, float]]] = {}
        verdicts = [getattr(check, f"{name}_verdict") for check in curve_checks]
        for check, verdict in zip(curve_checks, verdicts, strict=True):
            if check.contradicts(verdict):
                size = getattr(check, f"{name}_multiplier")
                groups.setdefault((verdict, check.point.verdict), []).append((check, size))
        if not groups:
            continue
        listed = "; ".join(
            f"{_in_words(other)} instead of {_in_words(own)} at {_place(group, scene, parameter)} "
            f"(multipliers up to {_outside(other, group):.2g} outside of the unit circle)"
            for (other, own), group in groups.items()
        )
        found = sum(len(group) for group in groups.values())
        known = sum(verdict is not None for verdict in verdicts)
        said.append(
            f"{who} finds another stability of {found} of {counted(known, 'compared motion')}: "
            f"{listed}; {advice}"
        )
    return said


def inaccuracies(curve_checks: Sequence[trust.Check], scene: Scene, parameter: str) -> list[str]:
    """Sentences on the largest changes by half the time step and by a richer basis.

    The sentences name changes that are larger than the error that a run accepts.

    Args:
        curve_checks: checks of a curve.
        scene: the scene, for units.
        parameter: name of the parameter of the curve.
    """
    said = []
    for name, what, limit, advice in (
        ("step_error", "half the time step", TIME_ERROR, "increase time.steps_per_period"),
        (
            "basis_error",
            "a richer basis",
            BASIS_ERROR,
            "lower basis.threshold or raise basis.modes",
        ),
    ):
        judged = [c for c in curve_checks if c.quantity == "amplitude" or c.where == trust.FOLD]
        sizes = [getattr(check, name) or 0.0 for check in judged]
        worst = max(sizes, default=0.0)
        if worst > limit:
            check = judged[sizes.index(worst)]
            changed = "amplitude" if check.where != trust.FOLD else f"{parameter} of a fold"
            said.append(
                f"{what} changes the {changed} by {in_percent(worst)} at "
                f"{in_words(scene, parameter, check.point.parameter)} (a run accepts an error of "
                f"{in_percent(limit)}): {advice}."
            )
    return said


def unknown_errors(curve_checks: Sequence[trust.Check], title: str) -> list[Note]:
    """Notes on errors that are unknown; only that of the largest amplitude casts doubt.

    Args:
        curve_checks: checks of a curve.
        title: of the curve.
    """
    compared = [check for check in curve_checks if check.compared]
    top = next((check for check in curve_checks if check.where == trust.LARGEST), None)
    said = []
    if curve_checks and (top is None or top.step_error is None):
        text = (
            "the change of the largest amplitude by half the time step is unknown: its motion was "
            "not found."
        )
        said.append(Note(NoteKind.UNCHECKED, text, curve=title, quantity=AMPLITUDES))
    if unknown := sum(check.unknown for check in compared):
        largest = any(check.unknown and check.where == trust.LARGEST for check in compared)
        named = f", {'among them ' * (unknown > 1)}the one of the largest amplitude" * largest
        text = (
            f"the change by a richer basis is unknown at {unknown} of "
            f"{counted(len(compared), 'compared motion')}{named}: with the richer basis, Newton's "
            f"method did not find {'it' if unknown == 1 else 'them'}; next to a fold there may be "
            "none."
        )
        kind = NoteKind.UNCHECKED if largest else NoteKind.REMARK
        said.append(Note(kind, text, curve=title, quantity=AMPLITUDES))
    return said


def _place(group: Sequence[tuple[trust.Check, float]], scene: Scene, parameter: str) -> str:
    """Where some checks of a curve are: a value of the parameter, or a range."""
    values = [check.point.parameter for check, _ in group]
    if len(values) == 1:
        return in_words(scene, parameter, values[0])
    last = in_words(scene, parameter, max(values))
    return f"{len(values)} points from {parameter} = {min(values):.6g} to {last}"


def _outside(other: str, group: Sequence[tuple[trust.Check, float]]) -> float:
    """How far outside of the unit circle a multiplier is, where the instability is found."""
    return (
        max(trust.size_of(check.point) if other == "stable" else size for check, size in group)
        - 1.0
    )


def _in_words(verdict: str) -> str:
    """The stability of a motion in words."""
    return verdict if verdict == "stable" else f"unstable ({verdict})"


REDUCED_TOLERANCE = 1e-8  # of the residual of the reduced motion, relative to the variables


def add_full_points(found: results.Response, stored: StoredModel, solid: Any, basis: Array) -> None:
    """Compute the motions of the full model that a scene asks for, and add them to its curves.

    At each value of `response.full` the reduced motion is taken from the curve: the stable motion
    with the largest amplitude or, if all motions are unstable, the motion with the largest
    amplitude. If a motion is not found, a warning is added, and `found.unfinished` holds the error.

    Args:
        found: the curves.
        stored: the reduced model.
        solid: the solid it was made from.
        basis: (local, n) vectors of its basis.
    """
    from fenicsrom.assess.full.full_motions import full_periodic_motion  # needs dolfinx

    families = found.table.families
    try:
        for curve in found.curves:
            current, begin = stored, ""
            if families is not None:
                current = stored.with_values({families.key: curve.value})
                begin = results.curve_title(found.scene, curve.value)
            family = family_of(current)
            for value in found.table.full_values:
                name = f"{begin}full model at {in_words(found.scene, found.table.parameter, value)}"
                try:
                    shooting, reduced = _reduced_motion(current, family, curve, value)
                    log.info(f"  {name}")
                    motion = full_periodic_motion(solid, basis, shooting, reduced)
                except Exception as problem:
                    error = job_error(problem)
                    note = Note(NoteKind.LEFT_OUT, f"{name}: {error}", curve=begin)
                    found.warnings.append(note)
                    found.unfinished = found.unfinished or error
                    continue
                curve.full.append(
                    results.FullPoint(
                        parameter=value,
                        amplitude=motion.amplitude,
                        reduced_amplitude=reduced.amplitude,
                        verdict=reduced.verdict,
                        periods=motion.periods,
                        derived=motion.derived,
                        residual=motion.residuals[-1],
                        seconds=motion.seconds,
                    )
                )
    except KeyboardInterrupt:
        found.interrupted = True


def _reduced_motion(
    stored: StoredModel, family: periodic.Family, curve: results.ResponseCurve, value: float
) -> tuple[periodic.Shooting, periodic.PeriodicMotion]:
    """The equation and the reduced motion of a curve at a value of the parameter.

    Raises:
        ConvergenceError: the curve has no motion there.
    """
    crossings = [found for piece in curve.pieces for found in piece.crossings(value)]
    crossings.sort(
        key=lambda found: (
            found[0].stable and found[1].stable,
            max(float(point.amplitude.max()) for point in found[:2]),
        ),
        reverse=True,
    )
    shooting = periodic.Shooting(family(value))
    for _, _, near in crossings:
        try:
            return shooting, periodic.solve(shooting, near, REDUCED_TOLERANCE)
        except ConvergenceError:
            continue
    key = results.response_table(stored.scene).parameter
    raise ConvergenceError(f"the response curve has no motion at {key} = {value:.6g}")

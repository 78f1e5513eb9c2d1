"""How far the program can be pushed: extreme variants of a scene, and a verdict on each run.

Each axis (`assess.studies.axes`) goes from ordinary to extreme values, first alone and then in the
worst pairs. A run is made as a user would make it, and again with half the step (an eighth of the
tolerance) and, where the basis is in question, with a richer basis. The verdict of a run is one of

    converged       the error is at most its own estimate; a periodic motion settles
    not steady      a bounded motion does not repeat, the run says so, and its energy balances
    refused         no result: a SceneError, ConvergenceError or AccuracyError says why
    silently wrong  the error exceeds its own estimate, the motion creates energy or is unbounded,
                    or any other exception is raised

The estimates of a run are `fenicsrom.assess.errors.estimates.step_errors` and `basis_errors`, which
`fenicsrom run` checks and prints too. Random variants (`assess.studies.random_cases`) are also
compared with the full model at the same time steps.
"""

from __future__ import annotations

import time as clock
import tomllib
from collections.abc import Iterable, Mapping, Sequence
from contextlib import nullcontext
from dataclasses import dataclass, field
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from fenicsrom.assess.errors.estimates import MotionErrors
from fenicsrom.assess.errors.verdicts import BASIS_ERROR, estimate_errors
from fenicsrom.assess.full.full_motions import estimates_found, full_distances, missed
from fenicsrom.assess.studies.axes import AXES, Case, cases_of, scales_of
from fenicsrom.assess.studies.batch import Batch
from fenicsrom.assess.studies.random_cases import random_cases
from fenicsrom.errors import AccuracyError, ConvergenceError, ErrorKind, SceneError, refuse
from fenicsrom.notes import Note, NoteKind
from fenicsrom.online.motion.measures import (
    amplitude,
    difference,
    has_settled,
    is_unsteady,
    peak_normal_force,
)
from fenicsrom.online.motion.motion import Motion, check_energy, friction_gains_energy
from fenicsrom.online.run.simulate import simulate
from fenicsrom.progress import log
from fenicsrom.scene import Scene, override_table, parse_scene, read_scene, scene_table
from fenicsrom.scene.checks.checks import require_motion
from fenicsrom.scene.reading.reading import refined
from fenicsrom.words import brief, counted

if TYPE_CHECKING:
    from fenicsrom.reduction.stages import Reduction


class Verdict(StrEnum):
    """The verdicts on a run, from the best to the worst."""

    CONVERGED = "converged"
    UNSTEADY = "not steady"
    REFUSED = "refused"
    WRONG = "silently wrong"


NEGLIGIBLE = 1e-3  # a smaller relative difference always counts as zero
UNITS_ERROR = 1e-6  # largest relative difference between runs in different units
# largest relative difference of the root mean squares of motions that do not settle
UNSTEADY_ERROR = 0.5
WORKERS = 2


@dataclass(frozen=True)
class Finding:
    """The result of a case.

    Attributes:
        case: the case.
        verdict: the verdict.
        why: the reason for the verdict; the error message if the run was refused.
        amplitude: amplitude of the contact point or probe, m.
        estimate: the run's own estimate of its relative error due to the time step.
        basis_estimate: the run's own estimate of its relative error due to the basis.
        error: relative difference from the refined run.
        basis_error: relative difference from the richer basis.
        force_error: relative difference between the peak normal forces of the run and the refined
            run.
        imbalance: relative imbalance of the energy.
        steady: whether the motion repeats to the tolerance of the scene.
        periods: number of periods run.
        seconds: run time of all runs of the case.
        force_estimate: the run's own estimate of the force error, infinite where the step does not
            resolve the contact.
        buckled: number of directions in which the straight equilibrium is unstable.
    """

    case: Case
    verdict: Verdict
    why: str = ""
    amplitude: float | None = None
    estimate: float | None = None
    basis_estimate: float | None = None
    error: float | None = None
    basis_error: float | None = None
    force_error: float | None = None
    imbalance: float | None = None
    steady: bool | None = None
    periods: int | None = None
    seconds: float = 0.0
    force_estimate: float | None = None
    buckled: int = 0


@brief()
@dataclass(eq=False, repr=False)
class Matrix:
    """All findings of a scene.

    Attributes:
        scene: the scene.
        findings: one finding for each case.
        seconds: run time of all runs.
        left_out: a sentence for each axis that the scene does not have.
        files: the written files, the one to open first at the head.
    """

    scene: Scene
    findings: list[Finding]
    seconds: float
    left_out: list[str] = field(default_factory=list)
    files: list[Path] = field(default_factory=list)

    @property
    def warnings(self) -> list[Note]:
        """A note if runs are wrong or failed."""
        wrong = self.count(Verdict.WRONG)
        text = f"{wrong} of {counted(len(self.findings), 'run')} are silently wrong"
        return [Note(NoteKind.ERROR, text)] if wrong else []

    @property
    def failed(self) -> bool:
        """Whether a run is silently wrong."""
        return self.count(Verdict.WRONG) > 0

    def count(self, verdict: Verdict) -> int:
        """Number of runs with a verdict."""
        return sum(finding.verdict == verdict for finding in self.findings)


# ---------------------------------------------------------------------- scenes and models


def load(path: Path, changes: Sequence[str] = ()) -> tuple[dict[str, Any], Scene]:
    """The table of a scene file under overrides, in SI units, and the scene.

    Raises:
        SceneError: the scene is wrong.
    """
    scene = read_scene(path, changes)
    if not scene.units.is_si:
        return scene_table(scene), scene
    table = tomllib.loads(path.read_text(encoding="utf-8-sig"))
    return override_table(table, changes, str(path)), scene


def scene_of(table: Mapping[str, Any], source: str, folder: Path, changes: Iterable[str]) -> Scene:
    """The scene of a table under overrides; a new way to set the step replaces the old one.

    Raises:
        SceneError: an override is not allowed.
    """
    changes = list(changes)
    plain = dict(table)
    plain["reference"] = {**plain.get("reference", {}), "full": False}
    return parse_scene(override_table(plain, changes, source), source, folder)


def build(scene: Scene, model: str) -> tuple[Any, Reduction | None, Any]:
    """The model of a scene.

    Args:
        scene: the scene.
        model: "reduced", "full" or "beam".

    Returns:
        The model; the stages of the reduced model and the solid, or None.

    Raises:
        SceneError, ConvergenceError, AccuracyError: an offline stage failed.
    """
    from mpi4py import MPI

    from fenicsrom.fem.full.full import full_model
    from fenicsrom.fem.solid.solid import build_solid
    from fenicsrom.reduction.beam import beam_model
    from fenicsrom.reduction.stages import Reduction
    from fenicsrom.reduction.training import motion_of_scene, train

    if model == "beam":
        return beam_model(scene), None, None
    solid = build_solid(scene, MPI.COMM_SELF)
    if model == "full":
        return full_model(solid), None, None
    if scene.basis.masters == "motion":
        train(solid, scene, lambda each: motion_of_scene(each.model, scene), [scene])
    found = Reduction(solid, scene, lambda stage: nullcontext())
    return found.model, found, solid


# ---------------------------------------------------------------------- a run and its verdict


def examine(case: Case, table: Mapping[str, Any], source: str, folder: Path) -> Finding:
    """Run a case and its refined runs, and judge the case."""
    begin = clock.perf_counter()
    numbers: dict[str, Any] = {}
    try:
        verdict, why = _examine(case, table, source, folder, numbers)
    except (SceneError, ConvergenceError, AccuracyError) as error:
        verdict, why = Verdict.REFUSED, f"{type(error).__name__}: {error}"
    except Exception as error:
        verdict, why = Verdict.WRONG, f"{type(error).__name__}: {error}".splitlines()[0]
    return Finding(case, verdict, why, **numbers, seconds=clock.perf_counter() - begin)


def _examine(
    case: Case, table: Mapping[str, Any], source: str, folder: Path, numbers: dict[str, Any]
) -> tuple[Verdict, str]:
    """The verdict on a case and its reason; the measured values are written into `numbers`."""
    from fenicsrom.reduction.candidates import candidate_model

    scene = scene_of(table, source, folder, case.overrides)
    model, reduction, solid = build(scene, case.model)
    motion = simulate(model, scene)
    numbers |= {
        "amplitude": float(np.linalg.norm(amplitude(motion))) * case.scale,
        "imbalance": motion.relative_imbalance,
        "steady": motion.steady,
        "periods": motion.periods,
        "buckled": motion.buckled,
    }
    check_energy(motion)
    if wrong := unphysical(motion, scene.time.scheme):
        return Verdict.WRONG, wrong
    candidates = None if reduction is None else candidate_model(solid, scene.basis, reduction)
    own: dict[str, MotionErrors] = {}
    try:
        estimate_errors(model, candidates, scene, motion, own)
    finally:
        numbers |= estimates_found(own)
    # the estimate of a motion that does not settle knows a quarter of the step already
    fine = simulate(model, refined(scene, 8 if is_unsteady(motion) else 2))
    numbers["error"] = difference(motion, fine)
    peak = peak_normal_force(fine)
    numbers["force_error"] = abs(peak_normal_force(motion) / peak - 1.0) if peak else None
    if case.scale != 1.0:
        plain = scene_of(table, source, folder, ())
        other = float(np.linalg.norm(amplitude(simulate(build(plain, case.model)[0], plain))))
        apart = abs(numbers["amplitude"] / other - 1.0)
        if apart > UNITS_ERROR:
            return Verdict.WRONG, f"in SI units the amplitude differs by {apart:.1e}"
    if case.full:
        assert reduction is not None
        error = full_distances(reduction.basis.vectors, solid, scene, motion)
        numbers["basis_error"] = error.amplitude
        if reason := missed(error.amplitude, own["basis"].amplitude):
            return Verdict.WRONG, reason
    if case.richer:
        rich = scene_of(table, source, folder, (*case.overrides, *case.richer))
        numbers["basis_error"] = difference(motion, simulate(build(rich, case.model)[0], rich))
    return verdict_of(motion, fine, numbers)


def unphysical(motion: Motion, scheme: str) -> str:
    """The reason why a motion is not physical, such as a value that is not finite, or ""."""
    arrays = (motion.displacement, motion.kinetic, motion.elastic, motion.force)
    if not all(np.all(np.isfinite(array)) for array in arrays):
        return "a result is not a finite number"
    if scheme == "discrete-gradient" and friction_gains_energy(motion):
        return "friction gives energy to the motion in a step"
    return ""


def verdict_of(motion: Motion, fine: Motion, numbers: Mapping[str, Any]) -> tuple[Verdict, str]:
    """The verdict on a motion that passed its own checks, and the reason.

    Args:
        motion: the motion.
        fine: the motion with half the step, or with an eighth if the motion does not settle.
        numbers: `error`, `estimate` and `force_estimate` of the motion, and `basis_error` if it was
            compared with a richer basis.
    """
    error, estimate = numbers["error"], numbers["estimate"]
    if is_unsteady(motion):
        if error > max(UNSTEADY_ERROR, estimate):
            return Verdict.WRONG, f"with an eighth of the step the motion differs by {error:.0%}"
        return Verdict.UNSTEADY, _why_unsteady(motion, fine)
    if motion.steady and is_unsteady(fine):
        return Verdict.WRONG, "the motion is steady, but it does not settle with half the step"
    if error > max(NEGLIGIBLE, estimate):
        why = f"the error against half the step is {error:.1e}, but the estimate is {estimate:.1e}"
        return Verdict.WRONG, why
    if is_unsteady(fine):
        why = "the amplitudes settle but the motion does not; with half the step neither settles"
        return Verdict.UNSTEADY, why
    if (apart := numbers.get("basis_error", 0.0)) > BASIS_ERROR:
        return Verdict.WRONG, f"the amplitude differs by {apart:.1e} from that of a richer basis"
    remarks = {
        "the preload has buckled the body at the start": motion.buckled > 0,
        "small waves persist: the amplitudes settle, the motion does not": motion.period is not None
        and not motion.steady,
        "the step does not resolve the contact: its peak force is unknown": not np.isfinite(
            numbers["force_estimate"]
        ),
    }
    return Verdict.CONVERGED, "; ".join(remark for remark, holds in remarks.items() if holds)


def _why_unsteady(motion: Motion, fine: Motion) -> str:
    """Why a motion does not repeat, from what Newton's method found in its run."""
    reasons = [f"the motion does not repeat after {counted(motion.periods, 'period')}"]
    search = motion.search
    if search is not None and search.verdict == "not found":
        reasons.append("Newton's method found no periodic motion")
    elif search is not None:
        size = f"largest multiplier {abs(search.multipliers[0]):.5g}"
        reasons.append(
            f"a stable periodic motion exists ({size}), but it is not reached"
            if search.verdict == "stable"
            else f"the periodic motion is unstable ({search.verdict}, {size})"
        )
    if has_settled(fine):
        reasons.append("with an eighth of the step it settles")
    return "; ".join(reasons)


# ---------------------------------------------------------------------- all runs


def stability(
    path: Path,
    changes: Sequence[str],
    axes: Sequence[str] = (),
    workers: int = WORKERS,
    variants: int = 0,
    seed: int = 0,
) -> Matrix:
    """Drive a scene to its extremes, and judge every run.

    Args:
        path: the scene file.
        changes: overrides for every run.
        axes: names of the axes to run (`fenicsrom.assess.studies.axes.AXES`); by default all axes.
        workers: number of processes that share the runs.
        variants: number of random variants to run instead of the axes; 0 runs the axes.
        seed: seed of the random variants.

    Raises:
        SceneError: the scene itself is wrong, nothing moves in it, there is no such axis, or axes
            and random variants are given together; or random variants of bodies that touch.
        ConvergenceError, AccuracyError: the reduced model of the scene itself cannot be made.
    """
    begin = clock.perf_counter()
    if axes and variants:
        reason = "not allowed with --axis, because random variants are not on an axis"
        raise refuse(f"--random {variants}", reason, ErrorKind.CONFLICT)
    for axis in axes:
        if axis not in AXES:
            reason = f"axis {axis!r} does not exist; the axes are {', '.join(AXES)}"
            raise SceneError(reason, kind=ErrorKind.UNKNOWN_KEY, key=axis)
    from fenicsrom.reduction.modes import with_mode_count

    table, scene = load(path, changes)
    require_motion(scene, "stability")
    if variants and scene.joined:
        reason = "not allowed with a contact against a region, without which a variant may be"
        raise refuse(f"--random {variants}", reason, ErrorKind.CONFLICT)
    polynomial = scene_of(table, scene.source, path.parent, ["basis.elastic_force='polynomial'"])
    model, built, _ = build(polynomial, "reduced")
    assert built is not None
    scales = scales_of(model, polynomial)
    scene = with_mode_count(scene, built.modes)
    wanted, left_out = cases_of(scene, scales, axes)
    if variants:
        wanted, left_out = random_cases(scene, scales, variants, seed), []
    for sentence in left_out:
        log.info(sentence)
    findings = run_all(wanted, table, scene.source, path.parent, workers)
    return Matrix(scene, findings, clock.perf_counter() - begin, left_out)


def run_all(
    wanted: Sequence[Case],
    table: Mapping[str, Any],
    source: str,
    folder: Path,
    workers: int = WORKERS,
) -> list[Finding]:
    """Examine cases in several processes; the findings are in the order of the cases.

    Args:
        wanted: the cases.
        table: table of the scene that the cases change.
        source: name of the scene file, for messages.
        folder: folder of the scene file, to which the path of its mesh is relative.
        workers: number of processes.
    """

    def finding(k: int, found: Any) -> Finding:
        """The finding of a case, also of one that ended with an error."""
        failed = isinstance(found, Exception)
        return Finding(wanted[k], Verdict.WRONG, str(found)) if failed else found

    def say(k: int, found: Any) -> str:
        one, case = finding(k, found), wanted[k]
        why = f": {one.why}" if one.why else ""
        return f"{case.axis}, {case.value} ({case.model}): {one.verdict}{why}"

    batch = Batch("run", workers=workers, interval=0.0)
    found = batch.each(_job, [(case, table, source, folder) for case in wanted], say)
    if batch.interrupted:
        raise KeyboardInterrupt
    return [finding(k, found[k]) for k in range(len(wanted))]


def _job(job: tuple[Case, Mapping[str, Any], str, Path]) -> Finding:
    """`examine` as a job."""
    return examine(*job)

"""The work of the stages that integrate the models and check their motions."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

from fenicsrom.errors import AccuracyError, ConvergenceError, SceneError
from fenicsrom.notes import Note, NoteKind
from fenicsrom.progress import log
from fenicsrom.study.building import resize
from fenicsrom.study.stage import Run

if TYPE_CHECKING:
    from fenicsrom.online.motion.motion import Motion
    from fenicsrom.online.store.archive import Meshes
    from fenicsrom.records import Rerun, Study
    from fenicsrom.scene import Scene

Failure = AccuracyError | ConvergenceError

LONG = 5.0
"""The steps of a reduced motion that takes longer are timed against the full model, s."""

TIMED_STEPS = 10
"""Time steps of the full model that are timed: a period of the loads in long steps."""


def integrate(run: Run, name: str) -> None:
    """Integrate one model: "reduced", "full" or "beam"."""
    from fenicsrom.assess.errors.plausibility import implausible_loads, is_explained
    from fenicsrom.online.motion.motion import attempted

    study, scene = run.study, run.study.scene
    if name == "reduced" and study.modes is not None and not is_explained(study.warnings):
        found = implausible_loads(
            study.model, scene, study.modes.frequencies_hz, study.solid.extent
        )
        study.warnings.extend(found)
        for text in found:  # said now, because a wrong scene may run for long
            log.info(f"  warning: {text}")
    try:
        if name == "reduced":
            options = _checkpoints(run) | {"keep_coordinates": True}
            motion, error = integrated(study.model, scene, **options)
        else:
            motion, error = attempted(lambda: _full_motion(run, name))
    except (AccuracyError, ConvergenceError) as at_start:
        study.unfinished = (name, at_start)
        return
    if error is not None:
        study.unfinished = (name, error)
    if name == "full" and not study.unfinished:
        motion = _settled(run, motion)
    study.motions[name] = motion
    if study.unfinished or name != "reduced" or not scene.basis.adapts:
        _describe(study, name)  # of a motion that the size stage may replace, that stage does it


def integrated(model: Any, scene: Scene, **options: Any) -> tuple[Motion, Failure | None]:
    """Integrate a model.

    Args:
        model: the model.
        scene: the scene.
        options: of `simulate`. A finished motion as `resume` is returned: it lacks its checks only.

    Returns:
        The motion, up to the failure if there was one, and the failure; errors as `attempted`.
    """
    from fenicsrom.online.motion.motion import Motion, attempted
    from fenicsrom.online.run.simulate import simulate

    if isinstance(options.get("resume"), Motion):
        return options["resume"], None
    return attempted(lambda: simulate(model, scene, **options))


def _describe(study: Study, name: str) -> None:
    """Note the run time of a motion, what never touches, and what limits its meaning. Collective.

    Args:
        study: the record.
        name: the model: "reduced", "full" or "beam".
    """
    from fenicsrom.assess.errors.plausibility import implausible_motion, is_explained
    from fenicsrom.online.motion.measures import out_of_reach
    from fenicsrom.post.run.report import motion_warnings

    scene, motion = study.scene, study.motions[name]
    if name == "reduced" and scene.contacts:
        study.left_out += out_of_reach(motion, study.solid.points)
    if name == "reduced" and not is_explained(study.warnings):
        found = implausible_motion(motion, study.solid.points, study.solid.extent, scene)
        study.warnings.extend(found or _strain_warnings(study, motion))
    if study.unfinished:
        return
    study.warnings.extend(motion_warnings(name, motion, scene))
    study.seconds[f"{name} motion"] = motion.seconds  # without the compilation


def _full_motion(run: Run, name: str) -> Motion:
    """The motion of the full model, or of the beam; from the cache if the surface does not wear.

    A motion of the cache has no worn surface at its end.
    """
    from fenicsrom.assess.full.full_motions import full_motion
    from fenicsrom.reduction.beam import beam_structure

    study, scene = run.study, run.study.scene
    body = study.solid if name == "full" else beam_structure(scene)
    cached = run.cached and not scene.wears
    motion, note = full_motion(body, scene, name, run.fresh, cached)
    if note["cached"]:
        reason = f"taken from a run at {note['date']}; --fresh computes it again"
        study.left_out.append(Note(NoteKind.LEFT_OUT, reason, f"{name} motion"))
    return motion


def _settled(run: Run, full: Motion) -> Motion:
    """The periodic motion of the full model where its march has not settled. Collective."""
    from fenicsrom.assess.full.full_motions import settled_full_motion

    study = run.study
    if study.basis is None:
        return full
    vectors, motion = study.basis.vectors, study.motions["reduced"]
    models = study.solid, vectors, study.model
    found, said = settled_full_motion(*models, study.scene, motion, full, run.fresh, run.cached)
    study.warnings.extend([Note(NoteKind.UNSETTLED, said)] if said else [])
    return found


def see_residual(run: Run) -> None:
    """Let the residual of the full equations along the motion judge the basis. Collective."""
    from dataclasses import replace

    from fenicsrom.assess.errors import judge
    from fenicsrom.assess.errors.sizing import accuracy_limit, candidate_motion, limited, unreached

    study, motion, sized = run.study, run.study.motions["reduced"], run.study.sized
    stored, known = study.stored, study.judge
    other = candidate_motion(stored, motion) if sized is None else sized.other
    if other is None:
        return
    if known is not None and known.labels == stored.labels:  # from the cache
        found, _ = judge.judge_again(known, motion, other)
    else:
        found = judge.judge_with_residual(
            study.solid, study.modes, study.extended, stored, motion, other
        )
    study.judge, study.errors["basis"] = found.stored, found.errors
    if sized is None or stored.scene.basis.size is not None or sized.warning is not None:
        return
    limit, error = accuracy_limit(stored, motion), limited(stored.scene, found.errors)
    if error > limit:
        study.sized = replace(sized, warning=unreached(stored, error, limit))
        study.warnings.append(study.sized.warning)


def fit_size(run: Run) -> None:
    """Let the reduced model take coordinates until its basis is accurate enough. Collective."""
    from fenicsrom.assess.errors.sizing import fitted
    from fenicsrom.online.store.archive import save_model
    from fenicsrom.post.base.origin import MODEL

    study, stored = run.study, run.study.stored
    motion = study.motions["reduced"]
    study.sized = found = fitted(stored, motion, study.warnings)
    if found is not None and found.stored is not stored:
        resize(study, found.stored)
        study.motions["reduced"] = found.motion
        if run.folder is not None and run.comm.rank == 0:
            save_model(run.folder / MODEL, found.stored)
    _describe(study, "reduced")


def _strain_warnings(study: Study, motion: Motion) -> list[Note]:
    """Warn of contacts between bodies that turn, and of large strains. Collective.

    Strains are judged in a large motion, if the stresses are not found anyway.
    """
    from fenicsrom.assess.errors.plausibility import LARGE_MOTION, motion_warnings

    moved = float(abs(motion.displacement).max(initial=0.0))
    small = moved < LARGE_MOTION * study.solid.extent
    strains = not small and study.scene.output.stresses == "none"
    if study.basis is None or not (strains or study.scene.joined):
        return []
    return motion_warnings(study.solid, study.scene, study.basis.vectors, motion, strains)


def check_beam(study: Study) -> None:
    """Check that the 1D beam stands for the solid."""
    from fenicsrom.assess.errors import comparisons as beam_check

    beam_check.check_beam(study.solid, study.scene)


def compare_modes(study: Study) -> None:
    """Compare the modes of the reduced model with those of the full model. Collective."""
    from fenicsrom.assess.errors.comparisons import mode_agreement

    assert study.basis is not None
    try:
        study.agreement = mode_agreement(study.solid, study.basis.vectors)
    except (AccuracyError, ConvergenceError) as error:
        text = f"the modes of the full model were not compared: {error}"
        study.warnings.append(Note(NoteKind.LEFT_OUT, text))


def _checkpoints(run: Run) -> dict[str, Any]:
    """Load what the run resumes from, write the model, and prepare the next checkpoints.

    Raises:
        SceneError: the checkpoint does not belong to this model and scene, or the model has no
            such `basis.size`.
        OSError: a file cannot be written.
    """
    from fenicsrom.online.model.model import ReducedModel
    from fenicsrom.online.store.archive import load_model, save_model
    from fenicsrom.online.store.store import keeper, load_start
    from fenicsrom.post.base.origin import MODEL
    from fenicsrom.post.run.summary import CHECKPOINT

    study = run.study
    if not isinstance(study.model, ReducedModel):
        return {}
    options: dict[str, Any] = {}
    stored = study.stored
    if run.resume is not None:
        beside = run.resume.parent / MODEL  # it says which coordinates joined the first ones
        if beside.exists():
            labels = load_model(beside).labels
            if set(labels) <= {*stored.labels, *stored.further}:
                resize(study, stored.resized(labels))
        options["resume"] = load_start(run.resume, study.model, study.scene)
    if run.folder is not None and run.comm.rank == 0:
        save_model(run.folder / MODEL, study.stored)
        study.files.append(run.folder / MODEL)
        keep = keeper(run.folder / CHECKPOINT, study.model, study.scene)
        options["checkpoint"] = keep
    return options


def check(study: Study) -> None:
    """Estimate the errors of the motions; an error that is too large makes the study unfinished."""
    from fenicsrom.reduction.training import unsettled

    meshes = None if study.finer is None else study.stored.meshes
    study.unfinished = checked(study, meshes)
    same = unsettled(study.trained, study.scene, study.motions["reduced"])
    study.warnings.extend([*same, *slower_than_solid(study)])


def checked(found: Study | Rerun, meshes: Meshes | None) -> tuple[str, Failure] | None:
    """Write the estimated errors of the motions; give the model and the error that rejects it."""
    from fenicsrom.assess.errors.shortening import shortening_notes
    from fenicsrom.assess.errors.verdicts import error_notes, estimate_errors
    from fenicsrom.online.model.model import ReducedModel
    from fenicsrom.online.motion.motion import check_energy
    from fenicsrom.reduction.training import beyond, duration, probe_amplitude

    name, scene, motions = "", found.scene, found.motions
    sized = None if found.sized is None else found.sized.errors
    basis = found.errors.pop("basis", sized)  # that of the residual sees more
    try:
        for name in motions:
            check_energy(motions[name])
        name, motion = "reduced", motions["reduced"]
        model, candidates = found.model, found.candidates
        estimate_errors(model, candidates, scene, motion, found.errors, basis, meshes)
    except (AccuracyError, ConvergenceError) as error:
        return name, error
    outside = beyond(found.trained, scene, probe_amplitude(motion), duration(motion))
    if outside and "basis" in found.errors:
        found.errors["basis"] = found.errors["basis"]._replace(dissipation=math.inf)
    notes = error_notes(scene, found.errors, motion)
    said = {note.quantity for note in outside}
    found.warnings.extend([*outside, *(note for note in notes if note.quantity not in said)])
    if scene.damping.stiffness > 0.0 and isinstance(found.model, ReducedModel):
        found.warnings.extend(shortening_notes(found.stored, motion))
    return None


def slower_than_solid(study: Study) -> list[Note]:
    """Warn of a reduced model whose time steps take longer than those of the full model.

    Only where the motion took long, and the full model did not run. Collective.
    """
    from fenicsrom.online.run.simulate import simulate
    from fenicsrom.post.run.report import step_sentence
    from fenicsrom.scene.reading.reading import with_time

    scene, solid, motion = study.scene, study.solid, study.motions["reduced"]
    if solid.comm.bcast(motion.seconds) < LONG or "full" in study.motions or scene.period is None:
        return []
    from fenicsrom.fem.full.full import full_model

    period = with_time(scene, periods=1, steady="march")
    try:
        coarse = with_time(period, steps_per_period=TIMED_STEPS)
        full = simulate(full_model(solid), coarse)
        reduced = simulate(study.model, period)
    except (AccuracyError, ConvergenceError, SceneError):  # the long steps cannot be taken
        return []
    said = step_sentence(reduced.seconds / reduced.steps, full.seconds / full.steps)
    return [] if said is None else [said]


def stresses(run: Run) -> None:
    """Find the largest stresses, and the reactions."""
    from dataclasses import replace

    import numpy as np

    from fenicsrom.assess.errors.plausibility import state_warnings
    from fenicsrom.online.stress.reactions import find_stresses, modal_peaks

    study = run.study
    assert study.recovery is not None
    motion = study.motions.get("reduced")
    known = {} if study.basis is None else study.stored.normal_modes
    found = find_stresses(study.recovery, study.scene, study.model, motion, known)
    if study.basis is None and study.modes is not None:
        count = study.modes.normal.shape[1]
        names = study.modes.labels[:count]
        modal = modal_peaks(study.recovery.stress, study.modes.frequencies_hz, np.eye(count), names)
        found = replace(found, modes=modal)
    study.stresses = found
    study.warnings.extend(state_warnings(found, motion_only=True))

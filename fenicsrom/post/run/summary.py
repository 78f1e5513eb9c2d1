"""The numbers of a run: `summary.json`, `history.npz`, the reduced model and the checkpoint."""

from collections.abc import Mapping
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np

from fenicsrom.assess.errors.estimates import MotionErrors
from fenicsrom.assess.errors.mesh_check import of_model
from fenicsrom.assess.errors.sizing import Sized
from fenicsrom.assess.errors.verdicts import CONTACT, contact_quantities
from fenicsrom.notes import (
    AMPLITUDES,
    DEFLECTION,
    FREQUENCIES,
    STABILITY,
    STRESSES,
    verdict_of,
)
from fenicsrom.online.contact.points import ContactPoints, contacts_of
from fenicsrom.online.model.model import ReducedModel
from fenicsrom.online.model.support_motion import moves_supports, support_displacement
from fenicsrom.online.motion.history import HISTORY_ARRAYS, JUMP
from fenicsrom.online.motion.measures import (
    absolute_displacement,
    amplitudes,
    errors_percent,
    point_summaries,
    response_summary,
)
from fenicsrom.online.motion.motion import Motion
from fenicsrom.online.motion.wear import worn_under_points
from fenicsrom.online.store.archive import StoredModel
from fenicsrom.online.store.checkpoints import save_end
from fenicsrom.online.store.provenance import provenance
from fenicsrom.post.base.directions import in_order
from fenicsrom.post.base.report import failure_of, told
from fenicsrom.post.base.writers import write_arrays, write_rows, write_summary
from fenicsrom.post.paraview.fields import contact_places
from fenicsrom.post.run.mode_agreement import agreement_summary
from fenicsrom.post.run.run_up import RUN_UP, run_up_rows, run_up_summary
from fenicsrom.post.run.stress_tables import stress_summary, write_stresses
from fenicsrom.post.run.wear import wear_summary, write_wear
from fenicsrom.records import Rerun, Study
from fenicsrom.scene import Scene

SUMMARY = "summary.json"
HISTORY = "history.npz"
CHECKPOINT = "checkpoint.npz"


def summary(found: Study | Rerun) -> dict[str, Any]:
    """Collect the contents of `summary.json`."""
    first = _of_model(found) if isinstance(found, Rerun) else _of_stages(found)
    begin = {"dofs": first.pop("dofs"), "frequencies_hz": found.frequencies_hz}
    contents = {"scene": found.scene.source, **begin, **first}
    contents |= motions_summary(found)
    contents |= support_summary(found)
    contents |= wear_summary(found.motions, found.scene, found.points)
    contents["estimated_error_percent"] = estimates_summary(found.errors)
    if found.stresses is not None:
        contents |= stress_summary(found.stresses)
    if found.unfinished is not None:
        model, reason = found.unfinished
        contents["unfinished"] = {"model": model, "reason": str(reason)}
    judged = verdict_of(
        found.warnings,
        failure_of(found),
        quantities=quantities(found),
        unjudged=unjudged(found),
    )
    contents |= told(judged, found.warnings)
    contents["provenance"] = found.stored.provenance if isinstance(found, Rerun) else provenance()
    return contents


def quantities(found: Study | Rerun) -> list[str]:
    """The quantities of a run that a user reads; each has its own judgement."""
    reduced = found.motions.get("reduced")
    read = {
        AMPLITUDES: bool(found.motions),
        **dict.fromkeys(contact_quantities(found.scene), bool(found.motions)),
        STABILITY: reduced is not None and reduced.search is not None,
        FREQUENCIES: found.frequencies_hz.size > 0,
        DEFLECTION: isinstance(found, Study) and found.deflection is not None,
    }
    return [name for name, is_read in read.items() if is_read]


def unjudged(found: Study | Rerun) -> list[str]:
    """The quantities of a run that a user reads, and whose errors are not estimated."""
    return [] if found.stresses is None else [STRESSES]


def _of_stages(study: Study) -> dict[str, Any]:
    """What `summary.json` has of the stages of a scene."""
    basis, modes = study.basis, study.modes
    found: dict[str, Any] = {
        "dofs": study.solid.free,
        "basis": {
            "method": study.scene.basis.method,
            "size": basis.size if basis else None,
            "labels": list(study.labels),
            "dropped": basis.dropped if basis else {},
            "mass_condition": basis.condition if basis else None,
            "flexibility_condition": modes.flexibility_condition if modes is not None else None,
            "participation": study.selection.modal_coordinates,
            "weights": study.selection.weights,
            "derivatives": study.derivatives.sizes if study.derivatives is not None else {},
            **size_summary(study.sized),
        },
        "seconds": study.seconds,
        "left_out": left_out(study),
    }
    if study.contact_hz is not None:
        free, stuck = study.contact_hz.T
        found["contact_frequencies_hz"] = {"free": free, "stuck": stuck}
    if study.agreement is not None:
        found["modes"] = agreement_summary(study.agreement)
    if study.deflection is not None:
        found["equilibrium"] = {
            "displacement_m": study.deflection,
            "unstable_directions": study.solid.unstable,
        }
    if study.mesh_check is not None:
        found["estimated_mesh_error"] = asdict(study.mesh_check)
    return found


def _of_model(found: Rerun) -> dict[str, Any]:
    """What `summary.json` has of a stored model."""
    stored = found.stored
    basis = {"method": stored.method, "size": stored.size, "labels": list(stored.labels)}
    return {
        "dofs": stored.dofs,
        "basis": basis | size_summary(found.sized),
        **range_summary(stored),
        **run_up_summary(found.run_up),
        "seconds": {"reduced motion": found.motion.seconds},
        "left_out": left_out(found),
    }


def left_out(found: Study | Rerun) -> list[str]:
    """What was not computed, as "NAME: REASON"."""
    return [f"{note.key}: {note}" for note in found.left_out]


def estimates_summary(errors: Mapping[str, MotionErrors]) -> dict[str, Any]:
    """The estimated errors in percent; None where there is no estimate.

    Returns:
        By the causes "time step", "basis" and "mesh": the error of the amplitudes (root mean
        squares of a motion that does not settle). "directions by the CAUSE" lists those by
        direction. "probe", "peak force", "dissipation" and "worn by the CAUSE" are the errors of
        the amplitudes of [probe] beside contact points, of the largest normal force, of the
        dissipated energy and of the largest worn depth. Near a resonance
        (`fenicsrom.assess.errors.resonance`), "frequency by the CAUSE" is the error of its
        frequency, and "at the frequency of the loads by the CAUSE" that of the amplitude there.
        Where sliders are free, "from rest by the CAUSE" is the error of the amplitudes against the
        other model's own run from rest.
    """

    def percent(value: float) -> float | None:
        return 100.0 * value if np.isfinite(value) else None

    found: dict[str, Any] = {name: percent(error.amplitude) for name, error in errors.items()}
    for name, error in errors.items():
        for attribute in CONTACT.values():
            key = f"{attribute.replace('_', ' ')} by the {name}"
            found[key] = percent(getattr(error, attribute))
        found[f"directions by the {name}"] = [percent(value) for value in error.directions]
        if error.from_rest is not None:
            found[f"from rest by the {name}"] = percent(error.from_rest.amplitude)
        if error.shift:
            found[f"frequency by the {name}"] = percent(error.shift)
            found[f"at the frequency of the loads by the {name}"] = percent(error.at_frequency)
    return found


def range_summary(stored: StoredModel) -> dict[str, Any]:
    """The speed of a model for a range of speeds, and its errors between those of its basis."""
    whole, rotation = stored.whole, stored.scene.rotation
    if whole is None or rotation is None:
        return {}
    found: dict[str, Any] = {"speed_rpm": rotation.speed_rpm, "size": whole.model.size}
    rpm = 30.0 / np.pi
    errors = whole.errors._asdict() | {"speeds": rpm * whole.errors.speeds}
    found["mesh_errors"] = of_model(stored).frequencies
    return {"range": found | {"speeds_rpm": rpm * whole.speeds, "errors_between": errors}}


def size_summary(found: Sized | None) -> dict[str, Any]:
    """How the basis got its size: the coordinates that joined, and those that it left out."""
    if found is None:
        return {}
    return {
        "accuracy": found.stored.scene.basis.accuracy,
        "accuracy_reached": not found.warning,
        "joined": found.energies,
        "further": found.stored.further,
    }


def probe_motions(found: Study | Rerun) -> dict[str, Motion]:
    """The motions of [probe] where they stand beside those of contact points."""
    if found.scene.probe is None or not found.scene.contacts:
        return {}
    pairs = ((name, motion.at_probe()) for name, motion in found.motions.items())
    return {name: motion for name, motion in pairs if motion is not None}


def motions_summary(found: Study | Rerun) -> dict[str, Any]:
    """Collect the responses of all models, and the errors of the reduced against the full model."""
    response = {name: response_summary(motion) for name, motion in found.motions.items()}
    for name, motion in found.motions.items():
        if motion.state.shape[1] > 1:
            pairs = zip(contact_places(found.points), point_summaries(motion), strict=True)
            listed = [{"position_m": position, **point} for position, point in pairs]
            response[name]["points"] = listed
    for name, motion in probe_motions(found).items():
        response[name]["probe_amplitude_m"] = in_order(amplitudes(motion))
    errors = errors_of(found.motions)
    return {"response": response} | ({"error_percent": errors} if errors else {})


def support_summary(run: Study | Rerun) -> dict[str, Any]:
    """The entry `support_motion` of a scene whose supports move; empty for any other scene.

    Returns:
        For each model `support_amplitude_m` along the axes, and `absolute_amplitude_m` of what
        `response.MODEL.amplitude_m` gives relative to the supports.
    """
    scene, found = run.scene, {}
    if not moves_supports(scene):
        return {}
    for name, motion in run.motions.items():
        moved = support_displacement(scene.loads, motion.time, scene.geometry.dimension)
        absolute = replace(motion, displacement=absolute_displacement(scene, run.points, motion))
        found[name] = {
            "support_amplitude_m": 0.5 * np.ptp(moved[motion.last_period()], axis=0),
            "absolute_amplitude_m": amplitudes(absolute),
        }
    return {"support_motion": found}


def errors_of(motions: Mapping[str, Motion]) -> dict[str, float | None]:
    """Errors of the reduced model against the full one, percent; empty unless both ran."""
    if "reduced" in motions and "full" in motions:
        return errors_percent(motions["reduced"], motions["full"])
    return {}


def write_history(
    path: Path,
    motions: Mapping[str, Motion],
    scene: Scene | None = None,
    points: ContactPoints | None = None,
) -> Path:
    """Write the motions as arrays `MODEL_time`, `MODEL_displacement` and so on.

    `HISTORY_ARRAYS` lists the arrays. `MODEL_newton_from` is the time at which Newton's method
    replaced the marched motion by the periodic one, where it did. If the supports of the scene
    move, `MODEL_support_displacement` (ns, d) is their displacement in global axes, and
    `MODEL_absolute_displacement` is the sum of this displacement and of `MODEL_displacement`.
    With contact, `MODEL_probe` (ns, d) is the displacement of [probe] in global axes, m.
    With abradable layers, `MODEL_worn_depth` (ns, P) is that in front of each point, m.

    Raises:
        OSError: the file cannot be written.
    """
    arrays = {
        f"{name}_{key}": getattr(motion, attribute)
        for name, motion in motions.items()
        for key, attribute in HISTORY_ARRAYS.items()
    }
    for name, motion in motions.items():
        if motion.newton_from is not None:
            arrays[f"{name}_{JUMP}"] = np.array(motion.newton_from)
        if scene is not None and scene.contacts and scene.probe and motion.probe is not None:
            arrays[f"{name}_probe"] = motion.probe
        if scene is not None and points is not None and moves_supports(scene):
            d = scene.geometry.dimension
            moved = support_displacement(scene.loads, motion.time, d)
            arrays[f"{name}_support_displacement"] = moved
            arrays[f"{name}_absolute_displacement"] = absolute_displacement(scene, points, motion)
        if scene is not None and points is not None and scene.wears:
            worn = worn_under_points(motion, contacts_of(scene, points))
            arrays[f"{name}_worn_depth"] = worn
    return write_arrays(path, arrays)


def write_checkpoint(
    folder: Path, model: ReducedModel, scene: Scene, motion: Motion, whole: bool = False
) -> list[Path]:
    """Write the final state of a motion of the reduced model, or the whole motion.

    Returns:
        The file, if there is one.
    """
    path = folder / CHECKPOINT
    return [path] if save_end(path, model, scene, motion, whole=whole) else []


def stored_model(study: Study) -> StoredModel:
    """Collect the contents of `reduced_model.npz`.

    Raises:
        SceneError: the model has no such `basis.size`.
    """
    assert study.basis is not None and study.modes is not None
    found = StoredModel(
        study.model,
        study.scene,
        study.basis.method,
        study.basis.labels,
        study.solid.free,
        study.modes.frequencies_hz,
        provenance(),
        study.tables,
        study.candidates,
        study.deformation,
        further=study.further,
        finer=study.finer,
        finer_labels=study.finer_labels,
        finer_frequencies_hz=study.finer_frequencies_hz,
        unjudged="" if study.mesh_check is None else study.mesh_check.missing,
    )
    found.require_size()
    return found


def write_numbers(found: Study | Rerun, folder: Path, whole: bool = False) -> list[Path]:
    """Write the summary, the history, the checkpoint and the stresses that a run has.

    Args:
        found: the run.
        folder: folder of the files.
        whole: whether the checkpoint holds the whole motion.

    Raises:
        OSError: a file cannot be written.
    """
    files = [write_summary(folder / SUMMARY, summary(found))]
    if found.motions:
        files.append(write_history(folder / HISTORY, found.motions, found.scene, found.points))
    if isinstance(found.model, ReducedModel) and "reduced" in found.motions:
        motion = found.motions["reduced"]
        files += write_checkpoint(folder, found.model, found.scene, motion, whole)
        files += write_wear(folder, found.motions, found.scene, found.points)
    if isinstance(found, Rerun) and found.run_up is not None:
        files.append(write_rows(folder / RUN_UP, run_up_rows(found.run_up)))
    return files if found.stresses is None else [*files, *write_stresses(found.stresses, folder)]

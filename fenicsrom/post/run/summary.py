"""The numbers of a run: `summary.json`, histories, modes, stresses, model and checkpoint."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np

from fenicsrom.arrays import Array
from fenicsrom.assess.errors.comparisons import ModeAgreement, of_model
from fenicsrom.assess.errors.estimates import MotionErrors
from fenicsrom.assess.errors.sizing import Sized
from fenicsrom.assess.errors.verdicts import CONTACT, contact_quantities
from fenicsrom.notes import AMPLITUDES, DEFLECTION, FREQUENCIES, STABILITY, STRESSES, verdict_of
from fenicsrom.online.contact.points import ContactPoints, contacts_of
from fenicsrom.online.model.loads import moves_supports, support_displacement
from fenicsrom.online.model.model import ReducedModel
from fenicsrom.online.motion import measures
from fenicsrom.online.motion.motion import HISTORY_ARRAYS, JUMP, Motion
from fenicsrom.online.store.archive import StoredModel
from fenicsrom.online.store.store import provenance, save_end
from fenicsrom.online.stress.reactions import Peak, Reactions, Stresses
from fenicsrom.online.stress.stress import extremes
from fenicsrom.post.base import tables
from fenicsrom.post.base.page import failure_of, told
from fenicsrom.post.base.plot import Map, Panel, Plot, Text
from fenicsrom.post.paraview.paraview import contact_places
from fenicsrom.post.run.figures import HISTORY, probe_motions, wear_summary, write_wear
from fenicsrom.post.run.joint_figures import JOINTS, found_joints, joint_rows, joint_table
from fenicsrom.post.run.motion_figures import RUN_UP, run_up_rows, run_up_summary
from fenicsrom.records import Rerun, Study
from fenicsrom.scene import Scene

SAME = 0.99
"""Modes of a larger MAC count as the same."""

ALIKE = 0.5
"""From this MAC on, a full mode has a partner; a reduced mode is the partner of one mode only."""

DARK = 0.6
"""Fields of a larger MAC have white numbers."""

AGREEMENT_NOTE = (
    "Free vibrations about the equilibrium without contact, damping and Coriolis forces. The MAC "
    "(modal assurance criterion, weighted by the mass) is 1 for modes of the same shape and 0 for "
    "modes without a common part. The energy is the part of the kinetic energy of the full mode "
    "that the basis can represent."
)


def agreement_rows(found: ModeAgreement) -> list[list[Any]]:
    """Compose the table of the full modes and their partners."""

    def row(i: int, j: int) -> dict[str, Any]:
        full, reduced = found.full_hz[i], found.reduced_hz[j]
        alike = found.mac[i, j] >= ALIKE
        difference = round(100.0 * (reduced / full - 1.0), 3) + 0.0 if full > 0.0 else None
        return {
            "full mode": i + 1,
            "full Hz": f"{full:.5g}",
            "reduced Hz": f"{reduced:.5g}" if alike else None,
            "difference %": difference if alike else None,
            "MAC": f"{found.mac[i, j]:.3f}",
            "energy %": f"{100.0 * found.represented[i]:.1f}",
        }

    return tables.table_of(row(i, j) for i, j in enumerate(found.partners))


def agreement_sentence(found: ModeAgreement) -> str:
    """State how many modes of the full model the reduced model has, counted from the lowest."""
    same = [found.mac[i, j] >= SAME for i, j in enumerate(found.partners)]
    count = same.index(False) if False in same else len(same)
    which = f"MAC of at least {SAME:g}"
    if count == 0:
        return f"The reduced model has no mode with a {which} to the first mode of the full model."
    modes = "mode" if count == 1 else f"{count} modes"
    return (
        f"The reduced model has the first {modes} of the full model, up to "
        f"{found.full_hz[count - 1]:.5g} Hz, with a {which} ({len(same)} compared)."
    )


def _hz(frequency: float) -> str:
    """Four digits of a frequency, without a power of ten."""
    return f"{frequency:.0f}" if frequency >= 1e3 else f"{frequency:.4g}"


def agreement_plot(found: ModeAgreement) -> Plot:
    """The MAC of the full modes and as many reduced modes as a matrix with its numbers."""
    mac = found.mac[:, : len(found.full_hz)]
    rows, columns = mac.shape
    x, y = np.arange(columns), np.arange(rows)
    bar: dict[str, Any] = {"bar": "MAC", "ticks": {0.0: "0", 0.5: "0.5", 1.0: "1"}}
    items: list[Any] = [Map(x, y, mac, cmap="Blues", vmin=0.0, vmax=1.0, **bar)]
    for i, j in np.ndindex(rows, columns):
        if mac[i, j] >= 0.005:
            color = "white" if mac[i, j] > DARK else "#30363C"
            items.append(Text(j, i, f"{mac[i, j]:.2f}", color=color, ha="center", fontsize=8.0))
    reduced, full = (
        {float(k): _hz(hertz) for k, hertz in enumerate(each)}
        for each in (found.reduced_hz[:columns], found.full_hz)
    )
    labels = "reduced model, Hz", "full model, Hz"
    panel = Panel(items, *labels, tight="xy", xticks=reduced, yticks=full)
    return Plot([panel], 2.8 + 0.62 * columns, 1.4 + 0.42 * rows)


STRESSES_FILE = "stresses.csv"
MODAL_STRESSES = "modal_stresses.csv"
REACTIONS = "reactions.csv"

MEASURE_NAMES = {
    "second-piola-kirchhoff": "second Piola-Kirchhoff stress",
    "cauchy": "Cauchy stress",
}
RECOVERY_NOTE = (
    "Stresses at the vertices are extrapolated from the Gauss points of each cell, and averaged "
    "over the cells that meet there. The largest value at a Gauss point is not extrapolated: where "
    "the two differ much, the mesh is too coarse, or a corner or a point force makes the stress "
    "singular. Places are those in the undeformed body."
)
MODAL_NOTE = (
    "Modal stresses are the derivatives of the second Piola-Kirchhoff stress about the "
    "equilibrium, for a largest displacement of 1 mm of a vertex."
)
ROUNDING = 1e-9  # smaller forces relative to the others come from the tolerance of the equilibrium


def stress_quantities(peaks: Sequence[Peak]) -> list[tables.Quantity]:
    """What is told of peaks: of modes per metre of their largest displacement."""
    modal, axes = peaks[0].frequency is not None, "xyz"[: peaks[0].position.size]
    unit, shown = ("Pa_per_m", "MPa/mm") if modal else ("Pa", "MPa")
    when = tables.Quantity("time_s", "time", "t, s", 6)

    def principal(peak: Peak) -> str:
        return ", ".join(f"{factor * value:.4g}" for value in peak.principal)

    factor = tables.FACTORS[shown]
    return [
        tables.Quantity("state", head="mode" if modal else "state"),
        tables.Quantity("frequency_Hz", "frequency", "frequency, Hz") if modal else when,
        tables.Quantity(f"von_mises_{unit}", "von_mises", f"von Mises, {shown}", 4),
        tables.Quantity("", lambda peak: tables.place_text(peak.position), "at, m"),
        tables.Quantity("", principal, f"principal, {shown}"),
        *tables.components("{}_m", "position", axes),
        *tables.components(f"principal_{{}}_{unit}", "principal", "123"[: peaks[0].principal.size]),
        tables.Quantity(
            f"gauss_von_mises_{unit}", "point_von_mises", f"at a Gauss point, {shown}", 4
        ),
        *tables.components("gauss_{}_m", "point_position", axes),
    ]


def stress_rows(peaks: Sequence[Peak]) -> list[dict[str, Any]]:
    """The peaks in files."""
    return tables.rows_of(peaks, stress_quantities(peaks)) if peaks else []


def stress_summary(stresses: Stresses) -> dict[str, Any]:
    """The entries `stresses` and `reactions` of `summary.json`."""
    found: dict[str, Any] = {
        "stresses": {
            "measure": stresses.measure,
            "smallest_volume_ratio": extremes(stresses.deformations).volume_ratio,
            "largest": stress_rows(stresses.peaks),
            "modes": stress_rows(stresses.modes),
        },
        "reactions": {"equilibrium": reaction_record(stresses.reactions, 0)},
    }
    moving = stresses.motion_reactions
    if moving is not None:
        found["reactions"]["largest_force"] = reaction_record(moving, _largest(moving))
        found["reactions"]["mismatch"] = moving.mismatch
    return found


def reaction_record(reactions: Reactions, row: int) -> dict[str, Any]:
    """The reactions at one instant by name, with units."""
    places = dict(zip(reactions.supports, reactions.values[row], strict=True))
    places["by_momentum"] = reactions.by_momentum[row]
    parts = {
        name: tables.named("{}", reactions.components, found) for name, found in places.items()
    }
    return {"time_s": float(reactions.time[row]), **parts}


def write_stresses(stresses: Stresses, folder: Path) -> list[Path]:
    """Write the tables of stresses and reactions as CSV.

    Raises:
        OSError: a file cannot be written.
    """
    files = [tables.write_rows(folder / STRESSES_FILE, stress_rows(stresses.peaks))]
    if stresses.modes:
        files.append(tables.write_rows(folder / MODAL_STRESSES, stress_rows(stresses.modes)))
    return [*files, tables.write_rows(folder / REACTIONS, _reaction_rows(stresses))]


def _reaction_rows(stresses: Stresses) -> list[dict[str, Any]]:
    """One row for the equilibrium, and one row for each instant of the last period."""
    moving = stresses.motion_reactions
    listed = [("equilibrium", reaction_record(stresses.reactions, 0) | {"time_s": None})]
    if moving is not None:
        listed += [("motion", reaction_record(moving, k)) for k in range(moving.time.size)]
    return [
        {"state": state, "time_s": record.pop("time_s")}
        | {f"{name}_{key}": v for name, found in record.items() for key, v in found.items()}
        for state, record in listed
    ]


def stress_table(peaks: Sequence[Peak]) -> list[list[Any]]:
    """The table of peaks for the report."""
    return tables.table_of(peaks, stress_quantities(peaks)) if peaks else []


def reaction_rows(stresses: Stresses) -> list[list[Any]]:
    """The table of the reactions for the report: the equilibrium and the largest force."""
    first = stresses.reactions
    names = [name.split("_") for name in first.components]
    heads = [f"{kind[0].upper()}{axis} {unit}" for kind, axis, unit in names]
    rows: list[list[Any]] = [["state", "t s", "support", *heads]]
    listed = [("equilibrium", first, 0)]
    moving = stresses.motion_reactions
    if moving is not None:
        listed.append(("largest force", moving, _largest(moving)))
    for state, reactions, row in listed:
        time = None if state == "equilibrium" else f"{reactions.time[row]:.6g}"
        for k, name in enumerate(reactions.supports):
            rows.append([state, time, name, *_without_rounding(reactions.values[row, k])])
        total = _without_rounding(reactions.by_momentum[row])
        rest = [None] * (len(first.components) - len(total))
        rows.append([state, time, "by momentum", *total, *rest])
    return rows


def reaction_note(stresses: Stresses) -> str:
    """Say what the reactions are, and how well the stresses agree with the momentum."""
    text = (
        "Reactions are the forces F of a support on the body, and the moments M about the centroid "
        "of its nodes, from the stresses in the cells at the support, inertia and loads. The "
        "forces by momentum are those that the motion of the whole body needs."
    )
    if stresses.motion_reactions is None:
        return text
    return (
        f"{text} During the last period the two differ by at most "
        f"{100.0 * stresses.motion_reactions.mismatch:.2g} % of the largest change of the force: "
        "what the basis does not resolve at the support. Trust the forces by momentum."
    )


def _without_rounding(values: Array) -> list[str]:
    """The numbers of a row as text; numbers below `ROUNDING` of the largest number are zero."""
    small = np.abs(values) < ROUNDING * np.abs(values).max(initial=0.0)
    return [f"{value:.6g}" for value in np.where(small, 0.0, values)]


def _largest(reactions: Reactions) -> int:
    """The instant of the largest sum of the forces by momentum."""
    return int(np.argmax(np.linalg.norm(reactions.by_momentum, axis=1)))


SUMMARY = "summary.json"
CHECKPOINT = "checkpoint.npz"


def summary(found: Study | Rerun) -> dict[str, Any]:
    """Collect the contents of `summary.json`."""
    first = _of_model(found) if isinstance(found, Rerun) else _of_stages(found)
    begin = {"dofs": first.pop("dofs"), "frequencies_Hz": found.frequencies_hz}
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
        found.warnings, failure_of(found), quantities=quantities(found), unjudged=unjudged(found)
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
        DEFLECTION: _has_deflection(found) and not found.scene.joined,
    }
    return [name for name, is_read in read.items() if is_read]


def _has_deflection(found: Study | Rerun) -> bool:
    """Whether a run has the displacement of the probe in the equilibrium."""
    return isinstance(found, Study) and found.deflection is not None


def unjudged(found: Study | Rerun) -> list[str]:
    """The quantities of a run that a user reads, and whose errors are not estimated."""
    of_joint = [DEFLECTION] if found.scene.joined and _has_deflection(found) else []
    return of_joint + ([] if found.stresses is None else [STRESSES])


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
    if modes is not None and modes.rigid:
        found["rigid_modes"] = modes.rigid
    if study.contact_hz is not None:
        first, stuck = study.contact_hz.T
        name = "closed_points_stuck" if study.scene.joined else "free"
        found["contact_frequencies_Hz"] = {name: first, "stuck": stuck}
    if (agreed := study.agreement) is not None:
        hertz = {"full_Hz": agreed.full_hz, "reduced_Hz": agreed.reduced_hz}
        found["modes"] = {**hertz, "mac": agreed.mac}
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
        other model's own run from rest. "history by the CAUSE" is the error of the displacements
        of [probe] at equal times, of a run without a period.
    """

    def percent(value: float) -> float | None:
        return 100.0 * value if np.isfinite(value) else None

    found: dict[str, Any] = {name: percent(error.amplitude) for name, error in errors.items()}
    for name, error in errors.items():
        for attribute in CONTACT.values():
            key = f"{attribute.replace('_', ' ')} by the {name}"
            found[key] = percent(getattr(error, attribute))
        found[f"directions by the {name}"] = [percent(value) for value in error.directions]
        if error.history:
            found[f"history by the {name}"] = percent(error.history)
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


def motions_summary(found: Study | Rerun) -> dict[str, Any]:
    """Collect the responses of all models, and the errors of the reduced against the full model."""
    response = {name: measures.response_summary(motion) for name, motion in found.motions.items()}
    for name, motion in found.motions.items():
        if motion.state.shape[1] > 1:
            pairs = zip(contact_places(found.points), measures.point_summaries(motion), strict=True)
            listed = [{"position_m": position, **point} for position, point in pairs]
            response[name]["points"] = listed
    for name, motion in probe_motions(found).items():
        response[name]["probe_amplitude_m"] = tables.in_order(measures.amplitudes(motion))
    for name, joints in found_joints(found).items():
        response[name]["joints"] = joint_table(joints)
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
        absolute = replace(
            motion, displacement=measures.absolute_displacement(scene, run.points, motion)
        )
        found[name] = {
            "support_amplitude_m": 0.5 * np.ptp(moved[motion.last_period()], axis=0),
            "absolute_amplitude_m": measures.amplitudes(absolute),
        }
    return {"support_motion": found}


def errors_of(motions: Mapping[str, Motion]) -> dict[str, float | None]:
    """Errors of the reduced model against the full one, percent; empty unless both ran."""
    if "reduced" in motions and "full" in motions:
        return measures.errors_percent(motions["reduced"], motions["full"])
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
            arrays[f"{name}_absolute_displacement"] = measures.absolute_displacement(
                scene, points, motion
            )
        if scene is not None and points is not None and scene.wears:
            worn = measures.worn_under_points(motion, contacts_of(scene, points))
            arrays[f"{name}_worn_depth"] = worn
    return tables.write_arrays(path, arrays)


def write_checkpoint(
    folder: Path, model: ReducedModel, scene: Scene, motion: Motion, whole: bool = False
) -> list[Path]:
    """Write the final state of a motion of the reduced model, or the whole motion.

    Returns:
        The file, if there is one.
    """
    path = folder / CHECKPOINT
    return [path] if save_end(path, model, scene, motion, whole=whole) else []


def write_numbers(found: Study | Rerun, folder: Path, whole: bool = False) -> list[Path]:
    """Write the summary, the history, the checkpoint and the stresses that a run has.

    Args:
        found: the run.
        folder: folder of the files.
        whole: whether the checkpoint holds the whole motion.

    Raises:
        OSError: a file cannot be written.
    """
    files = [tables.write_summary(folder / SUMMARY, summary(found))]
    if found.motions:
        files.append(write_history(folder / HISTORY, found.motions, found.scene, found.points))
    if isinstance(found.model, ReducedModel) and "reduced" in found.motions:
        motion = found.motions["reduced"]
        files += write_checkpoint(folder, found.model, found.scene, motion, whole)
        files += write_wear(folder, found.motions, found.scene, found.points)
    for name, joints in list(found_joints(found).items())[:1]:
        rows = joint_rows(joints, found.motions[name].time)
        files.append(tables.write_rows(folder / JOINTS, rows))
    if isinstance(found, Rerun) and found.run_up is not None:
        files.append(tables.write_rows(folder / RUN_UP, run_up_rows(found.run_up)))
    return files if found.stresses is None else [*files, *write_stresses(found.stresses, folder)]

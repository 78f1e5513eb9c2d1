"""The files of a run: summary, report, history, reduced model, ParaView files, pictures and
animation.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from fenicsrom.arrays import Array
from fenicsrom.errors import SceneError
from fenicsrom.files import atomic_write
from fenicsrom.online.archive import StoredModel, provenance, save_model
from fenicsrom.online.checkpoints import keeper, load_checkpoint, save_end
from fenicsrom.online.contact_points import ContactPoints, contacts_of
from fenicsrom.online.history import HISTORY
from fenicsrom.online.measures import (
    errors_percent,
    has_settled,
    out_of_reach,
    point_summaries,
    response_summary,
)
from fenicsrom.online.model import ReducedModel
from fenicsrom.online.motion import Motion
from fenicsrom.online.surfaces import unit_normals
from fenicsrom.post.report import (
    html_report,
    ledger_plot,
    plot_contact,
    plot_modes,
    plot_motion,
    plot_points,
    text_table,
    write_summary,
)
from fenicsrom.scene import Scene

if TYPE_CHECKING:
    from fenicsrom.study import Study

CHECKPOINT = "checkpoint.npz"
FRAMES = 60  # of the motion for ParaView and of the animation, at most
FEW_POINTS = 4  # contact points with a picture of their own each, at most; more share one


def summary(study: Study) -> dict[str, Any]:
    """The contents of `summary.json`."""
    basis = study.basis
    found: dict[str, Any] = {
        "scene": study.scene.source,
        "dofs": study.solid.free,
        "frequencies_hz": study.modes.frequencies_hz,
        "basis": {
            "method": study.modes.method,
            "size": basis.size if basis else None,
            "labels": list(basis.labels)
            if basis
            else [*study.modes.labels, *study.derivatives.labels],
            "dropped": basis.dropped if basis else {},
            "mass_condition": basis.condition if basis else None,
            "flexibility_condition": study.modes.flexibility_condition,
            "participation": study.selection.modal_coordinates,
            "weights": study.selection.weights,
        },
        "seconds": study.seconds,
        "left_out": study.left_out,
    }
    if study.deflection is not None:
        found["equilibrium"] = {"displacement_m": study.deflection}
    found |= motions_summary(study.motions, study.solid.points)
    found["estimated_error_percent"] = {
        name: 100.0 * value if np.isfinite(value) else None for name, value in study.errors.items()
    }
    if study.unfinished:
        found["unfinished"] = {"model": study.unfinished[0], "reason": str(study.unfinished[1])}
    found["warnings"] = study.solid.warnings
    found["provenance"] = provenance()
    return found


def motions_summary(motions: Mapping[str, Motion], points: ContactPoints) -> dict[str, Any]:
    """The responses of the models that ran, and the errors of the reduced one against the full
    one.
    """
    found: dict[str, Any] = {
        "response": {name: response_summary(motion) for name, motion in motions.items()}
    }
    for name, motion in motions.items():
        if motion.state.shape[1] > 1:
            found["response"][name]["points"] = [
                {"position_m": position, **point}
                for position, point in zip(
                    contact_places(points), point_summaries(motion), strict=True
                )
            ]
    if errors := errors_of(motions):
        found["error_percent"] = errors
    return found


def errors_of(motions: Mapping[str, Motion]) -> dict[str, float | None]:
    """Errors of the reduced model against the full one, percent; empty unless both ran."""
    if "reduced" in motions and "full" in motions:
        return errors_percent(motions["reduced"], motions["full"])
    return {}


def response_rows(motions: Mapping[str, Motion], sizes: Mapping[str, int]) -> list[list[Any]]:
    """The table of what was found, its head first."""
    head = [
        "model",
        "unknowns",
        "tangential mm",
        "normal mm",
        "open %",
        "slip %",
        "stick %",
        "peak N",
        "J/period",
        "periods",
    ]
    rows: list[list[Any]] = [[*head, "steady", "imbalance"]]
    for name, motion in motions.items():
        r = response_summary(motion)
        tangential = " / ".join(f"{1e3 * a:.5g}" for a in r["amplitude_m"]["tangential"])
        fraction = [f"{100.0 * r['fraction'][state]:.1f}" for state in ("open", "slip", "stick")]
        if motion.force.shape[1] == 0:
            fraction = [None, None, None]
        rows.append(
            [
                name,
                sizes.get(name),
                tangential,
                f"{1e3 * r['amplitude_m']['normal']:.5g}",
                *fraction,
                f"{r['peak_normal_force_N']:.5g}",
                f"{r['dissipated_per_period_J']:.5g}",
                r["periods"],
                "yes" if r["steady"] else "no",
                f"{r['energy_imbalance']:.1e}",
            ]
        )
    return rows


def write_history(path: Path, motions: Mapping[str, Motion]) -> None:
    """Write the motions as one `.npz` with the arrays `MODEL_time`, `MODEL_displacement` and so on,
    those of `HISTORY`.
    """
    arrays: dict[str, Any] = {}
    for name, motion in motions.items():
        for key, attribute in HISTORY.items():
            arrays[f"{name}_{key}"] = getattr(motion, attribute)
    with atomic_write(path) as temporary, open(temporary, "wb") as file:
        np.savez_compressed(file, **arrays)


def write_figure(path: Path, figure: Any) -> Path:
    """Write a matplotlib figure as PNG."""
    with atomic_write(path) as temporary:
        figure.savefig(temporary, format="png", dpi=130)
    return path


def motion_figures(folder: Path, motions: Mapping[str, Motion]) -> list[tuple[str, Path]]:
    """Pictures of the motion, the contact and the energy ledger: (heading, file)."""
    pictures = [("Motion", write_figure(folder / "motion.png", plot_motion(motions)))]
    first = next(iter(motions.values()))
    count = first.force.shape[1]
    if count > FEW_POINTS:
        found = {
            name: point_summaries(motion)
            for name, motion in motions.items()
            if motion.state.shape[1]
        }
        figure = plot_points(motions, found)
        pictures.append(
            (f"Contact of {count} points", write_figure(folder / "contact.png", figure))
        )
    else:
        for point in range(count):
            name = "contact.png" if count == 1 else f"contact_{point + 1}.png"
            heading = "Contact" if count == 1 else f"Contact point {point + 1}"
            touching = {
                name: motion for name, motion in motions.items() if motion.force.shape[1] > point
            }
            pictures.append((heading, write_figure(folder / name, plot_contact(touching, point))))
    pictures.append(("Energy", write_figure(folder / "energy.png", ledger_plot(first))))
    return pictures


# what moves, in time


def frame_rows(motion: Motion) -> NDArray[np.int64]:
    """Rows of a motion near equal times over its last period (the whole motion if it has no
    period), `FRAMES` at most.
    """
    part = motion.last_period()
    rows = np.arange(motion.time.size)[part]
    wanted = np.linspace(motion.time[rows[0]], motion.time[-1], FRAMES)
    return np.unique(np.interp(wanted, motion.time[rows], rows).round().astype(np.int64))


def contact_places(points: ContactPoints) -> Array:
    """Places of the contact points in the undeformed body, (P, 3), m; the third component is 0 in
    2D.
    """
    places = np.zeros((points.position.shape[0], 3))
    places[:, : points.position.shape[1]] = points.position
    return places


def contact_vectors(
    scene: Scene, points: ContactPoints, motion: Motion
) -> tuple[Array, Array, Array]:
    """Contact points in global axes, all (ns, P, 3): their positions, m, and the forces on the
    body, N.

    Returns:
        Positions, normal forces (out of the surface, into the body) and friction forces; the third
        component is 0 in 2D.
    """
    d = scene.geometry.dimension
    frames = np.zeros((points.frame.shape[0], d, 3))
    frames[:, :, :d] = points.frame
    normals = unit_normals(contacts_of(scene, points), motion.displacement, motion.time)
    normal = -motion.force[:, :, :1] * normals
    friction = motion.force.copy()  # back from the frames that were turned to the current normals
    friction[:, :, 0] = 0.0
    across = np.sum(friction * normals, axis=2, keepdims=True)
    friction -= across / (1.0 + normals[:, :, :1]) * (normals + np.eye(d)[0])
    moved, normal, friction = (
        np.einsum("spk,pkx->spx", values, frames)
        for values in (motion.displacement, normal, -friction)
    )
    return contact_places(points) + moved, normal, friction


def write_contact_points(study: Study, folder: Path) -> list[Path]:
    """The contact points of the reduced model in time, for ParaView; on one rank."""
    from fenicsrom.post.export import write_points

    motion = study.motions["reduced"]
    points, arrays = contact_points(study, motion)
    return [write_points(folder, "contact_points", motion.time[frame_rows(motion)], points, arrays)]


def contact_points(study: Study, motion: Motion) -> tuple[Array, dict[str, Array]]:
    """Places of the contact points in the undeformed body, (P, 3) in m, and what they do at the
    rows of `frame_rows`.
    """
    rows = frame_rows(motion)
    position, normal, friction = (
        values[rows] for values in contact_vectors(study.scene, study.solid.points, motion)
    )
    places = contact_places(study.solid.points)
    return places, {
        "displacement": position - places,
        "position": position,
        "gap": motion.gap[rows],
        "normal force": motion.force[rows, :, 0],
        "normal force vector": normal,
        "friction force vector": friction,
        "state": motion.state[rows],
    }


def shapes(study: Study) -> dict[str, dict[str, Any]]:
    """Normal modes, static modes and derivatives: file name -> label -> field."""
    solid, modes = study.solid, study.modes
    kinds: dict[str, dict[str, Any]] = {"normal_modes": {}, "static_modes": {}, "derivatives": {}}
    for k, label in enumerate(modes.labels):
        kind = "normal_modes" if label.endswith("V") else "static_modes"
        kinds[kind][label] = solid.field(modes.vectors[:, k])
    for k, label in enumerate(study.derivatives.labels):
        kinds["derivatives"][label] = solid.field(study.derivatives.vectors[:, k])
    if solid.loaded:
        kinds["equilibrium"] = {"displacement": solid.field(solid.equilibrium)}
    return {name: fields for name, fields in kinds.items() if fields}


def write_shapes(study: Study, folder: Path) -> list[Path]:
    """ParaView files of the shapes; collective."""
    from fenicsrom.post.export import write_fields

    return [
        write_fields(folder, name, study.solid.space, fields)
        for name, fields in shapes(study).items()
    ]


def moving_field(study: Study) -> Callable[[int], Array]:
    """The reduced model's displacement, local and ghost unknowns, at the rows of `frame_rows` by
    number; collective.
    """
    motion, basis, solid = study.motions["reduced"], study.basis, study.solid
    assert basis is not None and motion.coordinates is not None
    vectors = np.array([solid.field(vector).x.array.copy() for vector in basis.vectors.T])
    rest = solid.field(solid.equilibrium).x.array.copy()
    q = motion.coordinates[frame_rows(motion) - motion.time.size]
    return lambda number: rest + q[number] @ vectors


def write_last_period(study: Study, folder: Path) -> list[Path]:
    """ParaView files of the reduced model's last period: the body, and its contact points;
    collective.
    """
    from fenicsrom.post.export import write_motion

    motion, solid = study.motions["reduced"], study.solid
    times = motion.time[frame_rows(motion)]
    files = [write_motion(folder, "motion", solid.space, times, moving_field(study))]
    if study.scene.contacts and solid.comm.rank == 0:
        files += write_contact_points(study, folder)
    return files


def write_animation(study: Study, folder: Path) -> list[tuple[str, Path]]:
    """The reduced model's last period as an animated GIF: (heading, file); collective."""
    from fenicsrom.post.export import animate

    motion, solid = study.motions["reduced"], study.solid
    marks = contact_points(study, motion) if study.scene.contacts else None
    with drawing_warnings(study):
        film = animate(
            folder / "motion.gif",
            solid.space,
            motion.time[frame_rows(motion)],
            moving_field(study),
            marks,
        )
    return [("Animation", film)] if film is not None else []


@contextmanager
def drawing_warnings(study: Study) -> Iterator[None]:
    """Keep what is warned of while something is drawn among the warnings of the study."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        yield
    study.solid.warnings += [str(warning.message) for warning in caught]


def write_pictures(study: Study, folder: Path) -> list[tuple[str, Path]]:
    """Pictures of the shapes: along the axis, and as bodies; collective."""
    from fenicsrom.post.export import centreline, picture_modes

    fields = {
        label: field
        for kind, named in shapes(study).items()
        if kind != "equilibrium"
        for label, field in named.items()
    }
    if not fields:
        return []
    space = study.solid.space
    positions, values = centreline(space, fields)
    pictures = []
    if study.solid.comm.rank == 0:
        figure = plot_modes(list(fields), positions, values)
        pictures.append(("Shapes along the axis", write_figure(folder / "modes.png", figure)))
    with drawing_warnings(study):
        bodies = picture_modes(folder / "shapes.png", space, fields)
    if bodies is not None:
        pictures.append(("Shapes", bodies))
    return pictures


def write_study(study: Study, folder: Path) -> list[Path]:
    """Write all files of a study that the scene asks for; collective.

    Returns:
        The files, the one to open first at the head.

    Raises:
        OSError: a file cannot be written.
    """
    root = study.solid.comm.rank == 0
    output = study.scene.output
    files: list[Path] = []
    pictures: list[tuple[str, Path]] = []
    if output.paraview:
        files += write_shapes(study, folder)
    if output.motion and "reduced" in study.motions:
        files += write_last_period(study, folder)
    if output.pictures:
        if root and study.motions:
            pictures += motion_figures(folder, study.motions)
        pictures += write_pictures(study, folder)
    if output.animation and "reduced" in study.motions:
        pictures += write_animation(study, folder)
    if not root:
        return []
    if isinstance(study.model, ReducedModel) and study.basis is not None:
        path = folder / "reduced_model.npz"
        save_model(path, stored_model(study))
        files.append(path)
        if "reduced" in study.motions:
            files += write_checkpoint(folder, study.model, study.scene, study.motions["reduced"])
    if study.motions:
        write_history(folder / "history.npz", study.motions)
        files.append(folder / "history.npz")
    files += [path for _, path in pictures]
    write_summary(folder / "summary.json", summary(study))
    _write_text(
        folder / "report.html",
        html_report(study.scene.title or study.scene.source, report_sections(study, pictures)),
    )
    return [folder / "report.html", folder / "summary.json", *files]


def write_checkpoint(folder: Path, model: ReducedModel, scene: Scene, motion: Motion) -> list[Path]:
    """Write where a motion of the reduced model ended, to go on from later."""
    path = folder / CHECKPOINT
    return [path] if save_end(path, model, scene, motion) else []


def restarts(study: Study, folder: Path, resume: Path | None) -> dict[str, Any]:
    """How a run of the reduced model resumes and keeps checkpoints: the last argument of
    `fenicsrom.study.run`.

    The model goes into the folder at once, and checkpoints of its motion as it goes.

    Raises:
        SceneError: the checkpoint to resume from is not one of this model and scene.
        OSError: a file cannot be written.
    """
    if not isinstance(study.model, ReducedModel):
        if resume is not None:
            raise SceneError(
                f"{resume}: basis.elastic_force = 'projection': has no checkpoints; take 'polynomial'"
            )
        return {}
    found: dict[str, Any] = {}
    if resume is not None:
        found["resume"] = load_checkpoint(resume, study.model, study.scene)
    if study.solid.comm.rank == 0:
        save_model(folder / "reduced_model.npz", stored_model(study))
        found["checkpoint"] = keeper(folder / CHECKPOINT, study.model, study.scene)
    return found


def stored_model(study: Study) -> StoredModel:
    """What `reduced_model.npz` holds."""
    assert study.basis is not None
    return StoredModel(
        study.model,
        study.scene,
        study.basis.method,
        study.basis.labels,
        study.solid.free,
        study.modes.frequencies_hz,
        provenance(),
    )


def sizes(study: Study) -> dict[str, int]:
    """Number of unknowns of each model."""
    beam = study.scene.reference.beam
    return {
        "reduced": study.basis.size if study.basis else 0,
        "full": study.solid.free,
        "beam": 3 * beam.elements if beam else 0,
    }


def report_sections(study: Study, pictures: list[tuple[str, Path]]) -> list[tuple[str, list[Any]]]:
    """Headings and items of `report.html`."""
    sections: list[tuple[str, list[Any]]] = []
    found: list[Any] = []
    if study.motions:
        found.append(response_rows(study.motions, sizes(study)))
        found.append(
            "Amplitudes are half of peak-to-peak over the last period; imbalance is the largest error of the energy "
            "ledger relative to the largest energy of the motion."
        )
    if study.deflection is not None:
        found.append(equilibrium_sentence(study.deflection))
    if errors := errors_of(study.motions):
        found.append(error_sentence(errors))
    if study.errors:
        found.append(estimate_sentence(study))
    if study.unfinished:
        found.append(
            f"The {study.unfinished[0]} model has no result to rely on: {study.unfinished[1]}"
        )
    found += [f"Warning: {warning}" for warning in study.solid.warnings]
    if found:
        sections.append(("What was found", found))
    sections += [(heading, [path]) for heading, path in pictures]
    modes = [
        ["mode", "frequency Hz"],
        *[[f"{k + 1}V", f"{f:.5g}"] for k, f in enumerate(study.modes.frequencies_hz)],
    ]
    basis: list[Any] = [modes]
    if study.basis:
        basis.append(
            f"{study.basis.method}, {study.basis.size} coordinates: {', '.join(study.basis.labels)}. Condition number "
            f"of the reduced mass, scaled: {study.basis.condition:.3g}; of the residual flexibility: "
            f"{study.modes.flexibility_condition:.3g}."
        )
        if study.basis.dropped:
            basis.append(
                "Dropped as dependent: "
                + ", ".join(f"{k} ({v:.0e})" for k, v in study.basis.dropped.items())
            )
    if study.selection.weights:
        order = sorted(study.selection.weights.items(), key=lambda item: -item[1])
        kept = set(study.selection.derivatives)
        basis.append(
            [
                ["derivative", "weight", "kept"],
                *[[k, f"{w:.2e}", "yes" if k in kept else "no"] for k, w in order],
            ]
        )
    if study.modes.labels:
        sections.append(("Basis", basis))
    stages = [
        ["stage", "s"],
        *[[stage, f"{seconds:.3g}"] for stage, seconds in study.seconds.items()],
    ]
    sections.append(("Run time", [stages]))
    if study.left_out:
        sections.append(
            ("Left out", [[["stage", "why"], *[line.split(": ", 1) for line in study.left_out]]])
        )
    made = ", ".join(f"{name} {number}" for name, number in provenance().items())
    sections.append(("Made by", [made or "this program, not installed as a package"]))
    return sections


def error_sentence(errors: Mapping[str, float | None]) -> str:
    """The errors against the full model in a sentence."""
    names = {
        "amplitude_tangential": "tangential amplitude",
        "amplitude_normal": "normal amplitude",
        "peak_normal_force": "peak normal force",
        "dissipated_per_period": "dissipation",
    }
    parts = [f"{names[name]} {value:.3g} %" for name, value in errors.items() if value is not None]
    return (
        "Error of the reduced model against the full one: "
        + (", ".join(parts) or "none to compare")
        + "."
    )


def equilibrium_sentence(deflection: Array) -> str:
    """Where the static loads leave the probe, in a sentence."""
    components = ", ".join(f"{1e3 * u:.6g}" for u in deflection)
    return f"Displacement of the probe in the static equilibrium: {components} mm along the axes."


def estimate_sentence(study: Study) -> str:
    """The estimated errors in a sentence."""
    sizes = {
        name: f"{100.0 * value:.2g} %" if np.isfinite(value) else "unknown"
        for name, value in study.errors.items()
    }
    parts = [f"{size} by the {name}" for name, size in sizes.items() if not name.startswith("peak")]
    peak = [
        f"; of the {name.replace(' by', f', {size}, by')}"
        for name, size in sizes.items()
        if name.startswith("peak")
    ]
    what = "amplitude" if has_settled(study.motions["reduced"]) else "root mean square displacement"
    return f"Estimated error of the reduced model's {what} (all directions together): {', '.join(parts)}{''.join(peak)}."


def write_rerun(stored: StoredModel, scene: Scene, motion: Motion, folder: Path) -> list[Path]:
    """Write the files of an integration of a stored model: summary, report, history and pictures.

    Raises:
        OSError: a file cannot be written.
    """
    motions = {"reduced": motion}
    pictures = motion_figures(folder, motions) if scene.output.pictures else []
    write_history(folder / "history.npz", motions)
    checkpoint = write_checkpoint(folder, stored.model, scene, motion)
    found = {
        "scene": scene.source,
        "dofs": stored.dofs,
        "frequencies_hz": stored.frequencies_hz,
        "basis": {"method": stored.method, "size": stored.size, "labels": list(stored.labels)},
        "seconds": {"reduced motion": motion.seconds},
        "left_out": [
            "offline stages, and files of the body: the reduced model was read from a file, without its mesh",
            *out_of_reach(motion, stored.model.points),
        ],
        **motions_summary(motions, stored.model.points),
        "provenance": stored.provenance,
    }
    write_summary(folder / "summary.json", found)
    rows = response_rows(motions, {"reduced": stored.size})
    sections = [("What was found", [rows]), *[(heading, [path]) for heading, path in pictures]]
    _write_text(folder / "report.html", html_report(scene.title or scene.source, sections))
    files = [folder / name for name in ("report.html", "summary.json", "history.npz")]
    return [*files, *checkpoint, *[path for _, path in pictures]]


def _write_text(path: Path, text: str) -> None:
    with atomic_write(path) as temporary:
        temporary.write_text(text, encoding="utf-8")


def resumed_sentence(motion: Motion) -> str | None:
    """From where a motion was resumed, in a sentence; None if it started from rest."""
    if motion.time[0] == 0.0:
        return None
    return f"Resumed: what is shown starts at {motion.time[0]:.6g} s, the periods and steps are those of the whole run."


def terminal_table(motions: Mapping[str, Motion], unknowns: Mapping[str, int]) -> str:
    """The table of what was found, for the terminal."""
    return text_table(response_rows(motions, unknowns))

"""One run of a sweep, as a job of a process: a stored model under other values of its scene."""

import functools
import hashlib
import time as clock
from contextlib import nullcontext
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from fenicsrom.assess.errors.estimates import MotionErrors
from fenicsrom.assess.errors.plausibility import equilibrium_warnings
from fenicsrom.assess.errors.shortening import shortening_notes
from fenicsrom.assess.errors.sizing import fitted
from fenicsrom.assess.errors.verdicts import error_notes, estimate_errors, multiplicity_warnings
from fenicsrom.assess.rotation.disk_run import disk_run
from fenicsrom.errors import AccuracyError, ConvergenceError, SceneError
from fenicsrom.notes import Note, NoteKind, packed, unpacked
from fenicsrom.online.motion import measures
from fenicsrom.online.motion.motion import Motion, check_energy
from fenicsrom.online.run.simulate import simulate
from fenicsrom.online.store.archive import FORMAT, StoredModel, load_stored
from fenicsrom.online.store.disk import StoredDisk
from fenicsrom.reduction.training import beyond, duration, probe_amplitude
from fenicsrom.scene import Scene, scene_table, toml_text
from fenicsrom.scene.reading.overrides import Axis
from fenicsrom.words import brief, counted

FEW = 8  # most runs that a note names
DONE, DOUBTFUL, FAILED = "done", "doubtful", "failed"
"""Outcomes: all checks passed, a check did not pass, or there is no motion."""


@dataclass(frozen=True)
class SweepRun:
    """One run of a sweep.

    Attributes:
        number: from 0, in the order of the sweep.
        scene: the scene with these values.
        model: file of the reduced model.
        digest: of all that determines the result, to recognise it when a sweep is resumed.
    """

    number: int
    scene: Scene
    model: Path
    digest: str


@brief()
@dataclass(eq=False, repr=False)
class Sweep:
    """The runs of a sweep and their results.

    Attributes:
        scene: the scene that the runs change.
        axes: the keys and their values.
        rows: one for each run, in the order of the sweep; a run without a result has no "outcome".
        models: number of reduced models that were needed.
        reused: number of results of an earlier sweep.
        seconds: run time.
        interrupted: whether the sweep was interrupted.
        files: the written files.
    """

    scene: Scene
    axes: tuple[Axis, ...]
    rows: list[dict[str, Any]]
    models: int = 0
    reused: int = 0
    seconds: float = 0.0
    interrupted: bool = False
    files: list[Path] = field(default_factory=list)

    @property
    def warnings(self) -> list[Note]:
        """For each kind of note and each quantity, the runs that have one."""
        runs: dict[tuple[NoteKind, str], list[int]] = {}
        for row in self.rows:
            notes = unpacked(row.get("notes", ()))
            for key in dict.fromkeys((note.kind, note.quantity) for note in notes):
                runs.setdefault(key, []).append(row["run"])
        return [
            Note(
                kind,
                f"{kind.value}, in {counted(len(numbers), 'run')}: "
                f"{', '.join(map(str, numbers[:FEW]))}{', ..' * (len(numbers) > FEW)}",
                quantity=quantity,
            )
            for (kind, quantity), numbers in runs.items()
        ]

    @property
    def failed(self) -> bool:
        """Whether a run has no motion."""
        return bool(self.with_outcome(FAILED))

    def with_outcome(self, *outcomes: str) -> list[dict[str, Any]]:
        """The rows with one of these outcomes."""
        return [row for row in self.rows if row.get("outcome") in outcomes]


def digest_of(scene: Scene, origin: str) -> str:
    """A digest of a scene, of the origin of its reduced model and of the format of models.

    Runs that another version of the program has kept are therefore not used if the models of this
    version cannot be read.

    Args:
        scene: the scene of a run.
        origin: digest of the file of the model, or of the inputs from which the model is made.
    """
    content = f"{FORMAT}\n{toml_text(scene_table(scene))}\n{origin}"
    return hashlib.sha256(content.encode()).hexdigest()


def file_digest(path: Path) -> str:
    """The digest of the content of a file.

    Raises:
        OSError: the file cannot be read.
    """
    return hashlib.sha256(path.read_bytes()).hexdigest()


def compute(run: SweepRun) -> dict[str, Any]:
    """Integrate one run and check it.

    Returns:
        What the row of the run has besides its number and its values.
    """
    begin = clock.perf_counter()
    try:
        stored = stored_of(run.model, file_digest(run.model)).with_scene(run.scene)
        measured: Any = _measured_disk if isinstance(stored, StoredDisk) else _measured
        found: dict[str, Any] = measured(stored)
    except (SceneError, ConvergenceError, AccuracyError) as error:
        found = failure(error)
    return found | {"run_time_s": clock.perf_counter() - begin}


def failure(error: Exception) -> dict[str, Any]:
    """The part of a row that tells of a run without a motion."""
    note = Note(NoteKind.FAILED, str(error))
    return {"outcome": FAILED, "sentence": note, "notes": packed([note])}


@functools.lru_cache(maxsize=4)
def stored_of(path: Path, digest: str) -> StoredModel | StoredDisk:
    """The stored model or disk of a file, read once for each content in each process."""
    return load_stored(path)


def model_of(path: Path, digest: str) -> StoredModel:
    """The stored model of a file; it holds no disk."""
    stored = stored_of(path, digest)
    assert isinstance(stored, StoredModel)
    return stored


def _measured(stored: StoredModel) -> dict[str, Any]:
    """Integrate a model and measure its motion; a failed check makes the run doubtful.

    The notes are the reason of the doubt and the warnings: of large strains in the equilibrium, of
    buckling, of points that stick all the time, and of doubtful contact forces.
    """
    scene, warnings = stored.scene, equilibrium_warnings(stored.deformation)
    motion = simulate(stored.model, scene, keep_coordinates=True)
    chosen = fitted(stored, motion, warnings)
    if chosen is not None:
        stored, motion = chosen.stored, chosen.motion
    found: dict[str, Any] = {"outcome": DONE, **_numbers(scene, motion), "coordinates": stored.size}
    warnings += multiplicity_warnings("reduced", motion)
    if scene.period is not None and scene.time.steady_tolerance and not motion.steady:
        warnings.append(Note(NoteKind.UNSETTLED, "the motion did not become periodic"))
    errors: dict[str, MotionErrors] = {}
    try:
        check_energy(motion)
        basis = None if chosen is None else chosen.errors
        estimate_errors(
            stored.model, stored.candidates, scene, motion, errors, basis, stored.meshes
        )
    except AccuracyError as error:
        found["outcome"] = DOUBTFUL
        warnings.insert(0, Note(NoteKind.ERROR, str(error)))
    warnings += error_notes(scene, errors, motion) + shortening_notes(stored, motion)
    warnings += beyond(stored.trained, scene, probe_amplitude(motion), duration(motion))
    return found | _judged(warnings, errors)


def _measured_disk(disk: StoredDisk) -> dict[str, Any]:
    """Integrate a disk and measure its motion, as `_measured`.

    Raises:
        KeyboardInterrupt: the work was asked to stop.
        ConvergenceError: the motion failed.
    """
    run = disk_run(disk, lambda stage: nullcontext())
    if run.interrupted:
        raise KeyboardInterrupt
    if isinstance(run.unfinished, ConvergenceError):
        raise run.unfinished
    motion, peaks, warnings = run.motion, run.peaks, run.warnings
    found: dict[str, Any] = {
        "outcome": DONE,
        "largest_amplitude_m": float(peaks.max()),
        "sector": int(peaks.argmax()),
        "amplification": run.amplification,
        "nodal_diameter": int(run.shares.argmax()),
        "steady": bool(motion.steady),
        "periods": int(motion.periods),
        "coordinates": run.model.mass.shape[0],
    }
    if run.scene.contacts:
        found["peak_normal_force_N"] = measures.peak_normal_force(motion)
        found["friction_dissipation_per_period_J"] = measures.friction_dissipation_per_period(
            motion
        )
    if run.unfinished is not None:
        found["outcome"] = DOUBTFUL
        warnings = [Note(NoteKind.ERROR, str(run.unfinished)), *warnings]
    return found | _judged(warnings, run.errors)


def _judged(warnings: list[Note], errors: dict[str, MotionErrors]) -> dict[str, Any]:
    """The part of a row that tells of its notes and its estimated errors."""
    found: dict[str, Any] = {}
    if warnings:
        found |= {"sentence": "; ".join(warnings), "notes": packed(warnings)}
    columns = {"step_error": "time step", "basis_error": "basis", "mesh_error": "mesh"}
    for column, cause in columns.items():
        if cause in errors:
            estimate = errors[cause].amplitude
            found[column] = float(estimate) if np.isfinite(estimate) else None
    return found


def _numbers(scene: Scene, motion: Motion) -> dict[str, Any]:
    """The numbers of a motion: amplitudes of the first contact point, or of the probe.

    The tangential amplitude is the amplitude of both directions together.
    """
    first = measures.amplitude(motion)[: motion.displacement.shape[2]]
    if measures.has_contact(motion):
        found = {
            "amplitude_tangential_m": float(np.linalg.norm(first[1:])),
            "amplitude_normal_m": float(first[0]),
            "peak_normal_force_N": measures.peak_normal_force(motion),
            "friction_dissipation_per_period_J": measures.friction_dissipation_per_period(motion),
        }
    else:
        axes = zip("xyz", first, strict=False)
        found = {f"amplitude_{axis}_m": float(value) for axis, value in axes}
    if measures.has_contact(motion) and scene.probe is not None and (probe := motion.at_probe()):
        axes = zip("xyz", measures.amplitude(probe), strict=False)
        found |= {f"probe_amplitude_{axis}_m": float(value) for axis, value in axes}
    if motion.end is not None and motion.end.worn is not None:
        found["largest_worn_depth_m"] = float(np.max(motion.end.worn))
    search = {} if motion.search is None else measures.search_summary(motion.search)
    return {
        **found,
        "steady": bool(motion.steady),
        "settled": measures.has_settled(motion),
        "periodic_motion": search.get("verdict"),
        "largest_multiplier": search.get("largest_multiplier"),
        "periods": int(motion.periods),
    }

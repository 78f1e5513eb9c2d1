"""The motion of a disk of sectors in time: amplitudes by sector, and shares of nodal diameters.

With x_j(t) the displacement of the probe of sector j in its frame, without its mean over time, the
share of h nodal diameters in the motion is

    Σ_t (|X_h|² + |X_{N−h}|²) / Σ_t Σ_k |X_k|²,    X_k = Σ_j x_j e^{−2πi jk/N}.             (1)
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from fenicsrom.arrays import Array
from fenicsrom.assess.errors.estimates import MotionErrors, basis_errors, check_motion
from fenicsrom.assess.errors.plausibility import (
    implausible_motion,
    is_explained,
    slides,
    strain_warnings,
)
from fenicsrom.assess.errors.verdicts import error_notes, estimate_errors
from fenicsrom.errors import AccuracyError, ConvergenceError
from fenicsrom.notes import FREQUENCIES, Note, NoteKind
from fenicsrom.online.model.disk_model import DiskModel, deviations, disk_model, disk_scene
from fenicsrom.online.motion.motion import Interrupted, Motion, attempted, check_energy
from fenicsrom.online.run.march import motion_of
from fenicsrom.online.run.simulate import simulate
from fenicsrom.online.step.state import Checkpoint
from fenicsrom.online.stress.reactions import Peak, equilibrium_peak, largest_row, peak
from fenicsrom.online.stress.stress import StressTable, deformation_at, extremes
from fenicsrom.progress import working_time
from fenicsrom.reduction.training import beyond, duration, probe_amplitude, unsettled
from fenicsrom.scene.keys.schema import Scene
from fenicsrom.words import brief, counted

if TYPE_CHECKING:
    from fenicsrom.online.store.disk import StoredDisk
    from fenicsrom.reduction.stages import Timer

WAVE_ERROR = 0.01
"""Largest accepted error of the frequencies of a nodal diameter by the reduction."""


@brief()
@dataclass(eq=False, repr=False, kw_only=True)
class DiskRun:
    """The motion of a disk under a scene.

    Attributes:
        disk: the reduced sector and the scene.
        model: the disk in time.
        mistuning: (N,) relative changes of the stiffness of the sectors.
        motion: the motion; up to a failure if there was one.
        tuned: the motion of the disk of equal sectors; None if the sectors are equal.
        peaks_of_stress: largest stresses in the equilibrium, and of each chosen sector over the
            last period, at places of the first sector.
        errors: estimated errors of the motion of the contact points, or of the probe of sector 0,
            by their causes "time step" and "basis".
        seconds: run time.
        warnings: notes for the user.
        unfinished: the error that ended the motion; None without one.
        interrupted: whether the run was asked to stop.
        files: the written files, the one to open first at the head.
    """

    disk: StoredDisk
    model: DiskModel
    mistuning: Array
    motion: Motion
    tuned: Motion | None = None
    peaks_of_stress: list[Peak] = field(default_factory=list)
    errors: dict[str, MotionErrors] = field(default_factory=dict)
    seconds: float = 0.0
    warnings: list[Note] = field(default_factory=list)
    unfinished: ConvergenceError | AccuracyError | None = None
    interrupted: bool = False
    files: list[Path] = field(default_factory=list)

    @property
    def ended(self) -> bool:
        """Whether a motion ended early, or is refused."""
        return self.interrupted or self.unfinished is not None

    @property
    def scene(self) -> Scene:
        """The scene of a sector."""
        return self.disk.scene

    @cached_property
    def displacement(self) -> Array:
        """(ns, N, d) displacement of the probes over the last period, in their sectors' frames."""
        assert self.motion.coordinates is not None
        return self.model.displacements(self.motion.coordinates)

    @cached_property
    def direction(self) -> int:
        """The axis of the sector's frame along which the probes move most."""
        return int(np.argmax(np.ptp(self.displacement, axis=0).max(axis=0)))

    def _amplitudes(self, displacement: Array) -> Array:
        """(N,) amplitudes along this axis: half of peak to peak, m."""
        return np.asarray(np.ptp(displacement[:, :, self.direction], axis=0) / 2.0)

    @property
    def peaks(self) -> Array:
        """(N,) amplitudes of the probes along this axis, m."""
        return self._amplitudes(self.displacement)

    @property
    def amplification(self) -> float | None:
        """Largest amplitude over that of the tuned disk; None for a tuned disk."""
        if self.tuned is None or self.tuned.coordinates is None:
            return None
        largest = float(self._amplitudes(self.model.displacements(self.tuned.coordinates)).max())
        return float(self.peaks.max()) / largest if largest > 0.0 else None

    @property
    def shares(self) -> Array:
        """(N/2 + 1,) share (1) of each nodal diameter in the motion."""
        moved = self.displacement - self.displacement.mean(axis=0)
        parts = np.sum(np.abs(np.fft.fft(moved, axis=1)) ** 2, axis=(0, 2))
        k = np.arange(parts.size)
        folded = np.bincount(np.minimum(k, parts.size - k), weights=parts)
        return np.asarray(folded / max(float(parts.sum()), 1e-300))


def _estimate(
    disk: StoredDisk,
    scene: Scene,
    mistuning: Array,
    model: DiskModel,
    motion: Motion,
    errors: dict[str, MotionErrors],
) -> None:
    """Estimate the errors of a motion by the steps, and by the reduction from a larger sector.

    Args:
        disk: the disk.
        scene: the scene with the loads of all sectors.
        mistuning: (N,) relative changes of the stiffness of the sectors.
        model: the model that was integrated.
        motion: its motion.
        errors: receives the estimates by their causes.

    Raises:
        AccuracyError: an estimate is above its limit.
    """
    larger = disk_model(disk.larger, scene, mistuning)
    try:
        other = check_motion(larger, scene, motion)
    except (ConvergenceError, AccuracyError):
        other = None
    estimate_errors(model, None, scene, motion, errors, basis_errors(motion, other))


def _peaks(table: StressTable, scene: Scene, model: DiskModel, motion: Motion) -> list[Peak]:
    """The largest stresses in the equilibrium, and of the chosen sectors over the last period."""
    time, coordinates = motion.coordinate_time, motion.coordinates
    assert coordinates is not None and time is not None
    measure, wanted = scene.output.stresses, scene.output.sectors
    found, every = [equilibrium_peak(table, measure)], model.sector_coordinates(coordinates)
    for j in range(len(every)):
        q: Array = every[j]
        if wanted == "all" or j in wanted:
            row = largest_row(table, q, measure)
            stress = table.stress(q[row], measure)
            found.append(peak(table, stress, f"sector {j}", q[row], float(time[row])))
    return found


def _slides(disk: StoredDisk, motion: Motion) -> list[Note]:
    """A note on each contact between bodies whose points slide past their neighbours."""
    points = disk.sector.model.points
    d, count = points.position.shape[1], len(points.contact)
    moved = (motion.displacement - motion.displacement[0]).reshape(len(motion.time), -1, count, d)
    closed = (motion.force[:, :, 0] > 0.0).reshape(moved.shape[:-1])
    moved, closed = (np.concatenate(np.moveaxis(part, 1, 0)) for part in (moved, closed))
    return [*slides(moved, closed, points, disk.scene)]


def _implausible(disk: StoredDisk, motion: Motion) -> list[Note]:
    """The note on the sector whose contact points move most, else those on slides in any sector."""
    points, largest = disk.sector.model.points, motion
    if count := len(points.contact):
        size = np.linalg.norm(motion.displacement, axis=2).max(axis=0)
        first = int(np.argmax(size)) // count * count
        own = slice(first, first + count)
        largest = replace(
            motion,
            displacement=motion.displacement[:, own],
            force=motion.force[:, own],
            gap=motion.gap[:, own],
        )
    found = implausible_motion(largest, points, disk.extent, disk.scene)
    return found if is_explained(found) or not disk.scene.joined else _slides(disk, motion)


def reduction_notes(disk: StoredDisk) -> list[Note]:
    """Notes on a disk, on waves that its reduction changes, and on output that it cannot give."""
    (h, error), found = disk.wave_error, disk.warnings
    if error > WAVE_ERROR:
        text = f"the reduction changes frequencies of waves with {counted(h, 'nodal diameter')} by "
        text += f"{100.0 * error:.2g} %: raise basis.modes"
        found.append(Note(NoteKind.ERROR, text, "basis.modes", quantity=FREQUENCIES))
    wanted = {
        "output.stresses": disk.scene.output.stresses != "none",
        "output.motion": disk.scene.output.motion,
    }
    for key in filter(wanted.get, wanted if disk.table is None else ()):
        text = f"{key} has no effect: the disk was stored without the points of its stresses; run "
        text += "the scene again, without --from"
        found.append(Note(NoteKind.LEFT_OUT, text, key))
    return found


def disk_run(disk: StoredDisk, timed: Timer) -> DiskRun:
    """Integrate a disk, and the tuned disk beside a mistuned one.

    Args:
        disk: the disk.
        timed: gives a context that times the stage of a name.

    Raises:
        SceneError: the scene cannot be used.
        ConvergenceError: there is no equilibrium.
    """
    begin, scene, sector = working_time(), disk.scene, disk.sector
    whole, delta = disk_scene(scene), deviations(scene)
    model = disk_model(sector, whole, delta)
    with timed("disk motion"):
        motion, unfinished, interrupted = _motion(model, whole)
    found = DiskRun(disk=disk, model=model, mistuning=delta, motion=motion)
    found.unfinished, found.interrupted = unfinished, interrupted
    warnings = found.warnings
    warnings += reduction_notes(disk)
    warnings += beyond(disk.trained, scene, probe_amplitude(motion), duration(motion))
    if not disk.file:
        warnings += unsettled(disk.trained, scene, motion)
    warnings += _implausible(disk, motion)
    try:
        if delta.any() and not found.ended:
            with timed("motion of the tuned disk"):
                equal = disk_model(sector, whole, np.zeros_like(delta))
                found.tuned, found.unfinished, found.interrupted = _motion(equal, whole)
        if disk.table is not None and scene.output.stresses != "none":
            with timed("stresses"):
                found.peaks_of_stress = _peaks(disk.table, scene, model, motion)
            states = [deformation_at(disk.table, at.coordinates) for at in found.peaks_of_stress]
            warnings += strain_warnings([("in the motion", extremes(states))])
        if not found.ended:
            with timed("errors of the steps and of the reduction"):
                _estimate(disk, whole, delta, model, motion, found.errors)
            warnings += error_notes(whole, found.errors, motion)
    except AccuracyError as failure:
        found.unfinished = failure
    except KeyboardInterrupt:
        found.interrupted = True
    moving = [each for each in (motion, found.tuned) if each and each.period is not None]
    varying = [each for each in moving if not each.steady]
    if scene.time.steady_tolerance and not found.ended and varying:
        text = f"the motion does not repeat after {counted(varying[0].periods, 'period')}: raise "
        text += "time.periods or time.steady_tolerance"
        warnings.append(Note(NoteKind.UNSETTLED, text, "time.periods"))
    found.seconds = working_time() - begin
    return found


def _motion(
    model: DiskModel, scene: Scene
) -> tuple[Motion, ConvergenceError | AccuracyError | None, bool]:
    """The motion of a disk, checked; the error that ended it, and whether it was interrupted.

    Raises:
        KeyboardInterrupt: an interrupt in the first period.
    """
    kept: list[Checkpoint] = []

    def keep(checkpoint: Checkpoint) -> None:
        kept[:] = [checkpoint]

    try:
        motion, failure = attempted(
            lambda: simulate(model, scene, keep_coordinates=True, checkpoint=keep)
        )
    except Interrupted as error:
        return error.partial, None, True
    except KeyboardInterrupt:
        if not kept:
            raise
        return motion_of(kept[0], scene.period), None, True
    try:
        check_energy(motion)
    except AccuracyError as error:
        failure = failure or error
    return motion, failure, False

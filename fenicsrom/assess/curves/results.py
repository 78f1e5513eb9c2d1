"""The record of response curves, its parts, and the files from which they continue.

A folder holds one file for each curve, so that the processes that compute the curves share no file.
Each file names the model and the scene it belongs to.
"""

from collections.abc import Mapping, Sequence
from dataclasses import MISSING, dataclass, field, fields
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from fenicsrom.arrays import Array
from fenicsrom.assess.curves.trust import LARGEST, Check
from fenicsrom.assess.errors.comparisons import MeshCheck
from fenicsrom.errors import AccuracyError, ConvergenceError, ErrorKind, refuse
from fenicsrom.files import read_archive, write_archive
from fenicsrom.notes import Note
from fenicsrom.online.contact.points import ContactPoints
from fenicsrom.online.curves.continuation import ForcedPeak
from fenicsrom.online.curves.curve import CurvePoint, Piece
from fenicsrom.online.periodic.balance import INSTANTS
from fenicsrom.online.periodic.shooting import FALLBACK_STEPS, largest_multiplier
from fenicsrom.online.store.archive import StoredModel
from fenicsrom.online.store.disk import StoredDisk
from fenicsrom.online.store.scene_changes import changed_run_key, first_difference
from fenicsrom.online.store.store import fingerprint, pack, unpack
from fenicsrom.scene import Response as ResponseTable
from fenicsrom.scene import Scene, parse_scene, scene_table
from fenicsrom.scene.base.rules import Where
from fenicsrom.scene.checks.curve_checks import uses_balance
from fenicsrom.scene.reading.overrides import in_words
from fenicsrom.words import brief

Table = TypeVar("Table")
Reduced = StoredModel | StoredDisk
"""What response curves start from; of a disk, curves are those of one sector in a wave."""


@dataclass(eq=False)
class CurveRecord:
    """The model that a curve belongs to, and how its computation ended.

    Attributes:
        scene: the scene.
        size: number of coordinates of the reduced model.
        contact_points: the contact points.
        seconds: run time.
        warnings: notes for the user.
        unfinished: the error that ended the computation, or that of the first curve that was not
            found; None if there is none.
        interrupted: whether the run was asked to stop; the last curve is then incomplete.
        files: the written files, the one to open first at the head.
        mesh_check: estimated errors of the natural frequencies due to the mesh, which move the
            curve by about as much.
    """

    scene: Scene
    size: int
    contact_points: ContactPoints
    seconds: float = field(default=0.0, kw_only=True)
    warnings: list[Note] = field(default_factory=list, kw_only=True)
    unfinished: ConvergenceError | AccuracyError | None = field(default=None, kw_only=True)
    interrupted: bool = field(default=False, kw_only=True)
    files: list[Path] = field(default_factory=list, kw_only=True)
    mesh_check: MeshCheck = field(default_factory=MeshCheck, kw_only=True)

    @property
    def contacts(self) -> int:
        """Number of contact points."""
        return self.contact_points.contact.size

    @property
    def steps(self) -> int:
        """Time steps of a period, or those of harmonic balance."""
        if uses_balance(self.scene):
            return INSTANTS
        return self.scene.time.steps_per_period or FALLBACK_STEPS


def required_table(scene: Scene, name: str, table: Table | None) -> Table:
    """The table of a scene with the given name.

    Raises:
        SceneError: the scene has no such table.
    """
    if table is None:
        allowed = "must be a table with first and last (or add "
        allowed += f"--set {name}.first=NUMBER --set {name}.last=NUMBER)"
        raise Where(scene.source, name).refuse(MISSING, allowed)
    return table


def require_polynomial(scene: Scene, what: str) -> None:
    """Check that the elastic force of the reduced model is an exact polynomial.

    Raises:
        SceneError: it is projected.
    """
    if scene.basis.elastic_force == "projection":
        where = Where(scene.source, "basis.elastic_force")
        allowed = f'must be "polynomial" for {what}'
        raise where.refuse("projection", allowed, ErrorKind.CONFLICT)


WIDE = 1e-4  # part of the range: special points within less count as located


@dataclass(frozen=True, eq=False)
class FullPoint:
    """The periodic motion of the full model at one value of the parameter.

    Attributes:
        parameter: its value.
        amplitude: (P, d) amplitude of the full model, as `CurvePoint.amplitude`, m.
        reduced_amplitude: (P, d) amplitude of the reduced model there, m.
        verdict: stability of the reduced motion: "stable", "fold", "period doubling" or "torus".
        periods: number of periods of the full model that were marched.
        derived: number of them that carried derivatives.
        residual: relative.
        seconds: run time.
    """

    parameter: float
    amplitude: Array
    reduced_amplitude: Array
    verdict: str
    periods: int
    derived: int
    residual: float
    seconds: float

    @property
    def error(self) -> float:
        """Error of the reduced amplitudes, relative to the largest amplitude: that of the basis."""
        size = float(self.amplitude.max())
        change = float(np.max(np.abs(self.reduced_amplitude - self.amplitude)))
        return change / size if size else 0.0


@dataclass(frozen=True, eq=False)
class Optimum:
    """The smallest peak over a second number.

    Attributes:
        peak: the peak.
        step_error: relative change of its amplitude with half the time step; None if not found.
        basis_error: likewise with a richer basis; None too if there is none.
        within: the values between which the optimum lies, if all peaks have these errors.
        larger: a motion on the same curve with a larger amplitude; None if there is none.
    """

    peak: ForcedPeak
    step_error: float | None
    basis_error: float | None
    within: tuple[float, ...]
    larger: CurvePoint | None = None


@dataclass(eq=False)
class ResponseCurve:
    """The periodic motions over the parameter, at one value of the second number.

    Attributes:
        value: value of the second number of the scene; None without families.
        pieces: the connected parts, that from the first value of the range first.
        checks: estimates of the errors at selected points.
        marches: number of all marched periods, and of those with derivatives.
        seconds: run time, without that of the full model.
        full: the motions of the full model at some values of the parameter.
        peaks: the peaks over the number `peak_over`: a list for each one that was followed, in the
            order in which they were found.
        optimum: the smallest of the largest ones; None without `peak_over`.
        harmonics: number of harmonics of harmonic balance; 0 of shooting.
    """

    value: float | None
    pieces: list[Piece] = field(default_factory=list)
    checks: list[Check] = field(default_factory=list)
    marches: tuple[int, int] = (0, 0)
    seconds: float = 0.0
    full: list[FullPoint] = field(default_factory=list)
    peaks: list[list[ForcedPeak]] = field(default_factory=list)
    optimum: Optimum | None = None
    harmonics: int = 0

    @property
    def points(self) -> list[CurvePoint]:
        """The points of all pieces."""
        return [point for piece in self.pieces for point in piece.points]

    @property
    def special(self) -> list[CurvePoint]:
        """The bifurcations and contact events of all pieces."""
        return [point for piece in self.pieces for point in piece.special]

    @property
    def step_error(self) -> float | None:
        """Relative change of the largest amplitude with half the time step; None if not found.

        Of harmonic balance, it is the change by more harmonics.
        """
        return next((c.step_error for c in self.checks if c.where == LARGEST), None)

    @property
    def basis_error(self) -> float | None:
        """Relative change of the largest amplitude with a richer basis; None if not found."""
        return next((c.basis_error for c in self.checks if c.where == LARGEST), None)


@brief()
@dataclass(eq=False, repr=False)
class Response(CurveRecord):
    """The response curves of a scene.

    Attributes:
        curves: one curve for each value of the second number; without a second number one curve.
    """

    curves: list[ResponseCurve] = field(default_factory=list)

    @property
    def table(self) -> ResponseTable:
        """The table [response] of the scene."""
        return response_table(self.scene)


def response_table(scene: Scene) -> ResponseTable:
    """The table [response] of a scene.

    Raises:
        SceneError: the scene has no table [response].
    """
    return required_table(scene, "response", scene.response)


def curve_title(scene: Scene, value: float | None) -> str:
    """The beginning of a sentence about the curve of a value, such as "loads.0.force = 25 N: "."""
    families = response_table(scene).families
    if families is None or value is None:
        return ""
    return f"{in_words(scene, families.key, value)}: "


def joined_titles(found: Response, titles: Sequence[str]) -> str:
    """The beginning of a sentence about several curves, from those of the single curves."""
    if len(titles) == len(found.curves) > 1:
        return "All curves: "
    return f"{', '.join(title.removesuffix(': ') for title in titles)}: " if titles[0] else ""


def joined_notes(found: Response) -> list[Note]:
    """The notes with the titles of their curves; equal ones of several curves are one."""
    same: dict[str, list[Note]] = {}
    for note in found.warnings:
        same.setdefault(note, []).append(note)
    return [
        notes[0].saying(f"{joined_titles(found, [note.curve for note in notes])}{text}")
        for text, notes in same.items()
    ]


def is_wide(found: Response, point: CurvePoint) -> bool:
    """Whether a special point is not located: its bracket is a visible part of the range."""
    return point.within > WIDE * (found.table.high - found.table.low)


def judged_multiplier(point: CurvePoint) -> complex:
    """The largest Floquet multiplier without those of sliders that are not unique."""
    return largest_multiplier(point.multipliers, point.free_sliders)


FORMAT = "fenicsrom response state 3"
WHAT = "the state of a response curve"


@dataclass(frozen=True, eq=False)
class KeptCurve:
    """The part of a curve that a file keeps.

    Attributes:
        curve: the computed part of the curve.
        done: whether it is complete.
    """

    curve: ResponseCurve
    done: bool


@dataclass(frozen=True, eq=False)
class CurveFile:
    """The file of one curve.

    Attributes:
        path: the file.
        number: number of the curve, from 1.
        model: fingerprint of the model.
        scene: the scene of all curves.
    """

    path: Path
    number: int
    model: str
    scene: Scene

    def save(self, curve: ResponseCurve, *, done: bool) -> None:
        """Write the file; it appears only when it is complete.

        Raises:
            OSError: the file cannot be written.
        """
        tree, arrays = pack(KeptCurve(curve, done))
        header = {
            "format": FORMAT,
            "model": self.model,
            "source": self.scene.source,
            "scene": scene_table(self.scene),
            "number": self.number,
            "tree": tree,
        }
        write_archive(self.path, header, arrays)

    def load(self, classes: Mapping[str, Any]) -> KeptCurve | None:
        """Read the file; None if it does not exist, because its curve did not begin.

        Args:
            classes: the dataclasses of a curve, by name.

        Raises:
            SceneError: the file is damaged, or belongs to another model or scene.
        """
        if not self.path.exists():
            return None
        with read_archive(self.path, WHAT, FORMAT) as (header, arrays):
            self._check(header)
            found: KeptCurve = unpack(header["tree"], arrays, {**classes, "KeptCurve": KeptCurve})
        return found

    def _check(self, header: Mapping[str, Any]) -> None:
        """Check that the file belongs to the model and the scene.

        Raises:
            SceneError: it does not.
        """
        made = parse_scene(header["scene"], str(header["source"]), None)
        if (key := changed_response_key(made, self.scene)) is not None:
            reason = "differs from the scene that wrote this file; "
            reason += "curves continue only with the same scene"
            raise refuse(self.path, reason, ErrorKind.MISMATCH, key)
        if header["model"] != self.model or header["number"] != self.number:
            reason = "another reduced model wrote this file; "
            reason += "resume with the model that wrote it: --from MODEL"
            raise refuse(self.path, reason, ErrorKind.MISMATCH)


def curve_file(folder: Path, stored: Reduced, number: int) -> CurveFile:
    """The file of a curve in a folder."""
    return CurveFile(
        folder / f"curve_{number}.npz", number, fingerprint(stored.model), stored.scene
    )


def check_folder(folder: Path) -> None:
    """Check that a folder holds the state of curves.

    Raises:
        SceneError: it does not, or a file is damaged.
    """
    files = sorted(folder.glob("curve_*.npz"))
    for file in files:
        with read_archive(file, WHAT, FORMAT):
            pass
    if not files:
        reason = "must be a folder with curve_1.npz, such as the response_state of an earlier run"
        raise refuse(folder, reason, ErrorKind.FILE)


def forget(folder: Path) -> None:
    """Remove the state of an earlier run.

    Raises:
        OSError: a file cannot be removed.
    """
    for path in folder.glob("curve_*.npz"):
        path.unlink(missing_ok=True)


def changed_response_key(made: Scene, wanted: Scene) -> str | None:
    """The first key on which a response curve depends and in which two scenes differ, or None."""
    if (key := changed_run_key(made, wanted)) is not None:
        return key
    if made.response is None or wanted.response is None:
        return None if made.response == wanted.response else "response"
    names = [part.name for part in fields(wanted.response)]
    name = first_difference(made.response, wanted.response, names)
    return None if name is None else f"response.{name}"

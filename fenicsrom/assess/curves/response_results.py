"""The parts of the response curves of a scene."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from fenicsrom.arrays import Array
from fenicsrom.assess.curves.branches import Piece
from fenicsrom.assess.curves.curve_record import CurveRecord, required_table
from fenicsrom.assess.curves.trust import LARGEST, Check
from fenicsrom.notes import Note
from fenicsrom.online.curves.curve import CurvePoint
from fenicsrom.online.curves.forced_peak import ForcedPeak
from fenicsrom.online.periodic.shooting import largest_multiplier
from fenicsrom.scene import Response as ResponseTable
from fenicsrom.scene import Scene
from fenicsrom.scene.reading.units import in_words
from fenicsrom.words import brief

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
    """

    value: float | None
    pieces: list[Piece] = field(default_factory=list)
    checks: list[Check] = field(default_factory=list)
    marches: tuple[int, int] = (0, 0)
    seconds: float = 0.0
    full: list[FullPoint] = field(default_factory=list)
    peaks: list[list[ForcedPeak]] = field(default_factory=list)
    optimum: Optimum | None = None

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
        """Relative change of the largest amplitude with half the time step; None if not found."""
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

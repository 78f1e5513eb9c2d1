"""Sentences on the checks of a curve that do not hold what a run accepts."""

from __future__ import annotations

from collections.abc import Sequence

from fenicsrom.assess.curves.trust import FOLD, LARGEST, Check, size_of
from fenicsrom.assess.errors.verdicts import BASIS_ERROR, TIME_ERROR, in_percent
from fenicsrom.notes import AMPLITUDES, Note, NoteKind
from fenicsrom.scene import Scene
from fenicsrom.scene.reading.units import in_words
from fenicsrom.words import counted


def contradictions(curve_checks: Sequence[Check], scene: Scene, parameter: str) -> list[str]:
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
        groups: dict[tuple[str, str], list[tuple[Check, float]]] = {}
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


def inaccuracies(curve_checks: Sequence[Check], scene: Scene, parameter: str) -> list[str]:
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
        judged = [c for c in curve_checks if c.quantity == "amplitude" or c.where == FOLD]
        sizes = [getattr(check, name) or 0.0 for check in judged]
        worst = max(sizes, default=0.0)
        if worst > limit:
            check = judged[sizes.index(worst)]
            changed = "amplitude" if check.where != FOLD else f"{parameter} of a fold"
            said.append(
                f"{what} changes the {changed} by {in_percent(worst)} at "
                f"{in_words(scene, parameter, check.point.parameter)} (a run accepts an error of "
                f"{in_percent(limit)}): {advice}."
            )
    return said


def unknown_errors(curve_checks: Sequence[Check], title: str) -> list[Note]:
    """Notes on errors that are unknown; only that of the largest amplitude casts doubt.

    Args:
        curve_checks: checks of a curve.
        title: of the curve.
    """
    compared = [check for check in curve_checks if check.compared]
    top = next((check for check in curve_checks if check.where == LARGEST), None)
    said = []
    if curve_checks and (top is None or top.step_error is None):
        text = (
            "the change of the largest amplitude by half the time step is unknown: its motion was "
            "not found."
        )
        said.append(Note(NoteKind.UNCHECKED, text, curve=title, quantity=AMPLITUDES))
    if unknown := sum(check.unknown for check in compared):
        largest = any(check.unknown and check.where == LARGEST for check in compared)
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


def _place(group: Sequence[tuple[Check, float]], scene: Scene, parameter: str) -> str:
    """Where some checks of a curve are: a value of the parameter, or a range."""
    values = [check.point.parameter for check, _ in group]
    if len(values) == 1:
        return in_words(scene, parameter, values[0])
    last = in_words(scene, parameter, max(values))
    return f"{len(values)} points from {parameter} = {min(values):.6g} to {last}"


def _outside(other: str, group: Sequence[tuple[Check, float]]) -> float:
    """How far outside of the unit circle a multiplier is, where the instability is found."""
    return max(size_of(check.point) if other == "stable" else size for check, size in group) - 1.0


def _in_words(verdict: str) -> str:
    """The stability of a motion in words."""
    return verdict if verdict == "stable" else f"unstable ({verdict})"

"""Notes: sentences that know what they are about, and the verdict on results that they give.

Code looks at the kind, the key and the quantity of a note, never at its text.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from enum import Enum

from fenicsrom.words import counted

AMPLITUDES = "amplitudes"
PROBE = "amplitudes of the probe"
PEAK_FORCE = "peak normal force"
STABILITY = "stability"
EVENTS = "contact events"
PEAKS = "peaks"
DISSIPATION = "energy dissipated by friction"
WEAR = "worn depth"
FREQUENCIES = "frequencies"
DAMPING_RATIOS = "damping ratios"
CRITICAL = "critical speeds"
DEFLECTION = "static deflection"
STRESSES = "stresses and reactions"
"""Quantities that several commands judge."""


class NoteKind(Enum):
    """What a note is about."""

    # kinds that cast doubt on results, the worst one first: a verdict quotes the worst note
    FAILED = "a computation that failed"
    CUT_SHORT = "an interrupt before the results were checked"
    APART = "pieces of a mesh that do not see each other"
    UNSETTLED = "a motion that does not repeat"
    UNSTABLE = "the stability of an equilibrium"
    LAW = "a state in which the material law has no meaning"
    IMPLAUSIBLE = "input that is most likely a mistake"
    ERROR = "an estimated error above its limit"
    SEVERAL = "a motion beside which there are others"
    BASIS = "loads that the modes of the basis do not follow"
    UNCHECKED = "an error that is not estimated"
    WARNING = "a reason for doubt that no other kind describes"
    # kinds that do not
    REMARK = "what the user should know about right results"
    LEFT_OUT = "a stage that was not computed, with the reason"
    NOT_DRAWN = "a picture that was not drawn"

    @property
    def doubts(self) -> bool:
        """Whether such a note casts doubt on the quantities that it concerns."""
        return self not in (NoteKind.REMARK, NoteKind.LEFT_OUT, NoteKind.NOT_DRAWN)


class Note(str):
    """A sentence for the user.

    Attributes:
        kind: what it is about.
        key: the key of the scene, the stage or the file that it is about, or "".
        curve: title of the curve that it is about, or "".
        quantity: the quantity that it concerns, such as "peak normal force"; "" for all.
    """

    kind: NoteKind
    key: str
    curve: str
    quantity: str

    def __new__(
        cls, kind: NoteKind, text: str, key: str = "", curve: str = "", quantity: str = ""
    ) -> Note:
        """Make a note of a text."""
        note = super().__new__(cls, text)
        note.kind, note.key, note.curve, note.quantity = kind, key, curve, quantity
        return note

    def saying(self, text: str) -> Note:
        """The note with another text."""
        return Note(self.kind, text, self.key, self.curve, self.quantity)

    def __getnewargs__(self) -> tuple[NoteKind, str, str, str, str]:  # type: ignore[override]
        """The arguments of a copy in another process."""
        return self.kind, str(self), self.key, self.curve, self.quantity


def note_of(text: str) -> Note:
    """A note; a text without a kind casts doubt on all quantities."""
    return text if isinstance(text, Note) else Note(NoteKind.WARNING, text)


def implausible(text: str) -> Note:
    """A note on input that is most likely a mistake."""
    return Note(NoteKind.IMPLAUSIBLE, f"implausible: {text}")


def has_kind(notes: Iterable[str], *kinds: NoteKind) -> bool:
    """Whether one of the notes has one of the kinds."""
    return any(note_of(note).kind in kinds for note in notes)


def packed(notes: Iterable[str]) -> list[list[str]]:
    """Notes as plain data, for an archive."""
    rows = (note_of(note).__getnewargs__() for note in notes)
    return [[kind.name, *texts] for kind, *texts in rows]


def unpacked(rows: Iterable[Sequence[str]]) -> list[Note]:
    """The notes of `packed`."""
    return [Note(NoteKind[kind], *texts) for kind, *texts in rows]


@dataclass(frozen=True)
class Verdict:
    """Whether results can be trusted.

    Attributes:
        kind: one of `VERDICTS`.
        reason: why.
        quantities: for each quantity that the user reads, "trusted", "not judged" or the reason for
            doubt.
    """

    kind: str
    reason: str
    quantities: Mapping[str, str]

    @property
    def text(self) -> str:
        """The verdict in one line."""
        return f"{self.kind.capitalize()}: {self.reason}"


VERDICTS = ("trusted", "doubtful", "incomplete", "refused")
"""The kinds of verdicts, the worst one last."""

TRUSTED, UNJUDGED = VERDICTS[0], "not judged"


def verdict_of(
    notes: Iterable[str],
    failure: object = None,
    *,
    interrupted: bool = False,
    quantities: Collection[str] = (),
    unjudged: Collection[str] = (),
) -> Verdict:
    """Judge each quantity that the user reads; the line on top is the worst of them.

    Args:
        notes: the notes; those whose kind casts no doubt do not count.
        failure: why there is no result, or why it is refused; None for a complete result. An error
            with a `quantity`, on which there is a note too, leaves the other quantities.
        interrupted: whether the computation was interrupted.
        quantities: the names of the quantities.
        unjudged: the names of others, whose errors no check knows.
    """

    def all_are(kind: str, reason: str) -> Verdict:
        return Verdict(kind, reason, dict.fromkeys([*quantities, *unjudged], f"{kind}: {reason}"))

    doubts = [note for note in dict.fromkeys(map(note_of, notes)) if note.kind.doubts]
    cut = [note for note in doubts if note.kind is NoteKind.CUT_SHORT]
    if failure is not None and not getattr(failure, "quantity", ""):
        return all_are("refused", str(failure))
    if interrupted or cut:
        return all_are("incomplete", cut[0] if cut else "the computation was interrupted.")
    reasons = {
        name: next((note for note in doubts if note.quantity in ("", name)), TRUSTED)
        for name in quantities
    }
    silent = f" Not judged: {_listed(list(unjudged))}." if unjudged else ""
    judged = {**reasons, **dict.fromkeys(unjudged, UNJUDGED)}
    if not doubts:
        of = f" about {_listed(list(quantities))}" if quantities else ""
        return Verdict(TRUSTED, f"no check found a reason for doubt{of}.{silent}", judged)
    kinds = list(NoteKind)
    first = min(doubts, key=lambda note: (kinds.index(note.kind), note.quantity != ""))
    names = dict.fromkeys(note.quantity for note in doubts)
    name = "" if "" in names else f"{_listed(list(names))}: "
    more = f", and {counted(len(doubts) - 1, 'more warning')}" if len(doubts) > 1 else ""
    good = [name for name, reason in reasons.items() if reason is TRUSTED]
    rest = f" Trusted: {_listed(good)}." if good else ""
    kind = "doubtful" if failure is None else "refused"
    return Verdict(kind, f"{name}{first.removesuffix('.')}{more}.{rest}{silent}", judged)


def _listed(names: Sequence[str]) -> str:
    """Names in words: "a, b and c"."""
    *most, last = names
    return f"{', '.join(most)} and {last}" if most else last

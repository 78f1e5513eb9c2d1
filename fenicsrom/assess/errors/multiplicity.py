"""Whether a motion is the only one: warnings of buckled equilibria and of sticking points."""

from fenicsrom.notes import Note, NoteKind
from fenicsrom.online.motion.motion import Motion
from fenicsrom.words import are, counted


def multiplicity_warnings(name: str, motion: Motion) -> list[Note]:
    """Warn that a model has another equilibrium or periodic motion than the one of a motion.

    Args:
        name: the model: "reduced", "full" or "beam".
        motion: its motion.
    """
    found = [_buckled_sentence(name, motion)] if motion.buckled else []
    if sentence := free_slider_sentence(name, motion):
        found.append(sentence)
    return [Note(NoteKind.SEVERAL, text) for text in found]


def _buckled_sentence(name: str, motion: Motion) -> str:
    """Warn that the preload has buckled a model."""
    return (
        f"the preload buckles the {name} model: its equilibrium nearest to the unloaded body is "
        f"unstable in {counted(motion.buckled, 'direction')}, so the motion starts from a stable "
        "equilibrium nearby"
    )


def free_slider_sentence(name: str, motion: Motion) -> str | None:
    """Warn that the periodic motion is not unique; None if it is."""
    search = motion.search
    if search is None or not search.accepted or search.free_sliders == 0:
        return None
    free = counted(search.free_sliders, "slider position")
    return (
        f"the periodic motion of the {name} model is not unique: {free} of contact points that "
        f"stick all the time {are(search.free_sliders)} free; the run takes the motion nearest to "
        "the marched one"
    )

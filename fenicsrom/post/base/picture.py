"""Pictures, how they are drawn to files, and what to see in each."""

import re
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

from fenicsrom.notes import Note, NoteKind
from fenicsrom.post.base.chart import chart
from fenicsrom.post.base.style import Figure, missing_module, missing_renderer
from fenicsrom.post.base.tables import write_figure
from fenicsrom.progress import tracked

CAPTIONS = {
    "setup": "The body with its supports, loads and contact points.",
    "motion": "Displacement of the contact point or probe. Where the motion repeats, this is its "
    "last period. Lines that lie on each other agree.",
    "probe": "Displacement of the probe, beside that of the contact points.",
    "spectra": "The motion over time, and its spectrum beside the natural frequencies (dashed).",
    "section": "One point for each period of the load. A motion that repeats gives a few points, a "
    "quasi-periodic one a closed curve.",
    "rub_map": "The state of each contact point over the last period.",
    "energy": "The work of the loads is the sum of the stored and the dissipated energy. The "
    "imbalance is the error of this sum.",
    "energy_per_period": "Energies of each period. Bars of the same height mean a steady motion.",
    "contact": "States and forces of contact over the last period. The area inside a loop of the "
    "tangential force over the displacement is the energy that friction dissipates.",
    "wear": "The depth that the body wore of the abradable layer, over the angle of the casing; or "
    "before each contact point over time, if the surface does not turn.",
    "stress": "The von Mises stress at the instant and on the side of its largest value.",
    "modes": "The shapes of the basis along the axis of the body, relative to their largest value.",
    "shapes": "The shapes of the basis: normal modes (V) with nodal lines, static modes (S), and "
    "modal derivatives. Displacements are magnified.",
    "equilibrium": "The equilibrium under the static loads. The grey lines are the body at rest.",
    "mac": "Agreement of the modes: 1 on the diagonal means the same shapes.",
    "coordinates": "The part of each normal mode in the motion. Later modes should be small.",
    "sizes": "A larger basis costs more time and has a smaller error. The chosen size is marked.",
    "response": "Amplitude, phase and energies over the parameter. Stable parts are solid, "
    "unstable ones dashed.",
    "peaks": "The largest amplitude of the probe over the frequency, and its frequency, over a "
    "second number. Thin lines are the peaks that were followed; the diamond marks the smallest.",
    "contact_map": "The state of contact over the period, along the curve.",
    "harmonics": "Amplitudes of the harmonics along the curve.",
    "backbone": "Frequency and damping of the mode over its amplitude.",
    "ringdown": "The decay, and the frequency and damping of its periods over their amplitude.",
    "run_up": "Each revolution over its mean speed: the largest distance from the equilibrium of "
    "the same speed, the largest normal force, and the mean torque of the shaft. Dashed: speeds "
    "where an engine order of the loads or waves meets a mode without contact.",
    "campbell": "Natural frequencies over the speed. Where an engine order crosses a frequency, "
    "the mode can resonate.",
    "map": "Amplitude over speed and frequency. Dotted lines: excitation; solid and dashed curves: "
    "natural frequencies, free and with the contact closed.",
    "map_curves": "One number for each speed.",
    "map_wear": "The depth that the body wore of the abradable layer, over the angle of the "
    "casing, and the number of its lobes.",
    "sweep": "One point for each run of the sweep.",
    "motion.gif": "The last period. Displacements are magnified as stated.",
}
NUMBERS = {
    **dict.fromkeys(("motion", "spectra", "section", "rub_map", "coordinates"), "history.npz"),
    **dict.fromkeys(("contact", "energy", "energy_per_period", "motion.gif"), "history.npz"),
    **dict.fromkeys(("response", "contact_map", "multipliers", "harmonics"), "response.csv"),
    **dict.fromkeys(("sizes", "mac"), "summary.json"),
    **{
        name: f"{name}.csv"
        for name in ("run_up", "backbone", "campbell", "map", "sweep", "comparison", "wear")
    },
    "ringdown": "ringdown.csv",
    "map_wear": "map_wear.csv",
    "equilibria": "equilibria.csv",
    "peaks": "response_peaks.csv",
    "stress": "stresses.csv",
}


def caption(name: str) -> str:
    """What to see in a picture; "" of a picture without a caption."""
    return CAPTIONS.get(name) or CAPTIONS.get(_kind(name), "")


def numbers_of(name: str) -> str | None:
    """The file with the numbers of a picture; None if there is none."""
    return NUMBERS.get(name) or NUMBERS.get(_kind(name))


def _kind(name: str) -> str:
    """The name of a picture without its suffix and number."""
    return re.sub(r"(_\d+)?\.\w+$", "", name)


@dataclass(frozen=True)
class Picture:
    """A picture that is not drawn yet.

    Attributes:
        heading: its heading in the report.
        name: name of the file.
        draw: makes the figure.
        note: what the picture shows, below it in the report; by default that of its name in
            `fenicsrom.post.base.picture`.
        in_space: whether it shows a body in space, which pyvista draws.
    """

    heading: str
    name: str
    draw: Callable[[], Figure]
    note: str = ""
    in_space: bool = False


@dataclass(frozen=True)
class Drawn:
    """A picture that is drawn.

    Attributes:
        heading: its heading in the report.
        path: the file.
        note: what the picture shows.
        chart: its curves, to zoom (`fenicsrom.post.base.chart`); None of other pictures.
    """

    heading: str
    path: Path
    note: str = ""
    chart: str | None = None


def not_drawn(names: Sequence[str], in_space: bool = False) -> Note | None:
    """Say in one sentence that these pictures are left out; None if they can be drawn.

    Args:
        names: of their files.
        in_space: whether they show a body in space.
    """
    if not names:
        return None
    reason = missing_renderer() if in_space else missing_module("matplotlib")
    if reason is None:
        return None
    *most, last = names
    listed = f"{', '.join(most)} and {last} were" if most else f"{last} was"
    return Note(NoteKind.NOT_DRAWN, f"{listed} not drawn: {reason}")


def draw_pictures(pictures: Sequence[Picture], folder: Path, notes: list[Note]) -> list[Drawn]:
    """Draw and write pictures; a picture that cannot be drawn gives a warning.

    Args:
        pictures: the pictures.
        folder: folder of the files.
        notes: receives the warnings.

    Returns:
        The pictures that were written.

    Raises:
        OSError: a file cannot be written.
    """
    drawn = list(pictures)
    for in_space in (False, True):
        names = [picture.name for picture in drawn if picture.in_space or not in_space]
        if sentence := not_drawn(names, in_space):
            notes.append(sentence)
            drawn = [picture for picture in drawn if picture.name not in names]
    written = []
    for picture in tracked(drawn):
        with softly(picture.name, notes):
            figure = picture.draw()
            path = write_figure(folder / picture.name, figure)
            note = picture.note or caption(picture.name)
            written.append(Drawn(picture.heading, path, note))
            if not picture.in_space:
                written[-1] = replace(written[-1], chart=chart(figure))
    return written


@contextmanager
def softly(name: str, notes: list[Note]) -> Iterator[None]:
    """Turn an error in the drawing of a picture into a warning: the numbers are written.

    Raises:
        OSError: the file cannot be written.
    """
    try:
        yield
    except OSError:
        raise
    except Exception as error:
        reason = f"{name} was not drawn: {type(error).__name__}: {error}"
        notes.append(Note(NoteKind.NOT_DRAWN, reason, name))

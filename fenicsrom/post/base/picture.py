"""Pictures, and how they are drawn to files."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from fenicsrom.notes import Note, NoteKind
from fenicsrom.post.base.chart import chart
from fenicsrom.post.base.drawing import figure_of
from fenicsrom.post.base.plot import Plot
from fenicsrom.post.base.style import missing_module, missing_renderer
from fenicsrom.post.base.tables import write_figure
from fenicsrom.progress import tracked

NAMES = (
    *("setup", "motion", "probe", "spectra", "section", "rub_map", "energy", "energy_per_period"),
    *("contact", "contact_[1-4]", "wear", "stress", "modes", "shapes", "equilibrium", "mac"),
    *("coordinates", "sizes", "run_up"),
    *("campbell", "map", "map_curves", "map_wear", "sweep", "stability"),
    *("interference",),
    *("response", "peaks", "contact_map", "multipliers", "harmonics", "backbone", "equilibria"),
    *("ringdown", "disk", "comparison", "pareto", "size", "indicator"),
)
"""Patterns of the names of pictures, without their suffix."""


@dataclass(frozen=True)
class Picture:
    """A picture that is not drawn yet.

    Attributes:
        heading: its heading in the report.
        name: name of the file.
        draw: makes the plot.
        caption: what to see in it, below it in the report.
        numbers: the file with its numbers; "" of none.
        in_space: whether it shows a body in space, which pyvista draws.
    """

    heading: str
    name: str
    draw: Callable[[], Plot]
    caption: str = ""
    numbers: str = ""
    in_space: bool = False


@dataclass(frozen=True)
class Drawn:
    """A picture that is drawn.

    Attributes:
        heading: its heading in the report.
        path: the file.
        caption: what to see in it.
        numbers: the file with its numbers; "" of none.
        chart: its curves, to zoom (`fenicsrom.post.base.chart`); None of other pictures.
    """

    heading: str
    path: Path
    caption: str = ""
    numbers: str = ""
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
            plot = picture.draw()
            path = write_figure(folder / picture.name, figure_of(plot))
            told = picture.heading, path, picture.caption, picture.numbers
            written.append(Drawn(*told, chart(plot)))
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

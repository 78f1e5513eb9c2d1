"""Numbers, tables and figures from motions, and the report that holds them.

Figures are matplotlib `Figure` objects, made without pyplot: nothing is shown, nothing is left
open, and `figure.savefig(path)` writes them.
"""

from __future__ import annotations

import base64
import csv
import functools
import html
import io
import itertools
import json
import math
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from fenicsrom.errors import AccuracyError
from fenicsrom.files import atomic_write

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from fenicsrom.online.motion import Motion

# Okabe and Ito's colours, which stay apart for colour-blind readers, without the yellow, which is
# lost on white.
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000")
STATES = {-1: ("open", "#D9DDE1"), 0: ("slip", "#E69F00"), 1: ("stick", "#0072B2")}
_LINES: dict[str, dict[str, Any]] = {
    "full": {"color": "#A6ABB0", "linewidth": 4.0, "zorder": 2},
    "beam": {"color": "#D55E00", "linewidth": 1.6, "linestyle": (0, (5, 3)), "zorder": 4},
    "reduced": {"color": "#0072B2", "linewidth": 1.6, "zorder": 3},
}
_STYLE = {
    "font.family": "sans-serif",
    "font.sans-serif": ["DejaVu Sans"],
    "font.size": 10.5,
    "axes.titlesize": 11,
    "axes.titlelocation": "left",
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.edgecolor": "#555B61",
    "axes.grid": True,
    "axes.axisbelow": True,
    "axes.formatter.limits": (-3, 4),
    "axes.formatter.use_mathtext": True,
    "grid.color": "#E6E8EA",
    "grid.linewidth": 0.8,
    "legend.frameon": False,
    "legend.fontsize": 10,
    "lines.linewidth": 1.6,
    "figure.facecolor": "white",
    "savefig.facecolor": "white",
}


# figures


def styled(draw: Callable[..., Figure]) -> Callable[..., Figure]:
    """Run a function that draws under the common style."""

    @functools.wraps(draw)
    def drawn(*args: Any, **kwargs: Any) -> Figure:
        import matplotlib

        with matplotlib.rc_context(_STYLE):
            return draw(*args, **kwargs)

    return drawn


def new_figure(width: float, height: float) -> Figure:
    """An empty figure of this size, inches."""
    from matplotlib.figure import Figure

    return Figure(figsize=(width, height), dpi=140, layout="constrained")


def line_styles(names: Iterable[str]) -> dict[str, dict[str, Any]]:
    """One line style per name: `full`, `beam` and `reduced` always look the same, the others take
    the colours left.
    """
    names = list(names)
    free = [
        colour
        for colour in COLOURS
        if all(_LINES[name]["color"] != colour for name in names if name in _LINES)
    ]
    cycle = itertools.cycle(itertools.product(("-", "--", "-.", ":"), free))
    return {
        name: _LINES.get(name) or dict(zip(("linestyle", "color"), next(cycle), strict=True))
        for name in names
    }


@styled
def plot_motion(motions: Mapping[str, Motion], point: int = 0) -> Figure:
    """Displacements over the last two periods, one panel per direction, all models in each (the
    paper's fig. 5).

    Args:
        motions: by the name of the model.
        point: number of the contact point.
    """
    styles = line_styles(motions)
    directions = max(motion.displacement.shape[2] for motion in motions.values())
    touching = any(_touches(motion) for motion in motions.values())
    figure = new_figure(8.6, 0.7 + 2.2 * directions)
    axes = figure.subplots(directions, 1, sharex=True, squeeze=False)[:, 0]
    for name, motion in motions.items():
        time, part = _phase(motion, 2)
        for k in range(motion.displacement.shape[2]):
            axes[k].plot(
                time, 1e3 * motion.displacement[part, point, k], label=name, **styles[name]
            )
    for k, axis in enumerate(axes):
        axis.set_ylabel(f"{_direction(k, directions, touching)}\ndisplacement, mm")
        axis.margins(x=0)
    periodic = all(motion.period is not None for motion in motions.values())
    axes[-1].set_xlabel("time / period" if periodic else "time, s")
    _legend(figure, axes[0])
    return figure


# What the loops of a contact point are drawn from, by the number of directions: displacement u or
# force f along the normal (0) or a tangent, against another; the last one is the orbit of the
# point.
_LOOPS = {
    2: (("u1", "f1"), ("u0", "f0"), ("u1", "u0")),
    3: (("u1", "f1"), ("u2", "f2"), ("u0", "f0"), ("u1", "u2")),
}


@styled
def plot_contact(motions: Mapping[str, Motion], point: int = 0) -> Figure:
    """States over the last period, and contact forces against displacements (the paper's figs. 6
    and 13).

    The loops are the tangential force against the tangential displacement, one panel per tangent
    direction, and the normal force against the normal displacement; the last panel is the orbit of
    the point: in 2D its normal against its tangential displacement, in 3D its path in the contact
    plane.

    Args:
        motions: by the name of the model; those without contact are left out.
        point: number of the contact point.
    """
    motions = {name: motion for name, motion in motions.items() if _touches(motion)}
    directions = max((motion.displacement.shape[2] for motion in motions.values()), default=2)
    loops = len(_LOOPS[directions])
    columns = 3 if loops == 3 else 2
    rows = loops // columns
    strip = 0.75 + 0.33 * len(motions)
    figure = new_figure(4.1 * columns if columns == 2 else 10.8, 0.4 + strip + 3.3 * rows)
    grid = figure.add_gridspec(1 + rows, columns, height_ratios=[strip] + [3.3] * rows)
    _plot_states(figure.add_subplot(grid[0, :]), motions, point)
    panels = [figure.add_subplot(grid[1 + k // columns, k % columns]) for k in range(loops)]
    _plot_loops(panels, motions, point)
    _legend(figure, panels[0])
    return figure


@styled
def plot_points(
    motions: Mapping[str, Motion], points: Mapping[str, Sequence[Mapping[str, Any]]]
) -> Figure:
    """All contact points in one picture: how hard each is pressed, how long it touches, what it
    rubs away.

    Below them the loops of the point that is pressed hardest in the first of the motions.

    Args:
        motions: by the name of the model; those without contact are left out.
        points: by the name of the model, as `point_summaries`.
    """
    motions = {name: motion for name, motion in motions.items() if _touches(motion)}
    styles = line_styles(motions)
    first = next(iter(motions))
    hardest = int(np.argmax([point["peak_normal_force_N"] for point in points[first]]))
    directions = motions[first].displacement.shape[2]
    loops = len(_LOOPS[directions])
    figure = new_figure(3.6 * loops, 7.2)
    above, below = figure.subfigures(2, 1)
    axes = above.subplots(1, 3)
    curves = {
        "peak normal force, N": lambda point: point["peak_normal_force_N"],
        "time in contact, %": lambda point: 100.0 * (1.0 - point["fraction"]["open"]),
        "rubbed away, J": lambda point: point["dissipated_per_period_J"],
    }
    for axis, (label, value) in zip(axes, curves.items(), strict=True):
        for name in motions:
            found = [value(point) for point in points[name]]
            axis.plot(
                range(1, len(found) + 1),
                found,
                marker="o",
                markersize=3.5,
                label=name,
                **styles[name],
            )
        axis.set(xlabel="contact point", ylabel=label)
        axis.xaxis.get_major_locator().set_params(integer=True)
    panels = below.subplots(1, loops)
    _plot_loops(
        panels,
        {name: motion for name, motion in motions.items() if motion.state.shape[1] > hardest},
        hardest,
    )
    below.suptitle(
        f"point {hardest + 1}, pressed hardest", x=0.01, horizontalalignment="left", fontsize=11
    )
    _legend(figure, axes[0])
    return figure


def _plot_loops(panels: Sequence[Axes], motions: Mapping[str, Motion], point: int) -> None:
    """The loops of a contact point over the last period, a panel for each of `_LOOPS`, the orbit
    the last.
    """
    styles = line_styles(motions)
    directions = max((motion.displacement.shape[2] for motion in motions.values()), default=2)
    for axis, pair in zip(panels, _LOOPS[directions], strict=True):
        for name, motion in motions.items():
            part = motion.last_period()
            if all(int(k) < motion.displacement.shape[2] for _, k in pair):
                curve = [
                    (1e3 * motion.displacement if kind == "u" else motion.force)[
                        part, point, int(k)
                    ]
                    for kind, k in pair
                ]
                axis.plot(*curve, label=name, **styles[name])
        axis.set(xlabel=_quantity(pair[0], directions), ylabel=_quantity(pair[1], directions))
    panels[-1].set_title("orbit")


def _quantity(name: str, directions: int) -> str:
    """The label of a displacement or force of `_LOOPS`."""
    kind, k = name
    way = "normal" if k == "0" else "tangential"
    number = f" {k}" if directions == 3 and k != "0" else ""
    return f"{way} displacement{number}, mm" if kind == "u" else f"{way} force{number}, N"


@styled
def plot_modes(labels: Sequence[str], positions: np.ndarray, shapes: np.ndarray) -> Figure:
    """Displacement along the axis of a slender body, axial part on the left, transverse on the
    right (fig. 10).

    Normal modes, static modes and derivatives have a row each; every shape is divided by its own
    largest component.

    Args:
        labels: one per shape, such as 1V, 2S, 1V1S.
        positions: along the axis (k,), m.
        shapes: components (n_labels, k, d), the axial one first.
    """
    shapes = np.asarray(shapes, dtype=float)
    largest = np.abs(shapes).max(axis=(1, 2), keepdims=True)
    shapes = shapes / np.where(largest > 0, largest, 1.0)
    kinds: dict[str, list[int]] = {}
    for i, label in enumerate(labels):
        parts = re.findall("[VS]", label)
        kind = (
            "derivatives"
            if len(parts) == 2
            else "static modes"
            if parts == ["S"]
            else "normal modes"
        )
        kinds.setdefault(kind, []).append(i)
    columns = shapes.shape[2]
    figure = new_figure(4.6 if columns == 2 else 3.6, 1.0)
    figure.set_size_inches(1.6 + (4.1 if columns == 2 else 3.3) * columns, 0.5 + 2.5 * len(kinds))
    axes = figure.subplots(len(kinds), columns, sharex=True, sharey=True, squeeze=False)
    names = ["axial", "transverse"] if columns == 2 else ["axial", "transverse 1", "transverse 2"]
    for row, (kind, members) in zip(axes, kinds.items(), strict=True):
        styles = line_styles(labels[i] for i in members)
        for i in members:
            for k, axis in enumerate(row):
                axis.plot(positions, shapes[i, :, k], label=labels[i], **styles[labels[i]])
        row[0].set_ylabel(f"{kind}\ndisplacement / largest")
        row[-1].legend(
            loc="center left", bbox_to_anchor=(1.0, 0.5), ncols=1 + (len(members) - 1) // 9
        )
    for axis, name in zip(axes[0], names, strict=True):
        axis.set_title(name)
    for axis in axes[-1]:
        axis.set_xlabel("position along the axis, m")
    return figure


@styled
def ledger_plot(motion: Motion) -> Figure:
    """The energy ledger of a motion: where the work of the loads went, and what does not add up."""
    figure = new_figure(8.6, 4.8)
    above, below = figure.subplots(2, 1, sharex=True, height_ratios=[3, 1])
    periodic = motion.period is not None
    time = motion.time / motion.period if motion.period is not None else motion.time
    stored = motion.kinetic + motion.elastic + motion.contact_energy
    above.plot(time, motion.work, color="#000000", label="work of the loads")
    above.plot(time, motion.damping_dissipation, color="#0072B2", label="lost to damping")
    above.plot(time, motion.friction_dissipation, color="#D55E00", label="lost to friction")
    above.plot(
        time,
        stored,
        color="#009E73",
        linewidth=1.0,
        label="stored: kinetic, elastic, contact springs",
    )
    above.set_ylabel("energy, J")
    above.margins(x=0)
    below.plot(time, motion.imbalance, color="#555B61")
    below.set(ylabel="imbalance, J", xlabel="time / period" if periodic else "time, s")
    below.margins(x=0)
    _legend(figure, above, columns=2)
    return figure


@styled
def panels(labels: Sequence[str], images: Sequence[np.ndarray]) -> Figure:
    """Pictures of deformed shapes, coloured by their displacement, in a grid with one colour bar.

    Args:
        labels: one per picture.
        images: of one size (height, width, 3).
    """
    from matplotlib.cm import ScalarMappable

    height, width = images[0].shape[:2]
    aspect = height / width
    columns = min(len(images), 2 if aspect < 0.25 else 3 if aspect < 1 else 5)
    rows = -(-len(images) // columns)
    wide = 9.6 / max(columns, 2)
    figure = new_figure(9.6, 0.7 + rows * (wide * aspect + 0.3))
    axes = figure.subplots(rows, columns, squeeze=False)
    for axis in axes.flat:
        axis.set_axis_off()
    for axis, label, image in zip(axes.flat, labels, images, strict=False):
        axis.imshow(image, interpolation="antialiased")
        axis.set_title(label, fontweight="bold")
    bar = figure.colorbar(
        ScalarMappable(cmap="viridis"),
        ax=axes,
        location="bottom",
        shrink=0.3,
        aspect=40,
        ticks=[0, 0.5, 1],
    )
    bar.set_label("displacement / largest")
    bar.outline.set_visible(False)
    return figure


@styled
def film(
    images: Sequence[np.ndarray], times: Sequence[float], scale: str, largest: float, marked: bool
) -> list[np.ndarray]:
    """Pictures of a motion with their time, a colour bar of the displacement and a legend of the
    contact states.

    Args:
        images: of one size (height, width, 3).
        times: of the pictures, s.
        scale: says how large displacements are drawn.
        largest: displacement, m, that the last colour stands for.
        marked: whether contact points are marked.

    Returns:
        Pictures of one size, (height, width, 3), of bytes.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize
    from matplotlib.lines import Line2D

    height, width = images[0].shape[:2]
    wide = 7.2 * min(1.0, max(0.5, width / height))
    figure = new_figure(wide, wide * height / width + 1.3)
    figure.set_dpi(100)
    canvas = FigureCanvasAgg(figure)
    axis = figure.subplots()
    axis.set_axis_off()
    shown = axis.imshow(images[0], interpolation="antialiased")
    bar = figure.colorbar(
        ScalarMappable(Normalize(0.0, 1e3 * largest or 1.0), "viridis"),
        ax=axis,
        location="bottom",
        shrink=0.5,
        aspect=40,
    )
    bar.set_label(f"displacement, mm ({scale})")
    bar.outline.set_visible(False)
    if marked:
        marks = [
            Line2D(
                [], [], linestyle="", marker="o", markeredgecolor="black", color=colour, label=name
            )
            for name, colour in STATES.values()
        ]
        figure.legend(handles=marks, loc="outside upper right", ncols=len(marks))
    found = []
    for image, time in zip(images, times, strict=True):
        shown.set_data(image)
        axis.set_title(f"t = {time:#.6g} s", loc="left", fontsize=11)
        canvas.draw()
        found.append(np.asarray(canvas.buffer_rgba())[..., :3].copy())
    return found


def _plot_states(axis: Axes, motions: Mapping[str, Motion], point: int) -> None:
    """A bar per model, coloured by the contact state over the last period."""
    from matplotlib.patches import Patch

    for row, motion in enumerate(motions.values()):
        time, part = _phase(motion, 1)
        state = motion.state[part, point]
        ends = np.concatenate([time[:1], (time[1:] + time[:-1]) / 2, time[-1:]])
        starts = np.flatnonzero(np.diff(state, prepend=state[0] + 1))
        for start, stop in itertools.pairwise([*starts, len(state)]):
            axis.barh(
                row, ends[stop] - ends[start], 0.72, ends[start], color=STATES[int(state[start])][1]
            )
    axis.set_yticks(range(len(motions)), list(motions))
    axis.invert_yaxis()
    axis.grid(visible=False)
    axis.spines[:].set_visible(False)
    axis.tick_params(left=False)
    axis.margins(x=0)
    periodic = all(motion.period is not None for motion in motions.values())
    axis.set_xlabel("time / period" if periodic else "time, s")
    patches = [Patch(color=colour, label=name) for name, colour in STATES.values()]
    axis.legend(
        handles=patches, loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=3, borderaxespad=0.2
    )
    axis.set_title("contact state")


def _touches(motion: Motion) -> bool:
    """Whether a motion has contact points."""
    return motion.state.shape[1] > 0


def _phase(motion: Motion, periods: int) -> tuple[np.ndarray, np.ndarray]:
    """Time in periods from the start of the last ones, and the instants (a mask); in s, and all,
    without a period.
    """
    if motion.period is None:
        return motion.time, np.ones(len(motion.time), dtype=bool)
    cycles = motion.time / motion.period
    start = max(round(float(cycles[-1])) - periods, 0)
    part = cycles >= start - 1e-9
    return cycles[part] - start, part


def _direction(k: int, directions: int, touching: bool) -> str:
    """Name of a component of a displacement."""
    if not touching:
        return "xyz"[k]
    return "normal" if k == 0 else "tangential" if directions == 2 else f"tangential {k}"


def _legend(figure: Figure, axis: Axes, columns: int | None = None) -> None:
    """One legend above the whole figure."""
    handles, labels = axis.get_legend_handles_labels()
    if handles:
        figure.legend(handles, labels, loc="outside upper right", ncols=columns or len(labels))


# tables, report


def text_table(rows: Sequence[Sequence[Any]]) -> str:
    """A table for the terminal: the first row is the head, numbers stand on the right."""
    cells = [[_text(value) for value in row] for row in rows]
    right = _numeric(rows)
    widths = [max(map(len, column)) for column in zip(*cells, strict=True)]
    lines = [
        "  ".join(
            cell.rjust(width) if flag else cell.ljust(width)
            for cell, width, flag in zip(row, widths, right, strict=True)
        ).rstrip()
        for row in cells
    ]
    return "\n".join([lines[0], "  ".join("─" * width for width in widths), *lines[1:]])


def html_report(title: str, sections: Iterable[tuple[str, Iterable[Any]]]) -> str:
    """A report in one file, pictures included.

    Args:
        title: of the report.
        sections: pairs of a heading and its items. An item is a paragraph (text), a table (a list
            of rows, the first of them the head), a matplotlib figure, or the path of a PNG or
            GIF picture.

    Returns:
        The HTML text.
    """
    body = [f"<h1>{html.escape(title)}</h1>"]
    for heading, items in sections:
        body.append(f"<section><h2>{html.escape(heading)}</h2>")
        body.extend(_html_item(item, heading) for item in items)
        body.append("</section>")
    return _PAGE.format(title=html.escape(title), body="\n".join(body))


def write_summary(path: str | Path, summary: Mapping[str, Any]) -> None:
    """Write a summary as JSON, its keys in the order given; numpy numbers and arrays and paths are
    allowed.

    Raises:
        AccuracyError: a number is NaN or infinite; the sentence names its key. Nothing is written.
        OSError: the file cannot be written.
    """
    text = json.dumps(_plain(summary, ""), indent=2, ensure_ascii=False, allow_nan=False)
    with atomic_write(path) as temporary:
        temporary.write_text(text + "\n", encoding="utf-8")


def write_rows(path: Path, rows: Sequence[Mapping[str, Any]]) -> None:
    """Write rows of the same keys as CSV, the keys at the head.

    Raises:
        OSError: the file cannot be written.
    """
    text = io.StringIO()
    writer = csv.DictWriter(text, list(rows[0]))
    writer.writeheader()
    writer.writerows(rows)
    with atomic_write(path) as temporary:
        temporary.write_text(text.getvalue(), encoding="utf-8")


def _plain(value: Any, where: str) -> Any:
    """The same data in JSON's own types."""
    if isinstance(value, Mapping):
        return {
            str(key): _plain(item, f"{where}.{key}" if where else str(key))
            for key, item in value.items()
        }
    if isinstance(value, np.ndarray | np.generic):
        value = value.tolist()
    if isinstance(value, list | tuple):
        return [_plain(item, f"{where}[{i}]") for i, item in enumerate(value)]
    if isinstance(value, float) and not math.isfinite(value):
        raise AccuracyError(f"the summary was not written: {where} is {value}, not a finite number")
    return str(value) if isinstance(value, Path) else value


def _text(value: Any) -> str:
    """A cell of a table as text: four digits, a dash for None."""
    if value is None:
        return "–"
    if isinstance(value, bool | np.bool_):
        return "yes" if value else "no"
    return f"{value:.4g}" if isinstance(value, float | np.floating) else str(value)


def _numeric(rows: Sequence[Sequence[Any]]) -> list[bool]:
    """Which columns hold numbers (below the head)."""
    numbers = (int, float, np.number, type(None))
    return [
        all(isinstance(value, numbers) and not isinstance(value, bool) for value in column[1:])
        and len(column) > 1
        for column in zip(*rows, strict=True)
    ]


def _html_item(item: Any, heading: str) -> str:
    """One item of a section."""
    if isinstance(item, str):
        return f"<p>{html.escape(item)}</p>"
    if isinstance(item, Path):
        return _html_picture(item.read_bytes(), heading, item.suffix.removeprefix("."))
    if hasattr(item, "savefig"):
        png = io.BytesIO()
        item.savefig(png, format="png")
        return _html_picture(png.getvalue(), heading, "png")
    right = _numeric(item)
    lines = []
    for i, row in enumerate(item):
        tag = "td" if i else "th"
        lines.append(
            "<tr>"
            + "".join(
                f"<{tag}{' class=n' if flag else ''}>{html.escape(_text(value))}</{tag}>"
                for value, flag in zip(row, right, strict=True)
            )
            + "</tr>"
        )
    head, *rest = lines
    return (
        f"<div class=wide><table><thead>{head}</thead><tbody>{''.join(rest)}</tbody></table></div>"
    )


def _html_picture(content: bytes, heading: str, kind: str) -> str:
    """A picture inside the page, PNG or GIF."""
    return f'<img alt="{html.escape(heading)}" src="data:image/{kind};base64,{base64.b64encode(content).decode()}">'


_PAGE = """<!doctype html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>{title}</title>
<style>
:root {{ color-scheme: light dark; --ink: #1d2125; --paper: #fdfdfc; --line: #d9dde1; --soft: #5b636b; }}
@media (prefers-color-scheme: dark) {{
  :root {{ --ink: #e4e7ea; --paper: #17191c; --line: #3a3f45; --soft: #a2aab2; }}
}}
body {{ font: 16px/1.55 system-ui, sans-serif; color: var(--ink); background: var(--paper); max-width: 62rem;
  margin: 2.5rem auto; padding: 0 1.25rem; }}
h1 {{ font-size: 1.7rem; line-height: 1.25; margin: 0 0 1.5rem; }}
h2 {{ font-size: 1.15rem; margin: 2.4rem 0 .7rem; padding-bottom: .3rem; border-bottom: 1px solid var(--line); }}
p {{ max-width: 46rem; margin: .6rem 0; }}
img {{ display: block; max-width: 100%; height: auto; margin: 1rem 0; padding: .6rem; box-sizing: border-box;
  background: #fff; border: 1px solid var(--line); border-radius: 6px; }}
.wide {{ overflow-x: auto; margin: 1rem 0; }}
table {{ border-collapse: collapse; font-size: .92rem; font-variant-numeric: tabular-nums; }}
th, td {{ text-align: left; padding: .3rem .9rem .3rem 0; border-bottom: 1px solid var(--line); vertical-align: top; }}
th {{ color: var(--soft); font-weight: 600; }}
.n {{ text-align: right; padding-left: .9rem; white-space: nowrap; }}
</style>
</head>
<body>
{body}
</body>
</html>
"""

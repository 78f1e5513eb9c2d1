"""The picture of a sweep: curves over one key, or a map over two keys."""

from __future__ import annotations

import itertools
from typing import TYPE_CHECKING, Any

import numpy as np

from fenicsrom.arrays import Array
from fenicsrom.assess.studies.sweep_runs import DONE, DOUBTFUL, Sweep
from fenicsrom.post.base.style import line_styles, new_panels, styled
from fenicsrom.post.studies.sweep_columns import COLUMNS, key_labels

if TYPE_CHECKING:
    from matplotlib.figure import Figure

MOST_CURVES = 8  # more curves are drawn as a map
LEGEND_COLUMNS = 4


@styled
def figure(found: Sweep) -> Figure:
    """The amplitudes and the largest normal force of all runs.

    The first axis is the abscissa. There is a curve for each combination of the others, or a map
    where there are two axes and more than `MOST_CURVES` curves. Runs that have not settled or did
    not pass a check are drawn hollow; runs without a motion are missing.
    """
    usable = found.with_outcome(DONE, DOUBTFUL)
    drawn = [item for item in COLUMNS if item.label and any(item.key in row for row in usable)]
    made, panels = new_panels(7.4, 3.1 * max(len(drawn), 1), max(len(drawn), 1), 1, sharex=True)
    shape = tuple(len(axis.values) for axis in found.axes)
    as_map = len(shape) == 2 and shape[1] > MOST_CURVES
    for panel, (key, factor, _, label) in zip(panels, drawn, strict=False):
        numbers = np.array([_number(row.get(key)) for row in found.rows]).reshape(shape)
        if as_map:
            _map(made, panel, found, factor * numbers, label)
        else:
            _curves(panel, found, factor * numbers)
            panel.set_ylabel(label)
    panels[-1].set_xlabel(" and ".join(key_labels(found, found.axes[0].keys)))
    if not as_map and len(shape) > 1:
        others = tuple(key for axis in found.axes[1:] for key in axis.keys)
        handles, labels = panels[0].get_legend_handles_labels()
        title = ", ".join(map(_short, key_labels(found, others, " in ")))
        columns = min(len(handles), LEGEND_COLUMNS)
        made.legend(handles, labels, title=title, loc="outside upper center", ncols=columns)
    return made


def _number(value: Any) -> float:
    return np.nan if value is None else float(value)


def _places(found: Sweep, axis: int) -> tuple[Array, list[str] | None]:
    """The places of the values of an axis, and their names where they are not numbers."""
    values = [position[0] for position in found.axes[axis].values]
    if all(isinstance(value, int | float) and not isinstance(value, bool) for value in values):
        return np.array(values, dtype=np.float64), None
    return np.arange(len(values), dtype=np.float64), [str(value) for value in values]


def _curves(panel: Any, found: Sweep, numbers: Array) -> None:
    """Draw a curve over the first axis for each combination of values of the other axes."""
    x, names = _places(found, 0)
    order = np.argsort(x)
    solid = np.array([row.get("outcome") == DONE and bool(row["settled"]) for row in found.rows])
    solid = solid.reshape(numbers.shape)
    others = list(itertools.product(*(range(count) for count in numbers.shape[1:])))[:MOST_CURVES]
    columns = numbers.reshape(x.size, -1).T, solid.reshape(x.size, -1).T
    labels = [
        ", ".join(
            f"{value:g}" if isinstance(value, float) else str(value)
            for axis, k in zip(found.axes[1:], other, strict=True)
            for value in axis.values[k]
        )
        for other in others
    ]
    styles = line_styles(labels)
    for label, y, filled in zip(labels, *columns, strict=False):
        style = styles[label]
        panel.plot(x[order], y[order], label=label, **style)
        for full, face in ((True, style["color"]), (False, "white")):
            part = filled == full
            panel.plot(
                x[part], y[part], "o", markersize=4, color=style["color"], markerfacecolor=face
            )
    if names is not None:
        panel.set_xticks(x, names)
    elif x.size > 2 and x.min() > 0.0 and np.ptp(np.diff(np.log(x))) < 1e-6:
        panel.set_xscale("log")


def _map(made: Figure, panel: Any, found: Sweep, numbers: Array, label: str) -> None:
    """Draw the values over two axes as colours."""
    (x, x_names), (y, y_names) = _places(found, 0), _places(found, 1)
    rows, columns = np.argsort(y), np.argsort(x)
    mesh = panel.pcolormesh(
        x[columns], y[rows], numbers.T[np.ix_(rows, columns)], shading="nearest", cmap="viridis"
    )
    panel.grid(False)
    panel.set_ylabel(" and ".join(key_labels(found, found.axes[1].keys)))
    made.colorbar(mesh, ax=panel, label=label)
    if x_names is not None:
        panel.set_xticks(x, x_names)
    if y_names is not None:
        panel.set_yticks(y, y_names)


def _short(key: str) -> str:
    """The last part of the path of a key."""
    return key.rpartition(".")[2]

"""The figure of response curves: amplitude, phase, peak normal force and dissipated energy."""

from collections.abc import Callable, Sequence
from itertools import pairwise
from typing import Any

import numpy as np

from fenicsrom.arrays import Array
from fenicsrom.assess.curves.results import Response, ResponseCurve
from fenicsrom.online.curves.curve import CurvePoint
from fenicsrom.online.model.loads import moves_supports
from fenicsrom.online.motion.measures import STATE_NAMES
from fenicsrom.post.base.chart import Detail, detailed, noted
from fenicsrom.post.base.style import COLOURS, Axes, Figure, new_panels, styled
from fenicsrom.post.base.tables import Quantity, direction_names, plain_names
from fenicsrom.scene.reading.overrides import unit_of

MARKERS = {
    "fold": "o",
    "branch point": "p",
    "period doubling": "s",
    "torus": "D",
    "non-smooth": "X",
    "first touch": "v",
    "last touch": "^",
    "first lift-off": "<",
    "last lift-off": ">",
    "first slip": "P",
    "last slip": "h",
}
FULL_MARKER = "x"
LONG_NAME = 22  # characters of a name of which four in a row are too wide for the picture
INK = "#555B61"
STYLES: dict[bool | None, tuple[str, Any]] = {
    True: ("stable", "-"),
    False: ("unstable", (0, (4, 2))),
    None: ("stability not known", (0, (1, 1.5))),
}
"""What `stretches` tells of a stretch -> its name and its line style."""


def directions(found: Response) -> list[str]:
    """The names of the directions in the files of numbers."""
    names = plain_names(found.dimension, bool(found.contacts))
    return [name.replace(" ", "_") for name in names]


def largest_direction(found: Response) -> int:
    """The direction with the largest amplitude on any curve."""
    return largest_component(found)[1]


def direction_name(found: Response) -> str:
    """The name of the direction with the largest amplitude, as `run` gives it."""
    return direction_names(found.scene, found.contact_points)[largest_direction(found)]


def largest_component(found: Response) -> tuple[int, int]:
    """The contact point and the direction with the largest amplitude on any curve."""
    points = [point for curve in found.curves for point in curve.points]
    sizes = np.max([point.amplitude for point in points], axis=0)
    place, direction = np.unravel_index(int(np.argmax(sizes)), sizes.shape)
    return int(place), int(direction)


def largest_point(found: Response, curve: ResponseCurve) -> CurvePoint:
    """The point of the largest amplitude of a curve."""
    return max(curve.points, key=height_of(found))


def height_of(found: Response) -> Callable[[Any], float]:
    """What gives the amplitude of a point of a curve in the direction of the largest one, mm."""
    direction = largest_direction(found)
    return lambda point: 1e3 * float(point.amplitude[:, direction].max())


OPPOSITE = 1.0
"""A phase that starts less than this from -180 degrees starts at +180 degrees: light damping."""


def parameter_label(found: Response) -> str:
    """The parameter with its unit."""
    return key_label(found, found.table.parameter)


def key_label(found: Response, key: str) -> str:
    """A key of the scene with its unit, for people."""
    unit = unit_of(found.scene, key)
    return f"{key}, {unit}" if unit else key


def phases(points: Sequence[CurvePoint], place: int, direction: int) -> Array:
    """Phase of the first harmonic of the displacement against the load along a piece, degrees.

    The phase is continuous along the piece, and starts above -180 and at most at 180 degrees, up
    to `OPPOSITE`.
    """
    angles = [np.angle(point.harmonics[0, place, direction]) for point in points]
    unwrapped = np.degrees(np.unwrap(angles))
    highest = 180.0 + OPPOSITE
    return np.asarray(unwrapped - 360.0 * np.ceil((unwrapped[0] - highest) / 360.0))


CLICKED = [("time, s", "displacement, mm"), ("tangential displacement, mm", "friction force, N")]
"""Axes of what a click on a point shows: its motion, and its loop if there is contact."""


@styled
def figure(found: Response, details: Sequence[Detail] = ()) -> Figure:
    """Draw the curves: stable parts solid, unstable parts dashed, special points marked.

    The chart of the figure shows the details by a click.
    """
    place, direction = largest_component(found)
    shaken, height = moves_supports(found.scene), height_of(found)
    relative = "\nrelative to the supports" if shaken else ""
    driven = "acceleration of\nthe supports" if shaken else "load"
    phase = f"phase to the\n{driven}, degrees"

    def each(value: Callable[[CurvePoint], float]) -> Callable[[list[CurvePoint]], Array]:
        return lambda points: np.array([value(point) for point in points])

    panels = {f"{direction_name(found)} amplitude, mm{relative}": each(height)}
    if found.contacts:
        probe = each(lambda p: 1e3 * float(p.probe_amplitude.max(initial=0.0)))
        panels[f"probe amplitude,\nmm{relative}"] = probe
    panels[phase] = lambda points: phases(points, place, direction)
    if found.contacts:
        panels["peak normal\nforce, N"] = each(lambda p: float(p.peak_force.max()))
    work = "friction and\ndamping, J per period" if found.contacts else "damping,\nJ per period"
    panels[work] = each(lambda p: p.friction_dissipation + p.damping_dissipation)
    rows: dict[str, Any] = {"height_ratios": [2.4] + [1.0] * (len(panels) - 1), "sharex": True}
    drawn, axes = new_panels(8.4, 2.0 * sum(rows["height_ratios"]), len(panels), **rows)
    for curve in found.curves:
        places = [point.parameter for point in curve.full], [*map(height, curve.full)]
        axes[0].plot(*places, FULL_MARKER, color=colour_of(found, curve), zorder=5)
    for axis, (label, values) in zip(axes, panels.items(), strict=True):
        draw_curves(axis, found, found.curves, values)
        axis.set_ylabel(label)
        if label == phase:
            axis.yaxis.get_major_locator().set_params(steps=[1, 1.5, 3, 4.5, 9, 10], nbins=5)
        else:
            top = axis.dataLim.y1 or 1.0  # lines and marks at zero and at the top stay visible
            axis.set_ylim(-0.03 * top, 1.05 * top)
    axes[-1].set_xlabel(parameter_label(found))
    drawn.align_ylabels(axes)
    if handles := legend_handles(found):
        columns = 4 if max(len(handle.get_label()) for handle in handles) < LONG_NAME else 3
        drawn.legend(handles=handles, loc="outside upper center", ncols=min(len(handles), columns))
    detailed(drawn, CLICKED[: 2 if found.contacts else 1], details)
    return drawn


def draw_curves(
    axis: Axes,
    found: Response,
    curves: Sequence[ResponseCurve],
    values: Callable[[list[CurvePoint]], Array],
    colours: Sequence[str] = (),
) -> None:
    """Draw quantities of some curves; special points are marked if there is one quantity.

    Args:
        axis: the axes.
        found: all curves.
        curves: the curves to draw.
        values: gives the quantities (q, k) or (k,) at the k points of a piece in their order.
        colours: colours of the quantities; that of each curve if not given.
    """
    for curve in curves:
        shades = colours or (colour_of(found, curve),)
        for points in (piece.in_order() for piece in curve.pieces):
            if not points:
                continue
            parameters = np.array([point.parameter for point in points])
            heights: Array = np.atleast_2d(values(points))
            for stable, part in stretches(points):
                notes = [", ".join(state_names(points[j])) for j in part] if found.contacts else []
                for k, shade in enumerate(shades):
                    (line,) = axis.plot(
                        parameters[part],
                        heights[k, part],
                        linestyle=STYLES[stable][1],
                        color=shade,
                        zorder=3 if stable else 2,
                    )
                    noted(line, notes)
            if len(points) == 1:  # of a curve that was interrupted
                axis.plot(np.repeat(parameters, len(heights)), heights[:, 0], ".", color=shades[0])
            if not colours:
                _mark(axis, points, heights[0], shades[0])


FORCE = Quantity(
    "peak_normal_force_N", lambda p: float(p.peak_force.max(initial=0.0)), "peak normal force, N"
)
CONTACT = (
    FORCE,
    Quantity("friction_dissipation_per_period_J", "friction_dissipation"),
    Quantity("contact_states", lambda point: " ".join(state_names(point))),
)
"""What is told of the contact of a point of a curve, or of the motion of a nonlinear mode."""
PEAK = (
    Quantity("frequency_Hz", "frequency", "frequency, Hz", 7),
    Quantity("probe_amplitude_m", "amplitude", "amplitude of the probe, mm"),
    Quantity("stability", "point.verdict", "stability"),
)
"""What is told of a peak of the forced response."""


def state_names(point: Any) -> list[str]:
    """The contact states that occur in the period at any contact point."""
    bits = int(np.bitwise_or.reduce(point.states, initial=0))
    return [name for bit, name in enumerate(STATE_NAMES.values()) if bits >> bit & 1]


def _mark(axis: Axes, points: Sequence[CurvePoint], heights: Array, colour: str) -> None:
    """Mark the special points among the points of a piece."""
    for point, height in zip(points, heights, strict=True):
        if point.kind:
            look: dict[str, Any] = {"color": colour, "markerfacecolor": "white", "markersize": 5}
            axis.plot(point.parameter, height, MARKERS[point.kind], zorder=4, **look)


def colour_of(found: Response, curve: ResponseCurve) -> str:
    """The colour of a curve."""
    return COLOURS[found.curves.index(curve) % len(COLOURS)]


def curve_name(found: Response, curve: ResponseCurve) -> str:
    """The second number of a curve with its value and unit; "" without families."""
    families = found.table.families
    if families is None:
        return ""
    unit = unit_of(found.scene, families.key)
    return f"{families.key.rsplit('.', 1)[-1]} = {curve.value:g}{f' {unit}' if unit else ''}"


def stability_of(point: Any) -> bool | None:
    """Whether a point of a curve is stable; None if that is not known."""
    return None if point.denied else bool(point.stable)


def stretches(
    points: Sequence[Any], is_stable: Callable[[Any], bool | None] = stability_of
) -> list[tuple[bool | None, list[int]]]:
    """Split a curve into stable, unstable and unknown stretches of point numbers, which share ends.

    A stretch between two ordinary points is stable if both are, and unknown if one is; a special
    point takes part in the stretches on both of its sides.
    """
    found: list[tuple[bool | None, list[int]]] = []
    for k, pair in enumerate(pairwise(points)):
        known = {is_stable(point) for point in pair if not point.kind}
        stable = None if None in known else all(known)
        if found and found[-1][0] == stable:
            found[-1][1].append(k + 1)
        else:
            found.append((stable, [k, k + 1]))
    return found


def shown_curves(found: Response) -> list[ResponseCurve]:
    """At most four curves, evenly chosen, with the first and the last."""
    count = len(found.curves)
    chosen = np.unique(np.linspace(0, count - 1, min(4, count)).round().astype(int))
    return [found.curves[k] for k in chosen]


def style_handles(found: Response) -> list[Any]:
    """The entries of a legend: the line styles that occur, if not all is stable."""
    from matplotlib.lines import Line2D

    parts = {
        stable
        for curve in found.curves
        for piece in curve.pieces
        for stable, _ in stretches(piece.in_order())
    }
    if parts <= {True}:
        return []
    return [
        Line2D([], [], color=INK, linestyle=style, label=word)
        for stable, (word, style) in STYLES.items()
        if stable in parts
    ]


def legend_handles(found: Response) -> list[Any]:
    """The entries of the legend: a line for each curve, the styles and the marks that occur."""
    from matplotlib.lines import Line2D

    handles: list[Any] = []
    if found.table.families is not None:
        handles += [
            Line2D([], [], color=colour_of(found, curve), label=curve_name(found, curve))
            for curve in found.curves
        ]
    handles += style_handles(found)
    look: dict[str, Any] = {"linestyle": "", "color": INK, "markerfacecolor": "white"}
    present = {point.kind for curve in found.curves for point in curve.special}
    handles += [
        Line2D([], [], marker=marker, label=kind, markersize=5, **look)
        for kind, marker in MARKERS.items()
        if kind in present
    ]
    if any(curve.full for curve in found.curves):
        handles.append(Line2D([], [], marker=FULL_MARKER, label="full model", **look))
    return handles

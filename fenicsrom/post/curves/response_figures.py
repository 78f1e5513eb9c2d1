"""The figure of response curves: amplitude, phase, peak normal force and dissipated energy."""

from collections.abc import Callable, Mapping, Sequence
from itertools import pairwise
from typing import Any

import numpy as np

from fenicsrom.arrays import Array
from fenicsrom.assess.curves.results import Response, ResponseCurve
from fenicsrom.online.curves.curve import CurvePoint
from fenicsrom.online.model.loads import moves_supports
from fenicsrom.online.motion.measures import STATE_NAMES
from fenicsrom.post.base.plot import Detail, Item, Line, Panel, Plot
from fenicsrom.post.base.style import COLOURS, EDGE
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
STYLES: dict[bool | None, tuple[str, str]] = {
    True: ("stable", "-"),
    False: ("unstable", "--"),
    None: ("stability not known", ":"),
}
"""What `stretches` tells of a stretch -> its name and its line style."""


def directions(found: Response) -> list[str]:
    """The names of the directions in the files of numbers."""
    names = plain_names(found.scene.geometry.dimension, bool(found.contacts))
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


def figure(found: Response, details: Sequence[Detail] = ()) -> Plot:
    """The curves: stable parts solid, unstable parts dashed, special points marked.

    The chart of the plot shows the details by a click.
    """
    place, direction = largest_component(found)
    shaken, height = moves_supports(found.scene), height_of(found)
    relative = "\nrelative to the supports" if shaken else ""
    driven = "acceleration of\nthe supports" if shaken else "load"
    phase = f"phase to the\n{driven}, degrees"

    def each(value: Callable[[CurvePoint], float]) -> Callable[[list[CurvePoint]], Array]:
        return lambda points: np.array([value(point) for point in points])

    shown = {f"{direction_name(found)} amplitude, mm{relative}": each(height)}
    if found.contacts:
        probe = each(lambda p: 1e3 * float(p.probe_amplitude.max(initial=0.0)))
        shown[f"probe amplitude,\nmm{relative}"] = probe
    shown[phase] = lambda points: phases(points, place, direction)
    if found.contacts:
        shown["peak normal\nforce, N"] = each(lambda p: float(p.peak_force.max()))
    work = "friction and\ndamping, J per period" if found.contacts else "damping,\nJ per period"
    shown[work] = each(lambda p: p.friction_dissipation + p.damping_dissipation)
    panels: list[Panel] = []
    for label, values in shown.items():
        items = curve_items(found, found.curves, values)
        if not panels:
            items += [_full(found, curve, height) for curve in found.curves if curve.full]
        look: dict[str, Any] = {"ylabel": label}
        if label == phase:
            look["yticks"] = _degrees(Panel(items).values("y"))
        else:  # lines and marks at zero and at the top stay visible
            top = float(Panel(items).values("y").max(initial=0.0)) or 1.0
            look["ylim"] = (-0.03 * top, 1.05 * top)
        panels.append(Panel(items, **look))
    heights = [2.4] + [1.0] * (len(panels) - 1)
    labels = CLICKED[: 2 if found.contacts else 1]
    look = {"share": "x", "xlabel": parameter_label(found), "legend": legend_samples(found)}
    look |= {"details": details, "detail_labels": labels}
    return Plot(panels, 8.4, 2.0 * sum(heights) + 0.4, heights=heights, **look)


def _full(found: Response, curve: ResponseCurve, height: Callable[[Any], float]) -> Line:
    """The motions of the full model of a curve."""
    x, y = [point.parameter for point in curve.full], [*map(height, curve.full)]
    names: dict[str, Any] = {"label": "full model", "also": (curve_name(found, curve),)}
    color = colour_of(found, curve)
    return Line(x, y, "", color, marker=FULL_MARKER, zorder=5.0, **names)


def _degrees(values: Array) -> dict[float, str]:
    """Marks of angles, degrees; none for a short range, which gets those of other numbers."""
    if np.ptp(values) < 30.0:
        return {}
    step = next((step for step in (15.0, 30.0, 45.0, 90.0) if np.ptp(values) <= 5.0 * step), 180.0)
    low, high = np.floor(values.min() / step), np.ceil(values.max() / step)
    return {k * step: f"{k * step:g}".replace("-", "−") for k in np.arange(low, high + 1.0)}


def curve_items(
    found: Response,
    curves: Sequence[ResponseCurve],
    values: Callable[[list[CurvePoint]], Array],
    names: Mapping[str, str] | None = None,
) -> list[Item]:
    """The lines of quantities of some curves, with their special points if there is one quantity.

    Args:
        found: all curves.
        curves: the curves to draw.
        values: gives the quantities (q, k) or (k,) at the k points of a piece in their order.
        names: names of several quantities -> their colours.
    """
    items: list[Item] = []
    for curve in curves:
        looks = names or {curve_name(found, curve): colour_of(found, curve)}
        for points in (piece.in_order() for piece in curve.pieces):
            if not points:
                continue
            parameters = np.array([point.parameter for point in points])
            heights: list[Array] = list(np.atleast_2d(values(points)))
            for stable, part in stretches(points):
                word, style = STYLES[stable]
                notes = [", ".join(state_names(points[j])) for j in part] if found.contacts else []
                for height, (name, color) in zip(heights, looks.items(), strict=True):
                    look: dict[str, Any] = {"zorder": 3.0 if stable else 2.0, "notes": notes}
                    x, y = parameters[part], height[part]
                    items.append(Line(x, y, style, color, **look, label=name, also=(word,)))
            name, color = next(iter(looks.items()))
            if len(points) == 1:  # of a curve that was interrupted
                x, y = np.repeat(parameters, len(heights)), np.asarray(heights)[:, 0]
                items.append(Line(x, y, "", color, marker=".", label=name))
            marks: Any = [] if names else zip(points, heights[0], strict=True)
            for point, size in ((point, size) for point, size in marks if point.kind):
                look = {"marker": MARKERS[point.kind], "hollow": True, "zorder": 4.0}
                place = [point.parameter], [size]
                items.append(Line(*place, "", color, **look, label=point.kind, also=(name,)))
    return items


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
    return bool(point.stable) if point.known else None


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


def style_samples(found: Response) -> list[Item]:
    """The samples in a legend of the line styles that occur, if not all is stable."""
    parts = {
        stable
        for curve in found.curves
        for piece in curve.pieces
        for stable, _ in stretches(piece.in_order())
    }
    if parts <= {True}:
        return []
    return [
        Line(linestyle=style, color=EDGE, label=word)
        for stable, (word, style) in STYLES.items()
        if stable in parts
    ]


def legend_samples(found: Response) -> list[Item]:
    """The samples of the legend: a line for each curve, the styles and the marks that occur."""
    samples: list[Item] = []
    if found.table.families is not None:
        samples += [
            Line(color=colour_of(found, curve), label=curve_name(found, curve))
            for curve in found.curves
        ]
    samples += style_samples(found)
    present = {point.kind for curve in found.curves for point in curve.special}
    present |= {"full model"} if any(curve.full for curve in found.curves) else set()
    look: dict[str, Any] = {"linestyle": "", "color": EDGE, "hollow": True}
    return samples + [
        Line(marker=marker, label=kind, **look)
        for kind, marker in {**MARKERS, "full model": FULL_MARKER}.items()
        if kind in present
    ]

"""The report of an interaction map: picture, curves, tables, wear and files."""

from dataclasses import fields
from functools import partial
from operator import itemgetter, methodcaller
from pathlib import Path
from typing import Any

import numpy as np

from fenicsrom.arrays import Array
from fenicsrom.assess.studies.interaction import LARGE, InteractionMap
from fenicsrom.assess.studies.map_line import OTHER, PERIOD, TORUS, UNSETTLED, WEARING
from fenicsrom.assess.studies.map_line import Line as MapLine
from fenicsrom.files import atomic_write
from fenicsrom.notes import AMPLITUDES, PEAK_FORCE, WEAR, Note, NoteKind
from fenicsrom.online.motion.measures import Wear, lobes_of, worn_profile
from fenicsrom.post.base.page import Report, Section
from fenicsrom.post.base.picture import Picture
from fenicsrom.post.base.plot import Bars, Item, Line, Map, Panel, Plot
from fenicsrom.post.base.style import COLOURS, missing_module
from fenicsrom.post.base.tables import Quantity, components, rows_of, table_of
from fenicsrom.words import counted

SPEED = Quantity("speed_rpm", head="speed, rpm", digits=6)
AMPLITUDE = Quantity("amplitude_m", "amplitude", "amplitude, mm", 4)
FORCE = Quantity("peak_normal_force_N", "peak_force", "peak normal force, N", 4)
CONTACT = Quantity("contact_fraction", "contact", "contact, % of time", 3)
CLEARANCE = Quantity("clearance_consumed", "clearance", "clearance consumed, %", 3)
MOTION = Quantity("", "motion", "motion")
ERRORS = [
    Quantity(f"{cause}_error", methodcaller("error", cause), f"{cause} error, %", 2)
    for cause in ("basis", "step", "mesh")
]
DEPTH = Quantity("worn_depth_m", lambda line: line.worn.max(), "worn depth, µm", 4)
DEPTH_ERROR = Quantity(
    "worn_depth_error", lambda line: line.worn_errors.max(), "worn depth error, %", 2
)
ONSETS = [
    Quantity(key, itemgetter(k), key.replace("_rpm", ", rpm").replace("_", " "), 6)
    for k, key in enumerate(("mode", "engine_order", "free_rpm", "closed_rpm"))
]


def quantities(found: InteractionMap) -> list[Quantity]:
    """What is told of each line."""

    def order(line: MapLine) -> float:
        return float(found.orders[np.argmax(line.amplitudes)])

    modes = range(1, 1 + (found.lines[0].free_hz.size if found.lines else 0))
    return [
        *(SPEED, AMPLITUDE, Quantity("engine_order", order, "engine order"), FORCE, CONTACT),
        *(CLEARANCE, Quantity("verdict"), MOTION),
        Quantity("period_revolutions", lambda line: line.period or None),
        *(*ERRORS, Quantity("peak_normal_force_error", "force_error")),
        Quantity("other_amplitude_m", "other", "amplitude from another start, mm", 4),
        *(_wear(found) if found.rings else ()),
        *components("mode_{}_free_Hz", "free_hz", modes),
        *components("mode_{}_closed_Hz", "closed_hz", modes),
    ]


def _wear(found: InteractionMap) -> list[Quantity]:
    """The wear of a line."""

    def worn(line: MapLine) -> list[Wear]:
        return [Wear(ring, ring.depth(line.worn), 0.0) for ring in found.rings]

    def lobes(line: MapLine) -> int | None:
        return lobes_of(worn_profile(found.rings, line.worn)[1]) or None

    return [
        *(DEPTH, DEPTH_ERROR, Quantity("worn_lobes", lobes, "lobes")),
        Quantity("worn_area_m_rad", lambda line: max(ring.area for ring in worn(line))),
        Quantity("worn_volume_m3", lambda line: sum(ring.volume for ring in worn(line))),
    ]


def wear_sentence(found: InteractionMap) -> str:
    """State the largest worn depth."""
    line = max(found.lines, key=lambda line: float(line.worn.max()))
    if not line.worn.any():
        return "Abradable layer: not worn at any speed."
    first = "each speed" if found.scene.map.start == "rest" else "the first speed"
    return (
        f"Abradable layer: worn by at most {DEPTH.text(line)} at {SPEED.text(line)}, with an "
        f"estimated error of {DEPTH_ERROR.text(line)} by the step; {first} begins with a new layer."
    )


def profiles(found: InteractionMap, name: str) -> tuple[Array, Array]:
    """Angles (c,) in rad, and the largest of "worn" or "worn_errors" of all rings (s, c) there."""
    pairs = [worn_profile(found.rings, getattr(line, name)) for line in found.lines]
    return pairs[0][0], np.array([depth for _, depth in pairs])


def profile_rows(found: InteractionMap) -> list[dict[str, Any]]:
    """The rows of `map_wear.csv`: the worn depth at each angle, with a column for each speed."""
    angle, depth = profiles(found, "worn")
    names = ["angle_deg", *(f"{line.speed_rpm:g}_rpm_m" for line in found.lines)]
    table = np.column_stack([np.degrees(angle), depth.T])
    return [dict(zip(names, row, strict=True)) for row in table]


def wear_figure(found: InteractionMap) -> Plot:
    """Worn depth over speed and angle, the largest depth, and the number of lobes."""
    speeds, (angle, depth) = found.speeds_rpm, profiles(found, "worn")
    errors = found.column("worn_errors").max(axis=1)
    edges = _edges(speeds)
    sides = np.degrees(np.append(angle, 2.0 * np.pi) - 0.5 * angle[1])
    wrong = profiles(found, "worn_errors")[1] > LARGE
    shade: list[Item] = []
    if wrong.any():
        name = f"estimated error above {100 * LARGE:g} % of the largest depth"
        shade.append(Bars(edges[:1], edges[-1:], sides[:1], sides[-1:], "#D9DDE1", label=name))
    shown = np.where(wrong, np.nan, 1e6 * depth).T
    shade.append(Map(edges, sides, shown, bar="worn depth, µm"))
    largest = DEPTH.column(found.lines)
    line = Line(speeds, largest, marker=".", spread=largest * errors)
    counts = np.array([lobes_of(row) or np.nan for row in depth])
    lobes = Line(speeds, counts, "", marker=".")
    ticks = {float(k): f"{k}" for k in range(0, 361, 90)}
    most = float(np.nanmax(counts, initial=1.0))
    panels = [
        Panel(shade, "", "angle, degrees", tight="xy", yticks=ticks),
        Panel([line], "", "largest, µm", ylim=(0.0, None), tight="x"),
        Panel([lobes], SPEED.label, "lobes", ylim=(0.0, most + 1.0), whole="y", tight="x"),
    ]
    return Plot(panels, 9.0, 7.0, heights=(3.0, 1.4, 1.0), share="x")


SMALLEST = 1e-3  # smaller amplitudes, relative to the largest one, are not drawn
THICKNESS = 0.005  # half of the smallest thickness of a line, relative to the height of the map
ROWS = 2000  # engine orders that are drawn
VERDICTS = {PERIOD: "o", TORUS: "D", OTHER: "x", UNSETTLED: "_", WEARING: "v"}
"""Mark of each verdict."""


def _judged(line: MapLine) -> str:
    """The estimated errors of a line in words; empty if it was not checked."""
    known = [one for one in ERRORS if one.value(line) is not None]
    found = [f"{one.text(line)} by the {one.head.split()[0]}" for one in known]
    return f", with an estimated error of {' and '.join(found)}" if found else ""


def sentences(found: InteractionMap) -> list[str]:
    """The results in sentences."""
    keys, top = found.scene.map, max(found.lines, key=lambda line: line.amplitude)
    start = {
        "rest": "each from rest in its equilibrium",
        "up": "each from the end of the next lower speed",
        "down": "each from the end of the next higher speed",
    }[keys.start]
    kinds = [line.verdict for line in found.lines]
    verdicts = ", ".join(f"{kinds.count(kind)} {kind}" for kind in VERDICTS if kind in kinds)
    lines = [
        f"{counted(len(found.lines), 'speed')} from {SPEED.cell(found.lines[0])} to "
        f"{SPEED.text(found.lines[-1])}, {start}: {keys.revolutions} revolutions of "
        f"{found.steps} steps with {counted(found.size, 'coordinate')}; the last {keys.last} are "
        f"shown. The clearance holds {keys.clearance}.",
        f"Largest amplitude {AMPLITUDE.text(top)} at {SPEED.text(top)}, with a peak normal force "
        f"of {FORCE.text(top)} ({MOTION.cell(top)}){_judged(top)}.",
        f"Motions: {verdicts}.",
        f"The speeds took {found.column('seconds').sum():.0f} CPU s, all {found.seconds:.0f} s.",
    ]
    if found.rings:
        lines.append(wear_sentence(found))
    checked = [line for line in found.lines if line.errors.size]
    if checked:
        worst = max(checked, key=lambda line: float(line.errors.max()))
        lines.append(
            f"Errors were estimated at {counted(len(checked), 'speed')}. The largest is that at "
            f"{SPEED.text(worst)}{_judged(worst)}, of the largest amplitude there."
        )
    if found.reused:
        lines.append(f"{counted(found.reused, 'speed')} are those of an earlier map.")
    if found.interrupted:
        lines.append("The map was interrupted.")
    return lines


def summary(found: InteractionMap) -> dict[str, Any]:
    """What `map.json` has of a map."""
    return {
        "coordinates": found.size,
        "steps_per_revolution": found.steps,
        "excited_orders": list(found.excited),
        "onsets": rows_of(found.onsets(), ONSETS),
        "speeds": rows_of(found.lines, quantities(found)),
        "reused": found.reused,
    }


def figure(found: InteractionMap) -> Plot:
    """Amplitudes over speed and frequency, with excitation, modes, errors and other motions."""
    speeds, orders, values = found.speeds_rpm, found.orders, 1e3 * found.amplitudes
    top = float(values.max(initial=0.0)) or 1.0
    seen = values > SMALLEST * top
    highest = float(np.max(np.where(seen, speeds[:, None] * orders, 0.0))) / 60.0
    modes = found.column("free_hz")
    highest = 1.1 * max(highest, modes[modes <= orders[-1] * speeds[-1] / 60.0].max(initial=0.0))
    edges = _edges(speeds)
    sides = np.linspace(0.0, orders[-1] + orders[1], ROWS + 1, dtype=np.float64)
    widths = np.asarray(THICKNESS * highest * 60.0 / speeds, dtype=np.float64)
    image = _image(values, orders, widths, sides, SMALLEST * top)
    low, high = np.log10([values[seen].min(initial=top), top])
    marks = np.arange(np.ceil(low), high + 1e-9)
    if marks.size < 2:
        marks = np.linspace(low, high, 4)
    shade = Map(
        np.broadcast_to(edges, (sides.size, edges.size)),
        sides[:, None] * edges / 60.0,
        np.log10(image).T,
        cmap="viridis_r",
        bar=AMPLITUDE.head,
        ticks={float(mark): f"{10.0**mark:.3g}" for mark in marks},
    )
    items: list[Item] = [shade, *_mode_lines(found), *_marks(found)]
    ends: Any = {"xlim": (edges[0], edges[-1]), "ylim": (0.0, highest)}
    return Plot([Panel(items, SPEED.label, "frequency, Hz", **ends)], 9.0, 5.8)


def _image(values: Array, orders: Array, widths: Array, sides: Array, least: float) -> Array:
    """Amplitudes (s, ROWS) over the engine orders, each the largest one near it, or nan.

    Args:
        values: (s, k) amplitudes; those below `least` are left out.
        orders: (k,) engine orders.
        widths: (s,) half of the smallest thickness of a line, in engine orders.
        sides: (ROWS + 1,) the edges of the rows, in engine orders.
        least: smallest amplitude that is drawn.
    """
    image, widths = np.full((widths.size, ROWS), np.nan), np.maximum(widths, 0.5 * orders[1])
    for k, j in np.argwhere(values > least):
        first, last = np.searchsorted(sides, orders[j] + widths[k] * np.array([-1.0, 1.0]))
        image[k, first:last] = np.fmax(image[k, first:last], values[k, j])
    return image


def _edges(speeds: Array) -> Array:
    """The edges (s + 1,) of the columns of some speeds (s,), which begin and end at a speed."""
    if speeds.size == 1:
        return np.asarray(speeds[0] * np.array([0.99, 1.01]))
    return np.concatenate([speeds[:1], 0.5 * (speeds[1:] + speeds[:-1]), speeds[-1:]])


def _mode_lines(found: InteractionMap) -> list[Item]:
    """The excited engine orders and the frequencies of the modes, free and closed."""
    speeds = found.speeds_rpm
    items: list[Item] = [
        Line(speeds, order * speeds / 60.0, ":", linewidth=0.8, label="excitation")
        for order in found.excited
    ]
    for name, style, label in (("free_hz", "-", "modes"), ("closed_hz", "--", "modes, closed")):
        look: dict[str, Any] = {"color": COLOURS[1], "linewidth": 1.2, "label": label}
        items += [Line(speeds, column, style, **look) for column in found.column(name).T]
    return items


def _marks(found: InteractionMap) -> list[Item]:
    """The marks of cells with large errors, and of speeds with several motions."""
    places = [
        (line.speed_rpm, order * line.speed_rpm / 60.0)
        for line in found.lines
        for order in found.orders[: line.errors.size][line.errors > LARGE]
    ]
    items: list[Item] = []
    if places:
        name = f"error above {100 * LARGE:g} %"
        look: dict[str, Any] = {"marker": "s", "markersize": 4.0, "hollow": True}
        x, y = zip(*places, strict=True)
        items.append(Line(x, y, "", COLOURS[3], label=name, **look))
    if several := [line.speed_rpm for line in found.lines if line.coexists]:
        items.append(Line(several, None, "", COLOURS[2], marker="v", label="several motions"))
    return items


def curves_figure(found: InteractionMap) -> Plot:
    """Amplitude, peak force, contact and clearance over the speed."""
    drawable = {one: one.column(found.lines) for one in (AMPLITUDE, FORCE, CONTACT, CLEARANCE)}
    chosen = {one: values for one, values in drawable.items() if np.isfinite(values).any()}
    speeds, verdicts = found.speeds_rpm, found.column("verdict")
    others = [(line.speed_rpm, 1e3 * line.other) for line in found.lines if line.coexists]
    panels: list[Panel] = []
    for quantity, values in chosen.items():
        items: list[Item] = [Line(speeds, values, color="#A6ABB0", linewidth=1.0)]
        for verdict, mark in VERDICTS.items():
            if (mine := verdicts == verdict).any():
                look: dict[str, Any] = {"marker": mark, "markersize": 3.5, "label": verdict}
                items.append(Line(speeds[mine], values[mine], "", **look))
        if others and not panels:
            look = {"marker": "v", "label": "from another start"}
            x, y = np.transpose(others)
            items.append(Line(x, y, "", COLOURS[2], **look))
        panels.append(Panel(items, ylabel=quantity.label))
    return Plot(panels, 9.0, 1.9 * len(chosen) + 0.3, share="x", xlabel=SPEED.label)


def write_hdf5(found: InteractionMap, path: Path) -> list[Path]:
    """Write the arrays of a map, or add a warning where h5py is not installed.

    Raises:
        OSError: the file cannot be written.
    """
    if (reason := missing_module("h5py")) is not None:
        text = f"{path.name} was not written: {reason}."
        found.warnings.append(Note(NoteKind.NOT_DRAWN, text, path.name))
        return []
    import h5py  # type: ignore[import-untyped]

    with atomic_write(path) as temporary, h5py.File(temporary, "w") as file:
        file["engine_orders"], file["amplitudes_m"] = found.orders, found.amplitudes
        errors = np.full(found.amplitudes.shape, np.nan)
        for row, line in zip(errors, found.lines, strict=True):
            row[: line.errors.size] = line.errors
        file["relative_errors"] = errors
        for one in (one for one in quantities(found) if one.key):
            values = [one.value(line) for line in found.lines]
            file[one.key] = values if one.key == "verdict" else np.array(values, dtype=float)
        if found.rings:
            file["angle_rad"], file["worn_profile_m"] = profiles(found, "worn")
            file["worn_profile_error"] = profiles(found, "worn_errors")[1]
    return [path]


def report(found: InteractionMap) -> Report:
    """The report of a map: `map.csv`, `map.json`, `map.png`, `map_curves.png`, and its wear."""
    shown = quantities(found)
    caption, draw = "One number for each speed.", partial(curves_figure, found)
    pictures = [
        Picture("Interaction map", "map.png", lambda: figure(found), CAPTION, "map.csv"),
        Picture("Over the speed", "map_curves.png", draw, caption, "map.csv"),
    ]
    if around := any(ring.radius for ring in found.rings) and found.column("worn").any():
        caption = (
            "The depth that the body wore of the abradable layer, over the angle of the casing, "
            "and the number of its lobes."
        )
        draw = partial(wear_figure, found)
        pictures.append(Picture("Wear", "map_wear.png", draw, caption, "map_wear.csv"))
    sections = [
        Section("Speeds of resonance", [table_of(found.onsets(), ONSETS)], keys=2, most=20),
        Section("Speeds", [table_of(found.lines, shown)], most=20),
    ]
    return Report(
        "map",
        title="interaction map",
        found=found,
        sentences=sentences(found),
        sections=sections,
        rows=rows_of(found.lines, shown),
        summary=summary(found),
        pictures=pictures,
        varied=["rotation.speed_rpm", *(f"map.{entry.name}" for entry in fields(found.scene.map))],
        more_rows={"map_wear.csv": profile_rows(found)} if around else {},
        quantities=[AMPLITUDES, PEAK_FORCE, *([WEAR] if found.rings else [])],
    )


CAPTION = (
    "Amplitude over speed and frequency. Dotted lines: excitation; solid and dashed curves: "
    "natural frequencies, free and with the contact closed."
)

"""Recompute every number and curve of the paper, for the beam and for the 2D solid.

    python3 demos/paper/reproduce.py --output out/paper

The paper is Mashayekhi and Zucca, Appl. Sci. 14 (2024) 3936. The numbers printed in the paper are
constants of these scripts; the rest is computed. The results are the tables of README.md and
pictures. The elastic force of the beam is not a polynomial, so its reduced models are intrusive
projections. If parts are named, only these parts are made, and README.md keeps its other tables.
"""

from __future__ import annotations

import argparse
import itertools
import re
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from paper_cases import BODIES, HERE, LINEAR, Table, body, full, scene, tried
from paper_curves import response_figure, response_table
from paper_tables import (
    plain_table,
    selection_table,
    state_table,
    table_1,
    table_2,
    table_3,
    third_order_table,
    threshold_table,
)

from fenicsrom.fem.full.full import full_model
from fenicsrom.files import atomic_write
from fenicsrom.online.run.simulate import simulate
from fenicsrom.post.base.drawing import figure_of
from fenicsrom.post.base.plot import Item, Line, Panel, Plot
from fenicsrom.post.base.style import COLOURS, line_styles
from fenicsrom.post.base.tables import write_figure
from fenicsrom.post.run import figures
from fenicsrom.scene import scene_heading


def deflection_figure(kind: str, name: str) -> Plot:
    """Figs. 5a and 12a: the deflected beam at instants of the steady state."""
    of = scene(name)
    beam = body("beam", of)
    motion = simulate(full_model(beam), of, keep_coordinates=True)
    x = np.linspace(0, beam.beam.length, beam.beam.elements + 1)[1:]
    instants = np.linspace(0, motion.coordinates.shape[0] - 1, 9).astype(int)[:-1]
    styles = line_styles(f"{j / 8:g} T" for j in range(8))
    lines = [
        Line(x + q[0::3], 1e3 * q[1::3], label=label, **style)
        for (label, style), q in zip(styles.items(), motion.coordinates[instants], strict=True)
    ]
    return Plot([Panel(lines, "position, m", "deflection, mm", legend=lines)], 7.6, 3.6)


def selection_figure(parts: Sequence[tuple[str, Sequence[int], Sequence[int]]]) -> Plot:
    """Figs. 8, 9 and 14: error by size, with and without derivatives, for both bodies."""
    panels = []
    for kind, (name, chosen, plain) in itertools.product(BODIES, parts):
        outcomes = [
            *tried(kind, name, f"compare.modes={list(chosen)}"),
            *tried(kind, name, f"compare.modes={list(plain)}", 'compare.derivatives=["none"]'),
        ]
        items: list[Item] = []
        for color, way in zip(COLOURS, ("none", "mmi", "mmi-nls"), strict=False):
            for method, style, marker in (("rubin", "-", "o"), ("craig-bampton", "--", "s")):
                points = sorted(
                    (len(o.labels), max(o.errors["amplitude_tangential"] or 0.0, 1e-5))
                    for o in outcomes
                    if o.errors
                    and (o.combination.derivatives, o.combination.method) == (way, method)
                )
                if points:
                    look = {"marker": marker, "markersize": 4.0, "label": f"{method}, {way}"}
                    items.append(Line(*zip(*points, strict=True), style, color, **look))
        panels.append(Panel(items, title=f"{kind}: {scene_heading(scene(name))}", log="y"))
    across, up = "number of coordinates", "error of the tip amplitude, %"
    look = {"share": "y", "xlabel": across, "ylabel": up}
    return Plot(panels, 4.2 * len(parts) + 1.0, 6.4, len(parts), **look)


CHOSEN, PLAIN = (1, 2, 3, 4, 5), (1, 3, 8, 14)
STICKING, STICKING_PLAIN = (1, 2, 3), (1, 3)

PARTS: dict[str, Callable[[], Table]] = {
    "table 1": table_1,
    "table 2": table_2,
    "table 3": table_3,
    "figures 5 to 7, 12, 13": state_table,
    "figure 4": response_table,
    "figure 8, left": lambda: selection_table("slip_liftoff", CHOSEN),
    "figure 8, right": lambda: selection_table("high_load", CHOSEN),
    "figure 9, left": lambda: plain_table("slip_liftoff", PLAIN),
    "figure 9, right": lambda: plain_table("high_load", PLAIN),
    "figure 14": lambda: selection_table("stick_slip", STICKING),
    "figure 14, no derivatives": lambda: plain_table("stick_slip", STICKING_PLAIN),
    "thresholds": threshold_table,
    "third order": third_order_table,
}
PICTURES: dict[str, tuple[str, Callable[[], Plot]]] = {
    "figure_04": ("figure 4", response_figure),
    "figure_05": ("figures 5 to 7, 12, 13", lambda: deflection_figure("beam", "slip_liftoff")),
    "figure_05_motion": (
        "figures 5 to 7, 12, 13",
        lambda: figures.plot_motion({k: full(k, "slip_liftoff") for k in BODIES}),
    ),
    "figure_06": (
        "figures 5 to 7, 12, 13",
        lambda: figures.plot_contact({k: full(k, "slip_liftoff") for k in BODIES}),
    ),
    "figure_07": (
        "figures 5 to 7, 12, 13",
        lambda: figures.plot_contact({k: full(k, "slip_liftoff", LINEAR) for k in BODIES}),
    ),
    "figures_08_09": (
        "figure 9, right",
        lambda: selection_figure([("slip_liftoff", CHOSEN, PLAIN), ("high_load", CHOSEN, PLAIN)]),
    ),
    "figure_12": ("figures 5 to 7, 12, 13", lambda: deflection_figure("beam", "stick_slip")),
    "figure_13": (
        "figures 5 to 7, 12, 13",
        lambda: figures.plot_contact({k: full(k, "stick_slip") for k in BODIES}),
    ),
    "figure_14": (
        "figure 14, no derivatives",
        lambda: selection_figure([("stick_slip", STICKING, STICKING_PLAIN)]),
    ),
}


def markdown(table: Table) -> str:
    """A table in Markdown."""
    lines = ["| " + " | ".join(str(value) for value in row) + " |" for row in table]
    return "\n".join([lines[0], "|" + "---|" * len(table[0]), *lines[1:]])


def fill(readme: Path, name: str, text: str) -> None:
    """Replace the text between the markers of a part."""
    page = readme.read_text(encoding="utf-8")
    pattern = re.compile(rf"(<!-- {re.escape(name)} -->\n).*?(<!-- end -->)", re.DOTALL)
    if not pattern.search(page):
        raise ValueError(f"{readme}: no markers of {name}")
    with atomic_write(readme) as temporary:
        temporary.write_text(
            pattern.sub(lambda found: f"{found[1]}{text}\n{found[2]}", page), encoding="utf-8"
        )


def main() -> None:
    """Make the named parts, or all."""
    parser = argparse.ArgumentParser(description="Reproduce the paper's tables and figures.")
    parser.add_argument(
        "parts", nargs="*", help=f"parts to make: {', '.join(PARTS)} (default: all)"
    )
    parser.add_argument("--output", default="out/paper", help="folder of the pictures")
    options = parser.parse_args()
    wanted = options.parts or list(PARTS)
    for name in wanted:
        fill(HERE / "README.md", name, markdown(PARTS[name]()))
    for file, (part, draw) in PICTURES.items():
        if part in wanted:
            write_figure(Path(options.output) / f"{file}.png", figure_of(draw()))


if __name__ == "__main__":
    main()

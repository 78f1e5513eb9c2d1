"""The report of an equilibrium path: sentences, tables and files."""

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

from fenicsrom.assess.curves.equilibrium_path import Equilibrium, EquilibriumPath
from fenicsrom.notes import DEFLECTION, STABILITY
from fenicsrom.online.stress.stress import extremes
from fenicsrom.post.base.page import Report, Section
from fenicsrom.post.base.picture import Picture
from fenicsrom.post.base.plot import Item, Line, Panel, Plot
from fenicsrom.post.base.style import COLOURS
from fenicsrom.post.base.tables import Quantity, components, rows_of, table_of
from fenicsrom.post.curves.response_figures import STYLES, stretches
from fenicsrom.words import counted

ENDS = {
    "end of the range": "The path reached the end of the range of the load factor.",
    "displacement of the probe": "The path reached statics.displacement.",
    "sliding": "The path ends there: friction no longer holds a body, which slides.",
    "number of points": "The path is incomplete: it reached statics.points.",
    "no convergence": "The path is incomplete: no further point was found.",
    "interrupted": "The path is incomplete: the run was interrupted.",
}


FACTOR = Quantity("load_factor", head="load factor", digits=7)


CONTACT = [
    Quantity("closed_points", "closed", "closed points"),
    Quantity("slipping_points", "slipping", "slipping points"),
    Quantity("friction_dissipation_J", "dissipated", "friction dissipates, J", 4),
]


def quantities(found: EquilibriumPath) -> list[Quantity]:
    """What is told of each equilibrium."""
    probe = components("probe_{}_m", "probe", "xyz"[: found.points[0].probe.size])
    axis = found.direction
    probe[axis] = replace(probe[axis], head=f"probe along {'xyz'[axis]}, mm", digits=6)
    return [
        *(Quantity("kind", head="kind"), FACTOR),
        *probe,
        Quantity("largest_displacement_m", "largest", "largest displacement, mm", 6),
        *map(Quantity, ("negative_pivots", "residual")),
        Quantity("smallest_volume_ratio", "deformation.volume_ratio"),
        Quantity("smallest_stretch", "deformation.smallest_stretch"),
        Quantity("largest_stretch", "deformation.largest_stretch"),
        *(CONTACT if found.scene.joined else []),
    ]


def summary(found: EquilibriumPath) -> dict[str, Any]:
    """What `equilibria.json` has of a path."""
    shown = quantities(found)
    strained = extremes([point.deformation for point in found.points])
    return {
        "dofs": found.unknowns,
        "loads": found.scene.statics.loads,
        "points": len(found.points),
        "end": found.reason,
        "special_points": rows_of(found.special, shown),
        "last": rows_of(found.points[-1:], shown)[0],
        "largest_stable_load_factor": largest_stable(found).load_factor,
        "largest_compressive_strain": 1.0 - strained.smallest_stretch,
        "largest_tensile_strain": strained.largest_stretch - 1.0,
    }


def largest_stable(found: EquilibriumPath) -> Equilibrium:
    """The stable equilibrium under the largest load factor that is reached without a jump."""
    first = next((k for k, point in enumerate(found.points) if point.kind), len(found.points) - 1)
    return max(found.points[: first + 1], key=lambda point: point.load_factor)


def sentences(found: EquilibriumPath) -> list[str]:
    """The results in sentences, for the terminal and the report."""
    last, axis = found.points[-1], found.direction
    limits = [point for point in found.special if point.kind == "limit point"]
    crossed = [point for point in found.special if point.kind == "bifurcation"]
    lines = [
        f"{counted(len(found.points), 'equilibrium', 'equilibria')} in {found.seconds:.1f} s, up "
        f"to the load factor {FACTOR.cell(last)}, where the probe is displaced by "
        f"{1e3 * last.probe[axis]:.5g} mm along {'xyz'[axis]}.",
        ENDS[found.reason],
        *filter(None, [found.mesh_check.sentence()]),
    ]
    if found.scene.joined:
        lines.append(
            f"There {counted(last.closed, 'contact point')} touched, of which {last.slipping} "
            f"slipped; friction dissipated {last.dissipated:.4g} J up to there."
        )
    if not found.special:
        lines.append("It has no limit point and no bifurcation up to there.")
        return lines
    lines.append(f"{counted(len(limits), 'limit point')}, {counted(len(crossed), 'bifurcation')}.")
    first = found.special[0]
    what = "snaps through" if first.kind == "limit point" else "buckles"
    lines.append(f"Under a growing load the body {what} at the load factor {FACTOR.cell(first)}.")
    return lines


def report(found: EquilibriumPath, more: Sequence[Picture] = ()) -> Report:
    """The report of a path: `equilibria.csv`, `equilibria.json` and `equilibria.png`.

    Args:
        found: the path.
        more: other pictures.
    """
    shown, joined = quantities(found), found.scene.joined
    draw = partial(figure, found)
    path = Picture("Equilibrium path", "equilibria.png", draw, CAPTION, "equilibria.csv")
    return Report(
        "equilibria",
        title="equilibria",
        found=found,
        sentences=sentences(found),
        sections=[Section("Limit points and bifurcations", [table_of(found.special, shown)])],
        rows=rows_of(found.points, shown),
        summary=summary(found),
        pictures=[path, *more],
        quantities=[STABILITY] if joined else [DEFLECTION, STABILITY],
        unjudged=[DEFLECTION] if joined else [],
    )


def write_shapes(found: EquilibriumPath, folder: Path) -> list[Path]:
    """Write the displacements at special points and at the end for ParaView. Collective.

    Raises:
        OSError: the file cannot be written.
    """
    if found.body is None or not found.scene.output.paraview:
        return []
    from fenicsrom.post.paraview.vtk import Attached, write_fields

    fields = {
        f"{label.replace(' ', '_')}_m": found.body.field(shape)
        for label, shape in found.shapes.items()
    }
    factors = [point.load_factor for point in (*found.special, found.points[-1])]
    notes = {f"load_factor_of_{name}": f"{f:.7g}" for name, f in zip(fields, factors, strict=False)}
    space = found.body.space
    return [write_fields(folder, "equilibria", space, fields, Attached(notes=notes))]


CAPTION = "Stable equilibria are solid, unstable ones dashed."
MARKERS = {"limit point": ("o", COLOURS[1]), "bifurcation": ("D", COLOURS[2])}


def figure(found: EquilibriumPath) -> Plot:
    """The path, solid where it is stable and dashed where it is not, with special points."""

    def place(points: list[Equilibrium]) -> tuple[list[float], list[float]]:
        moved = [1e3 * point.probe[found.direction] for point in points]
        return moved, [point.load_factor for point in points]

    items: list[Item] = []
    for stable, part in stretches(found.points, lambda point: point.negative_pivots == 0):
        word, style = STYLES[stable]
        items.append(Line(*place([found.points[k] for k in part]), style, label=word))
    for kind, (marker, color) in MARKERS.items():
        if special := [point for point in found.special if point.kind == kind]:
            look: dict[str, Any] = {"marker": marker, "markersize": 6.0, "hollow": True}
            items.append(Line(*place(special), "", color, label=kind, **look))
    across = f"displacement of the probe along {'xyz'[found.direction]}, mm"
    alone = len({item.label for item in items if isinstance(item, Line)}) == 1
    panel = Panel(items, across, FACTOR.label)
    return Plot([panel], 7.4, 5.0, legend=() if alone else None)

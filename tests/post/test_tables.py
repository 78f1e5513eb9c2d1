"""Tables: they fit into the terminal and into the report, and directions have names."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from support import contact_points

from fenicsrom.online.contact.points import no_points
from fenicsrom.post.base.tables import (
    TERMINAL_WIDTH,
    Quantity,
    direction_names,
    direction_note,
    filled_columns,
    rows_of,
    table_of,
    text_table,
)
from fenicsrom.post.run.summary import _without_rounding
from fenicsrom.scene import read_scene

DEMOS = Path(__file__).parents[2] / "demos"


def test_files_have_si_units_and_tables_and_axes_those_of_the_head() -> None:
    shown = [
        Quantity("amplitude_m", head="amplitude of the probe, mm", digits=3),
        Quantity("gap_mm", head="gap, mm"),
        Quantity("error", head="error, %", digits=2),
        Quantity("error_percent", "error", "error of the curve, %"),
        Quantity("kind"),
    ]
    records = [
        {"amplitude_m": 0.0123456, "gap_mm": 2.5, "error": 0.5, "kind": "fold"},
        {"amplitude_m": float("inf"), "gap_mm": 3.5, "kind": ""},
    ]
    first, second = rows_of(records, shown)
    assert first["amplitude_m"] == 0.0123456 and first["gap_mm"] == 2.5
    assert second["amplitude_m"] is None and second["error"] is None
    head, *cells = table_of(records, shown)
    assert cells == [["12.3", "2.5", "50", "0.5"], [None, "3.5", None, None]]
    assert head[0] == "amplitude of the probe, mm" and shown[0].text(records[0]) == "12.3 mm"
    assert shown[0].label == "amplitude of the\nprobe,\N{NO-BREAK SPACE}mm"
    assert shown[0].column(records[:1]).tolist() == [12.3456]
    assert table_of([], shown) == []


def test_columns_without_content_are_left_out() -> None:
    rows = [["name", "none", "empty", "zero"], [None, None, "", 0], [None, None, "", 0]]
    assert filled_columns(rows) == [["name", "zero"], [None, 0], [None, 0]]


def test_wide_heads_take_several_lines() -> None:
    heads = ["name", *(f"a long head number {k}" for k in range(9))]
    table = text_table([heads, ["first", *range(9)]])
    lines = table.splitlines()
    assert max(map(len, lines)) <= TERMINAL_WIDTH
    assert lines[-1].split() == ["first", *map(str, range(9))]
    above = [line.split() for line in lines[:-2]]
    assert above[-1][0] == "name" and ["a"] * 9 not in above[-1:]


@pytest.mark.parametrize("keys", [1, 2])
def test_too_many_columns_are_distributed_over_tables_with_the_same_keys(keys: int) -> None:
    heads = ["name", "kind", *(f"column{k}" for k in range(30))]
    rows = [heads, *([name, "k", *range(1000, 1030)] for name in ("first", "second"))]
    blocks = text_table(rows, keys).split("\n\n")
    found: list[str] = []
    for block in blocks:
        lines = block.splitlines()
        assert max(map(len, lines)) <= TERMINAL_WIDTH and len(lines) == 4
        assert lines[2].startswith("first") and lines[3].startswith("second")
        found += lines[2].split()[keys:]
    assert len(blocks) > 1
    assert found == (["k"] * (keys == 1)) + [str(value) for value in range(1000, 1030)]


@pytest.mark.parametrize(
    ("demo", "override", "names"),
    [
        ("slip_liftoff_2d", "", ["normal x", "tangential y"]),
        ("slip_liftoff_3d", "", ["normal x", "tangential y", "tangential z"]),
        ("slip_liftoff_2d", "contacts.0.normal=[0.6, 0.8]", ["normal", "tangential"]),
        ("response_2d", "", ["x", "y"]),
    ],
)
def test_directions_along_axes_are_named(demo: str, override: str, names: list[str]) -> None:
    scene = read_scene(DEMOS / f"{demo}.toml", [override] if override else [])
    normals = [contact.normal for contact in scene.contacts]
    points = contact_points(*normals) if normals else no_points(2)
    assert direction_names(scene, points) == names


@pytest.mark.parametrize(
    ("first", "second", "names", "told"),
    [
        ([1.0, 0.0, 0.0], [-1.0, 0.0, 1e-7], ["normal x", "tangential y", "tangential z"], None),
        (
            [0.0, 1.0, 0.0],
            [0.0, 0.6, 0.8],
            ["normal", "tangential 1", "tangential 2"],
            "normal (0, 1, 0), tangential 1 (0, 0, 1), tangential 2 (1, 0, 0)",
        ),
        (
            [0.0, 0.6, 0.8],
            [0.0, 0.8, -0.6],
            ["normal", "tangential x", "tangential 2"],
            "normal (0, 0.6, 0.8), tangential 2 (0, 0.8, -0.6)",
        ),
    ],
)
def test_directions_of_points_are_named_where_all_have_one_axis(
    first: list[float], second: list[float], names: list[str], told: str | None
) -> None:
    scene = read_scene(DEMOS / "blade_rub.toml")
    points = contact_points(first, second)
    assert direction_names(scene, points) == names
    note = direction_note(scene, points)
    assert note is None if told is None else note is not None and told in note


def test_number_of_a_row_below_rounding_is_written_as_zero() -> None:
    assert _without_rounding(np.array([-2.5, 1e-17, 0.0])) == ["-2.5", "0", "0"]

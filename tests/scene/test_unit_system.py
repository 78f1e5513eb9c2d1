"""Scenes in other units than SI: [units]."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from support import refusal

from fenicsrom.errors import ErrorKind
from fenicsrom.online.store.scene_changes import changed_scene
from fenicsrom.scene import Scene, parse_scene, read_scene, scene_heading, scene_table, toml_text
from fenicsrom.scene.keys.unit_system import Units
from fenicsrom.scene.reading.overrides import override_table
from fenicsrom.scene.reading.reading import read_toml

SI = """
[geometry]
mesh = "part.inp"
dimension = 3
scale = 0.001
[material]
young = 2.1e11
poisson = 0.3
density = 7850.0
mass_damping = 3.0
[[supports]]
plane = { point = [0.01, 0.0, 0.0], normal = [1.0, 0.0, 0.0], tolerance = 1e-6 }
[[attachments]]
nearest = [0.1, 0.02, 0.0]
mass = 0.25
stiffness = 5e4
[[attachments]]
group = "pad"
stiffness_per_area = 4e9
damping_per_area = 3e5
[[loads]]
group = "face"
direction = [0.0, 0.0, 1.0]
force = 25.0
frequency = 120.0
[[loads]]
group = "face"
pressure = 2e5
[[loads]]
direction = [0.0, 0.0, -1.0]
acceleration = 9.81
[[contacts]]
group = "pad"
at = "nodes"
normal = [0.0, 0.0, 1.0]
preload = 3e6
normal_stiffness = 2e11
tangential_stiffness = 1e11
friction = 0.3
[[contacts]]
nearest = [0.2, 0.02, 0.0]
gap = 1e-4
normal_stiffness = 2e7
tangential_stiffness = 1e7
friction = 0.3
[contacts.surface]
kind = "cylinder"
point = [0.0, 0.0, 0.0]
axis = [0.0, 1.0, 0.0]
waves = [[3, 2e-5, 0.1]]
[response]
parameter = "contacts.1.gap"
first = 5e-5
last = 2e-4
full = [1e-4]
families = { key = "loads.0.force", values = [10.0, 25.0] }
"""

MM = """
[units]
length = "mm"
mass = "t"
[geometry]
mesh = "part.inp"
dimension = 3
[material]
young = 2.1e5
poisson = 0.3
density = 7.85e-9
mass_damping = 3.0
[[supports]]
plane = { point = [10.0, 0.0, 0.0], normal = [1.0, 0.0, 0.0], tolerance = 1e-3 }
[[attachments]]
nearest = [100.0, 20.0, 0.0]
mass = 2.5e-4
stiffness = 50.0
[[attachments]]
group = "pad"
stiffness_per_area = 4.0
damping_per_area = 3e-4
[[loads]]
group = "face"
direction = [0.0, 0.0, 1.0]
force = 25.0
frequency = 120.0
[[loads]]
group = "face"
pressure = 0.2
[[loads]]
direction = [0.0, 0.0, -1.0]
acceleration = 9810.0
[[contacts]]
group = "pad"
at = "nodes"
normal = [0.0, 0.0, 1.0]
preload = 3.0
normal_stiffness = 200.0
tangential_stiffness = 100.0
friction = 0.3
[[contacts]]
nearest = [200.0, 20.0, 0.0]
gap = 0.1
normal_stiffness = 2e4
tangential_stiffness = 1e4
friction = 0.3
[contacts.surface]
kind = "cylinder"
point = [0.0, 0.0, 0.0]
axis = [0.0, 1.0, 0.0]
waves = [[3, 0.02, 0.1]]
[response]
parameter = "contacts.1.gap"
first = 0.05
last = 0.2
full = [0.1]
families = { key = "loads.0.force", values = [10.0, 25.0] }
"""


def scene(folder: Path, text: str, *overrides: str) -> Scene:
    """The scene of a text, with an empty mesh file beside it."""
    (folder / "part.inp").touch()
    (folder / "scene.toml").write_text(text)
    return read_scene(folder / "scene.toml", overrides)


def numbers(found: Scene) -> dict[str, Any]:
    """The plain data of a scene without its units."""
    table = scene_table(found)
    return {key: value for key, value in table.items() if key != "units"}


def test_scene_in_millimetres_equals_the_scene_in_si_units(tmp_path: Path) -> None:
    assert numbers(scene(tmp_path, MM)) == numbers(scene(tmp_path, SI))


def test_stored_scene_is_not_converted_again(tmp_path: Path) -> None:
    found = scene(tmp_path, MM)
    again = parse_scene(scene_table(found), found.source, tmp_path)
    (tmp_path / "again.toml").write_text(toml_text(scene_table(found)))
    assert again == found
    assert numbers(read_scene(tmp_path / "again.toml")) == numbers(found)


@pytest.mark.parametrize(
    ("override", "path", "value"),
    [
        ("contacts.1.gap=0.2", "contacts.1.gap", 2e-4),
        ("response.last=0.3", "response.last", 3e-4),
        ("loads.0.pulse={duration=2.0, start=1.0}", "loads.0.pulse.start", 1.0),
        ("contacts.1.surface.waves=[[3, 0.04, 0.2]]", "contacts.1.surface.waves", [[3, 4e-5, 0.2]]),
    ],
)
def test_override_of_a_stored_scene_is_in_its_units(
    tmp_path: Path, override: str, path: str, value: object
) -> None:
    """The same as an override of the scene file."""
    impact = "pulse" in override
    extra = ("time.duration=1.0", "time.step=0.1") if impact else ()
    text = MM[: MM.index("[response]")] if impact else MM
    stored = scene(tmp_path, text)
    found = changed_scene(stored, [override, *extra])
    assert numbers(found) == {
        **numbers(scene(tmp_path, text, override, *extra)),
        "title": found.title,
    }
    entry: Any = scene_table(found)
    for name in path.split("."):
        entry = entry[int(name)] if name.isdecimal() else entry[name]
    assert entry == value


def test_times_of_a_table_file_are_converted(tmp_path: Path) -> None:
    (tmp_path / "push.csv").write_text("0 0\n5 1\n")
    table = override_table(
        {**read_toml(str(_written(tmp_path)))},
        ['loads.0.table="push.csv"', "time.duration=10.0", "time.step=0.1"],
        "scene",
    )
    del table["response"]
    table["units"] = {"time": "ms"}
    table["contacts"] = []
    found = parse_scene(table, "scene", tmp_path)
    assert found.loads[0].history.rows == ((0.0, 0.0), (5e-3, 1.0))  # type: ignore[union-attr]
    assert found.time.duration == 10e-3


def _written(folder: Path) -> Path:
    scene(folder, SI)
    return folder / "scene.toml"


def test_title_shows_the_numbers_of_the_file(tmp_path: Path) -> None:
    found = scene(tmp_path, 'title = "gap {contacts.1.gap}"\n' + MM)
    assert scene_heading(found) == "gap 0.1"


def test_wrong_number_is_shown_as_it_is_written(tmp_path: Path) -> None:
    with refusal(ErrorKind.RANGE, "contacts[1].gap", names="= -0.1"):
        scene(tmp_path, MM.replace("gap = 0.1", "gap = -0.1"))


def test_names_of_derived_units() -> None:
    assert Units(length="mm", mass="t").names == "mm, t, s, N, MPa"
    assert Units(length="mm", mass="kg", time="ms").names == "mm, kg, ms, kN, GPa"
    assert Units(length="mm", mass="t").name_of("kg/m³") == "t/mm³"
    assert Units(length="in", mass="slinch").names == "in, slinch, s, lbf, psi"


def test_pounds_and_inches_are_those_of_the_tables() -> None:
    units = Units(length="in", mass="slinch")
    assert units.in_si(1.0, "N") == pytest.approx(4.4482216152605, rel=1e-15)
    assert units.in_si(30e6, "Pa") == pytest.approx(206.8427e9, rel=1e-6)
    assert units.in_si(0.1 / 386.0886, "kg/m³") == pytest.approx(2767.990, rel=1e-6)  # 0.1 lb/in³
    assert units.from_si(units.in_si(2.7, "N s/m³"), "N s/m³") == 2.7

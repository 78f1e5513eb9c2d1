"""Scenes: every demo is read, every mistake has its kind and key, and no other error occurs."""

from __future__ import annotations

import copy
import dataclasses
import json
import math
import pickle
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from support import refusal

from fenicsrom.errors import ErrorKind, SceneError
from fenicsrom.scene import (
    BeamSection,
    Harmonic,
    Load,
    Place,
    Scene,
    Time,
    json_schema,
    make_scene,
    override_table,
    parse_scene,
    read_scene,
    reference,
    scene_heading,
    scene_table,
    titled,
    toml_text,
)
from fenicsrom.scene.base.rules import LARGEST, SMALLEST
from fenicsrom.scene.base.tables import keys, table_kind
from fenicsrom.scene.checks.contact_checks import require_repeating
from fenicsrom.scene.keys.excitation import shortest_period
from fenicsrom.scene.reading.reading import shared_meshes

DEMOS = sorted((Path(__file__).parents[2] / "demos").glob("*.toml"))

RUBBING = """
[geometry]
mesh = "beam2d.geo"
dimension = 2
thickness = 0.01
[geometry.parameters]
length = 1
[material]
young = 207e9
poisson = 0.28
density = 7801
[[supports]]
group = "root"
[[loads]]
group = "load"
direction = [0.0, 2.0]
force = 100
frequency = 3.2
[[contacts]]
group = "tip"
normal = [1.0, 1.0]
preload = 40.0
normal_stiffness = 1e4
tangential_stiffness = 1e4
friction = 0.5
"""

DECAY = """
title = "free decay of a solid"
[geometry]
mesh = "blade.msh"
dimension = 3
[material]
young = 207e9
poisson = 0.28
density = 7801.0
[[supports]]
group = "root"
[[loads]]
node = [1.0, 0.0, 0.0]
direction = [0.0, 0.0, -3.0]
force = 2.0
[basis]
method = "craig-bampton"
derivatives = ["1V1V", "1V2V"]
[time]
scheme = "generalised-alpha"
duration = 1.0
step = 1e-3
[reference]
full = true
beam = true
beam_section = { length = 1.0, height = 0.1, width = 0.2, load_at = 1.0 }
"""

HERE = Path("nowhere")


def parse(text: str, *overrides: str, folder: Path | None = None) -> Scene:
    table = override_table(tomllib.loads(text), overrides, "s.toml")
    return parse_scene(table, "s.toml", folder)


def refused(text: str, *overrides: str, folder: Path | None = None) -> tuple[ErrorKind, str]:
    """The kind and the key of the error; its message is one line that names file and key."""
    with pytest.raises(SceneError) as caught:
        parse(text, *overrides, folder=folder)
    error = caught.value
    begins = tuple(f"s.toml: {error.key}{after}" for after in (" ", ": "))
    assert str(error).startswith(begins) and str(error).isprintable()
    assert error.source == "s.toml"
    return error.kind, error.key


# What is read


def test_engine_order_gives_multiple_of_speed() -> None:
    turning = (
        RUBBING.replace("frequency = ", "engine_order = 3 #")
        + "\n[rotation]\nspeed_rpm = -1200.0\n"
    )
    scene = parse(turning)
    assert scene.loads[0].frequency == 60.0 and scene.period == 1.0 / 60.0
    assert parse_scene(scene_table(scene), scene.source, None).loads == scene.loads
    no_rotation = RUBBING.replace("frequency = ", "engine_order = 3 #")
    for text in (no_rotation, turning.replace("-1200.0", "0.0")):
        assert refused(text) == (ErrorKind.CONFLICT, "loads[0].engine_order")
    both = turning.replace("engine_order", "frequency = 2.0\nengine_order")
    assert refused(both) == (ErrorKind.CONFLICT, "loads[0].engine_order")


def test_stored_scene_keeps_the_engine_order_until_it_gets_a_frequency() -> None:
    """Overrides of the plain data of a scene, as a stored model has it."""
    turning = (
        RUBBING.replace("frequency = ", "engine_order = 3 #") + "\n[rotation]\nspeed_rpm=60.0\n"
    )
    scene = parse(turning)

    def frequency(*overrides: str) -> float | None:
        table = override_table(scene_table(scene), overrides, "scene")
        return parse_scene(table, "scene", None).loads[0].frequency

    assert frequency() == 3.0
    assert frequency("rotation.speed_rpm=-120.0") == 6.0
    assert frequency("loads.0.frequency=5.0", "rotation.speed_rpm=120.0") == 5.0
    assert frequency("loads.0.frequency=5.0", "loads.0.engine_order=2") == 2.0
    assert scene.loads[0].changed(force=2.0).at_speed(120.0).frequency == 6.0
    assert scene.loads[0].changed(frequency=5.0).at_speed(120.0).frequency == 5.0
    turned = scene.at_speed(120.0)
    assert turned.rotation.speed_rpm == 120.0 and turned.loads[0].frequency == 6.0
    assert scene.at_speed(0.0).loads == scene.loads
    assert pickle.loads(pickle.dumps(scene)).at_speed(120.0).loads[0].frequency == 6.0


def test_missing_keys_get_their_defaults() -> None:
    scene, decay = parse(RUBBING), parse(DECAY)
    geometry, output = scene.geometry, scene.output
    assert (geometry.cells, geometry.degree, geometry.plane) == ("structured", 2, "stress")
    assert scene.geometrically_nonlinear and not geometry.curved
    assert scene.loads[0].place == Place(group="load", at="mean")
    assert scene.loads[0].history == Harmonic(frequency=3.2)
    assert (scene.basis.differentiation, scene.basis.elastic_force) == ("exact", "polynomial")
    assert scene.time == Time.of(
        scheme="discrete-gradient", steps_per_period=200, periods=100, steady_tolerance=1e-5
    )
    assert (output.pictures, output.paraview, output.motion) == (True, True, False)
    geometry = decay.geometry
    assert (geometry.cells, geometry.plane, geometry.thickness) == (None, None, None)
    assert decay.period is None and decay.probe == Place(node=(1.0, 0.0, 0.0))
    assert decay.time == Time.of(
        scheme="generalised-alpha", spectral_radius=0.8, duration=1.0, step=1e-3
    )
    assert decay.reference.beam and decay.reference.beam_section == BeamSection(
        length=1.0, height=0.1, width=0.2, elements=20, load_at=1.0
    )


def test_tolerance_replaces_steps_per_period() -> None:
    time = parse(RUBBING, "time.tolerance=1e-4").time
    assert (time.tolerance, time.steps_per_period) == (1e-4, None)


def test_vectors_are_scaled_to_unit_length() -> None:
    scene = parse(RUBBING)
    assert scene.loads[0].direction == (0.0, 1.0)
    assert scene.contacts[0].normal == pytest.approx((math.sqrt(0.5), math.sqrt(0.5)), rel=1e-15)
    for size in ("5e-324", "1e-300", "1e300"):
        assert parse(RUBBING, f"contacts.0.normal=[{size}, -{size}]").contacts[
            0
        ].normal == pytest.approx((math.sqrt(0.5), -math.sqrt(0.5)), rel=1e-15)


def test_unit_vector_is_unchanged_to_the_bit() -> None:
    once = (
        parse(RUBBING, "contacts.0.normal=[1, 24]").contacts[0].normal
    )  # dividing again changes the last bit
    assert parse(RUBBING, f"contacts.0.normal={list(once)}").contacts[0].normal == once


def test_period_is_that_of_the_lowest_frequency() -> None:
    first = '{group="load", direction=[0,1], force=1.0, frequency=9.6}'
    scene = parse(
        RUBBING, f'loads=[{first}, {{group="tip", direction=[1,0], force=1, frequency=3.2}}]'
    )
    assert scene.period == 1 / 3.2
    harmonic = parse(RUBBING, f'loads=[{first}, {{group="tip", direction=[1,0], force=5.0}}]')
    assert harmonic.period == 1 / 9.6 and harmonic.loads[1].frequency is None
    other = f'loads=[{first}, {{group="tip", direction=[1,0], force=1, frequency=3.3}}]'
    assert refused(RUBBING, other) == (ErrorKind.CONFLICT, "loads[0].frequency")


@pytest.mark.parametrize(
    ("label", "same"),
    [("1V1S", "1V1S"), ("1S1V", "1V1S"), ("2V1V", "1V2V"), ("1S3V", "3V1S"), ("2S1S", "1S2S")],
)
def test_label_of_derivative_is_in_canonical_order(label: str, same: str) -> None:
    assert parse(RUBBING, f'basis.derivatives=["{label}"]').basis.derivatives == (same,)


def test_mesh_beside_the_scene_comes_first(tmp_path: Path) -> None:
    (tmp_path / "s.toml").write_text(RUBBING)
    assert (
        read_scene(tmp_path / "s.toml").geometry.mesh == (shared_meshes() / "beam2d.geo").resolve()
    )
    (tmp_path / "beam2d.geo").touch()
    assert read_scene(str(tmp_path / "s.toml")).geometry.mesh == (tmp_path / "beam2d.geo").resolve()
    assert parse(RUBBING, folder=None).geometry.mesh == Path("beam2d.geo")


def test_byte_order_mark_is_accepted(tmp_path: Path) -> None:
    (tmp_path / "s.toml").write_text(RUBBING, encoding="utf-8-sig")
    assert read_scene(tmp_path / "s.toml").material.poisson == 0.28


def test_largest_and_smallest_size_are_accepted() -> None:
    scene = parse(RUBBING, f"material.young={LARGEST}", f"material.density={SMALLEST}")
    assert (scene.material.young, scene.material.density) == (LARGEST, SMALLEST)


# Overrides


def test_overrides_replace_values_and_make_tables() -> None:
    table = tomllib.loads(RUBBING)
    before = copy.deepcopy(table)
    overrides = [
        "loads.0.force=200",
        "contacts[0].friction = 0.2",
        'time.scheme="average-acceleration"',
    ]
    changed = override_table(
        table, [*overrides, "geometry.parameters.length=3", 'title="a=b"'], "s.toml"
    )
    assert table == before
    scene = parse_scene(changed, "s.toml", None)
    assert (scene.loads[0].size, scene.contacts[0].friction) == (200.0, 0.2)
    assert (scene.time.scheme, scene.title) == ("average-acceleration", "a=b")
    assert scene.geometry.parameters == {"length": 3.0}


@pytest.mark.parametrize(
    "override",
    [
        "force",
        "=1",
        "loads..force=1",
        "basis.method=rubin",
        "title=",
        "title=" + 5000 * "9",
        "title=1\nbasis=2",
        "loads.1.force=1",
        "loads.force=1",
        "material.young.mean=1",
    ],
)
def test_override_without_place_or_value_is_refused(override: str) -> None:
    with refusal(ErrorKind.FORMAT, override.partition("=")[0], names="s.toml: override "):
        parse(RUBBING, override)


def test_override_of_time_removes_what_it_excludes() -> None:
    assert parse(DECAY, "time.tolerance=1e-3").time == Time.of(
        scheme="generalised-alpha", spectral_radius=0.8, duration=1.0, tolerance=1e-3
    )
    steps = parse(RUBBING, "time={periods=7, tolerance=0.1}", "time.steps_per_period=100").time
    assert (steps.periods, steps.steps_per_period, steps.tolerance) == (7, 100, None)


# What is refused


@pytest.mark.parametrize(
    ("text", "override", "kind", "key"),
    [
        (RUBBING, "loads.0.force=0x" + 9999 * "f", ErrorKind.RANGE, "loads[0].force"),
        (RUBBING, 'geometry.mesh="a.msh"', ErrorKind.CONFLICT, "geometry.parameters"),
        (DECAY, 'geometry.plane="stress"', ErrorKind.CONFLICT, "geometry.plane"),
        (DECAY, 'geometry.cells="simplex"', ErrorKind.CONFLICT, "geometry.cells"),
        (DECAY, "loads=[]", ErrorKind.MISSING, "probe"),
    ],
)
def test_mistake_names_kind_and_key(text: str, override: str, kind: ErrorKind, key: str) -> None:
    """Those of tables are in test_mistakes.py."""
    assert refused(text, override) == (kind, key)


CASING = RUBBING.replace(
    "normal = [1.0, 1.0]", 'surface = { kind = "cylinder", point = [0.0, 0.0] }'
)


@pytest.mark.parametrize(
    ("order", "surface", "key"),
    [
        (1, "waves=[[2, 1e-5, 0]]", None),
        (2, "waves=[[2, 1e-5, 0]]", None),
        (2, "waves=[[4, 1e-5, 0], [3, 0, 0]]", None),
        (3, "waves=[[2, 1e-5, 0]]", "contacts[0].surface.waves"),
        (2, "waves=[[4, 1e-5, 0], [3, 1e-5, 0]]", "contacts[0].surface.waves"),
    ],
)
def test_waves_of_turning_surface_repeat_in_the_period_of_the_loads(
    order: int, surface: str, key: str | None
) -> None:
    """Else Newton's method took a third of a revolution for the period of such a motion."""
    text = CASING.replace("frequency =", f"engine_order = {order} #")
    turns = "rotation={speed_rpm=3000.0, point=[0, 0]}", f"contacts.0.surface.{surface}"
    scene = parse(text, *turns)
    if key is None:
        require_repeating(scene)
    else:
        with refusal(ErrorKind.RANGE, key):
            require_repeating(scene)


TURNING = "rotation={speed_rpm=3000.0, point=[0, 0]}"
LOBES = "contacts.0.surface.waves=[[2, 1e-5, 0]]"
SPINNING = "contacts.0.surface={kind='cylinder', point=[0, 0], spin=100.0, waves=[[2, 1e-5, 0]]}"


@pytest.mark.parametrize(
    ("overrides", "period"),
    [
        ((TURNING, LOBES), 0.02),
        ((TURNING, LOBES, "loads=[{group='tip', direction=[0, 1], force=1.0}]"), 0.02),
        ((TURNING, LOBES, "time={duration=1.0, step=1e-4}"), None),
        ((SPINNING,), 2.0 * math.pi / 100.0),
    ],
)
def test_lobes_excite_a_scene_without_a_load_that_varies(
    overrides: tuple[str, ...], period: float | None
) -> None:
    scene = parse(CASING, "loads=[]", "time={}", *overrides)
    assert scene.period == pytest.approx(period)
    assert scene.time.steps_per_period == (200 if period else None)


def test_scene_without_waves_and_loads_needs_a_duration() -> None:
    flat = "contacts.0.surface.waves=[[2, 0.0, 0]]"
    assert refused(CASING, "loads=[]", "time={}", TURNING, flat)[1] == "time.duration"


def test_scene_for_its_modes_needs_no_times() -> None:
    impact = "loads=[{group='tip', direction=[0, 1], force=1.0, pulse={duration=0.1}}]"
    table = override_table(tomllib.loads(CASING), ("time={}", impact), "test")
    assert parse_scene(table, "test", None, unloaded=True).period is None
    with pytest.raises(SceneError) as caught:
        parse_scene(table, "test", None)
    assert caught.value.key.startswith("time.")


def test_cylinder_in_3d_needs_axis_and_sphere_has_no_waves() -> None:
    solid = {"mesh": "beam3d.geo", "dimension": 3}
    table: Any = tomllib.loads(CASING) | {"geometry": solid}
    table["loads"][0]["direction"] = [0.0, 1.0, 0.0]
    surface = {"point": [0.0, 0.0, 0.0]}
    for more, kind, name in (
        ({"kind": "cylinder"}, ErrorKind.MISSING, "axis"),
        ({"kind": "sphere", "waves": [[2, 1e-4, 0.0]]}, ErrorKind.CONFLICT, "waves"),
        ({"kind": "sphere", "spin": 1.0}, ErrorKind.CONFLICT, "spin"),
        ({"kind": "sphere", "angle_from": [1.0, 0.0, 0.0]}, ErrorKind.CONFLICT, "angle_from"),
        (
            {"kind": "cylinder", "axis": [0.0, 1.0, 0.0], "angle_from": [0.0, -2.0, 0.0]},
            ErrorKind.RANGE,
            "angle_from",
        ),
    ):
        table["contacts"][0]["surface"] = surface | more
        with refusal(kind, f"contacts[0].surface.{name}"):
            parse_scene(table, "s.toml", None)


REQUIRED = ["geometry", "geometry.dimension", "geometry.thickness", "material.young", "supports"]
REQUIRED += ["supports.0.group", "loads.0.direction", "loads.0.force", "contacts.0.friction"]


@pytest.mark.parametrize("key", REQUIRED)
def test_missing_required_key_is_named(key: str) -> None:
    table: Any = tomllib.loads(RUBBING)
    *way, last = [int(name) if name.isdigit() else name for name in key.split(".")]
    branch = table
    for name in way:
        branch = branch[name]
    del branch[last]
    shown = key.replace(".0", "[0]")
    with refusal(ErrorKind.MISSING, shown):
        parse_scene(table, "s.toml", None)


def test_missing_mesh_names_the_folders(tmp_path: Path) -> None:
    for name in ("none.geo", "/none.geo", f"{'x' * 5000}.geo"):
        with refusal(ErrorKind.FILE, "geometry.mesh") as caught:
            parse(RUBBING, f'geometry.mesh="{name}"', folder=tmp_path)
        assert (str(tmp_path) in str(caught.value)) != name.startswith("/")


def test_unreadable_file_is_refused(tmp_path: Path) -> None:
    def kind(path: Path) -> ErrorKind:
        with pytest.raises(SceneError) as caught:
            read_scene(path)
        assert str(caught.value).startswith(f"{path}: ") and str(caught.value).isprintable()
        return caught.value.kind

    scene = tmp_path / "s.toml"
    assert kind(scene) == kind(tmp_path) == ErrorKind.FILE
    for content, expected in (
        (b"[geometry]\nmesh = \n", ErrorKind.FORMAT),
        (b"\xff\xfe", ErrorKind.FORMAT),
        (b"x = " + 5000 * b"9", ErrorKind.FORMAT),
        (50 * b"a." + b"a = 1", ErrorKind.UNKNOWN_KEY),
    ):
        scene.write_bytes(content)
        assert kind(scene) == expected


def test_control_characters_do_not_reach_the_message() -> None:
    for override in (r'title=["\u001b[31m"]', '"a\x1b"=1', r'basis.method="\u001b]0;x\u0007"'):
        with pytest.raises(SceneError) as caught:
            parse(RUBBING, override)
        assert str(caught.value).isprintable()


# Alternatives


def test_load_keys_choose_action_and_history() -> None:
    load = Load.of(group="tip", direction=[0, 2], force=3, frequency=2.0, phase=0.5)
    assert (load.kind, load.size, load.direction) == ("force", 3.0, (0.0, 1.0))
    assert load.history == Harmonic(frequency=2.0, phase=0.5)
    assert shortest_period(load.changed(pulse={"duration": 0.4})) == 0.8
    series = load.changed(harmonics=[[3, 1.0, 0.0]])
    assert shortest_period(series) == 1.0 / 6.0
    assert shortest_period(series.changed(frequency=1.0)) == 1.0 / 3.0  # the harmonics stay
    with refusal(ErrorKind.CONFLICT, "direction"):
        Load.of(group="tip", pressure=1.0, direction=[0, 1])


def test_zero_phase_of_old_files_is_ignored() -> None:
    assert parse(RUBBING, "loads.0.phase=0.0").loads == parse(RUBBING).loads
    assert parse(DECAY, "loads.0.phase=0.0").loads == parse(DECAY).loads


def test_scene_made_in_python_equals_scene_from_file() -> None:
    table = tomllib.loads(RUBBING) | {"geometry": {"mesh": "beam3d.geo", "dimension": 3}}
    table["loads"][0]["direction"] = table["contacts"][0]["normal"] = [0.0, 1.0, 0.0]
    expected = parse_scene(table, "scene", Path())
    made: dict[str, Any] = {
        "loads": [Load.of(**table["loads"][0])],
        "time": Time.of(periods=100, steps_per_period=200),
        "material": expected.material,
    }
    assert make_scene(**(table | made)) == expected
    made["material"] = dataclasses.replace(expected.material, young=-1.0)
    with refusal(ErrorKind.RANGE, "material.young"):
        make_scene(**(table | made))


# JSON schema and reference


@pytest.mark.parametrize("path", DEMOS, ids=lambda path: path.stem)
def test_demo_is_valid_under_the_json_schema_and_survives_json_and_toml(path: Path) -> None:
    jsonschema = pytest.importorskip("jsonschema")
    validator = jsonschema.Draft202012Validator(json_schema())
    table = tomllib.loads(path.read_text(encoding="utf-8"))
    validator.validate(table)
    table["material"]["yung"] = 1.0
    assert not validator.is_valid(table)
    scene = read_scene(path)
    assert parse_scene(json.loads(json.dumps(scene_table(scene))), scene.source, HERE) == scene
    assert parse_scene(tomllib.loads(toml_text(scene_table(scene))), scene.source, None) == scene


def test_json_schema_describes_every_key() -> None:
    def check(schema: Any) -> int:
        properties = schema.get("properties", {})
        count = len(properties)
        for entry in properties.values():
            assert entry["description"] and not entry["description"].startswith("[")
            for inner in (entry, entry.get("items", {}), *entry.get("oneOf", [])):
                count += check(inner)
        return count

    schema = json_schema()
    assert check(schema) > 100
    json.dumps(schema, allow_nan=False)
    load = schema["properties"]["loads"]["items"]["properties"]
    assert {"force", "engine_order", "pulse", "group"} <= set(load)


def test_reference_pages_are_current_and_show_each_table_once() -> None:
    shown, rows = list[str](), dict[str, str]()
    for path in sorted((Path(__file__).parents[2] / "demos").glob("keys*.md")):
        page = path.read_text(encoding="utf-8")
        assert reference.replaced(page, rows) == page, path.name
        shown += reference.covered(page)
    tables = [name for name, rule, *_ in keys(Scene) if table_kind(rule) is not None]
    assert sorted(shown) == sorted(["scene", *tables])
    assert "| `steps_per_period` |" in reference.reference(["time"])
    assert "`density`: as in `[material]`." in reference.reference(["material", "materials"])


# Whatever comes in, a scene or one sentence comes out


def scene_or_error(table: Any) -> Scene | None:
    try:
        scene = parse_scene(table, "s.toml", None)
    except SceneError as error:
        assert str(error).startswith("s.toml: ") and str(error).isprintable()
        return None
    assert (
        parse_scene(json.loads(json.dumps(scene_table(scene), allow_nan=False)), "s.toml", None)
        == scene
    )
    return scene


NUMBERS = (
    st.sampled_from([0, 1, 2, 3, -1, 0.5, 1e-300, 1e300, 10**400])
    | st.integers()
    | st.floats()
    | st.floats(0.01, 10.0)
)
# all that UTF-8 can write; st.text() alone would first encode every character there is
CHARACTERS = st.characters(exclude_categories=["Cs"])
WORDS = st.text(CHARACTERS, max_size=8) | st.sampled_from(
    "root mean centre all 1V1V 1V2S 9S9S simplex strain a.geo generalised-alpha \0\n".split(" ")
)
KEYS = st.text(CHARACTERS, max_size=6) | st.sampled_from(
    "group node at frequency phase tolerance duration periods probe beam cells plane traction "
    "pressure acceleration harmonics sweep pulse table".split()
)
VALUES = st.recursive(
    NUMBERS | WORDS | st.booleans() | st.none() | st.dates(),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(KEYS, inner, max_size=3),
    max_leaves=6,
)
ALIKE = {
    kind: alike | alike | VALUES
    for kind, alike in (
        (float, NUMBERS),
        (int, NUMBERS),
        (str, WORDS),
        (bool, st.booleans()),
        (None, VALUES),
    )
}
"""What replaces a value, by its type: two in three are of the same type."""


def examples(number: int) -> settings:
    """Settings of hypothesis: this many examples, without a time limit."""
    return settings(
        max_examples=number, deadline=None, suppress_health_check=[HealthCheck.too_slow]
    )


def branches(node: Any) -> list[Any]:
    """All tables and lists of a table, outermost first."""
    below = node.values() if isinstance(node, dict) else node
    return [
        node,
        *(
            branch
            for entry in below
            if isinstance(entry, dict | list)
            for branch in branches(entry)
        ),
    ]


@st.composite
def mutants(draw: st.DrawFn) -> Any:
    """A valid table with one to three entries replaced, deleted or added."""
    table = tomllib.loads(
        draw(st.sampled_from([RUBBING, DECAY, *(path.read_text() for path in DEMOS)]))
    )
    for _ in range(draw(st.integers(1, 3))):
        branch = draw(st.sampled_from(branches(table)))
        places = list(branch) if isinstance(branch, dict) else list(range(len(branch)))
        action = draw(st.sampled_from(["replace", "delete", "add"] if places else ["add"]))
        if action == "replace":
            place = draw(st.sampled_from(places))
            branch[place] = draw(ALIKE.get(type(branch[place]), ALIKE[None]))
        elif action == "delete":
            del branch[draw(st.sampled_from(places))]
        elif isinstance(branch, dict):
            branch[draw(KEYS)] = draw(VALUES)
        else:
            branch.append(draw(VALUES))
    return table


@pytest.mark.slow
@examples(400)
@given(mutants())
def test_mutated_table_gives_scene_or_error(table: Any) -> None:
    scene_or_error(table)


@examples(100)
@given(st.data())
def test_any_text_gives_scene_or_error(
    tmp_path_factory: pytest.TempPathFactory, data: st.DataObject
) -> None:
    text = data.draw(st.sampled_from([RUBBING, DECAY]))
    begin = data.draw(st.integers(0, len(text)))
    end = data.draw(st.integers(begin, min(len(text), begin + 20)))
    noise = data.draw(
        st.text(CHARACTERS, max_size=10) | st.text("[]{}=.,\"'#\n\r0123456789eE-+_ ", max_size=10)
    )
    path = tmp_path_factory.getbasetemp() / "mutated.toml"
    path.write_bytes((text[:begin] + noise + text[end:]).encode("utf-8", "surrogatepass"))
    try:
        assert isinstance(read_scene(path), Scene)
    except SceneError as error:
        assert str(error).startswith(f"{path}: ") and str(error).isprintable()


@examples(60)
@given(
    st.text(CHARACTERS, max_size=20)
    | st.builds(
        "{}={}".format, st.text("loads.[0]forceab", max_size=15), st.text(CHARACTERS, max_size=5)
    )
)
def test_any_override_gives_scene_or_error(override: str) -> None:
    try:
        scene_or_error(override_table(tomllib.loads(RUBBING), [override], "s.toml"))
    except SceneError as error:
        assert str(error).startswith("s.toml: override ") and str(error).isprintable()


@examples(200)
@given(
    st.lists(st.floats(allow_nan=False, allow_infinity=False), min_size=2, max_size=2).filter(any)
)
@pytest.mark.slow
def test_directions_have_unit_length_and_survive_the_round_trip(vector: list[float]) -> None:
    table = tomllib.loads(RUBBING)
    table["contacts"][0]["normal"] = vector
    scene = scene_or_error(table)
    assert scene is not None
    (normal,) = (contact.normal for contact in scene.contacts)
    assert abs(math.hypot(*normal) - 1.0) <= 1e-14
    largest = max(map(abs, vector))
    assert normal[0] * (vector[1] / largest) == pytest.approx(
        normal[1] * (vector[0] / largest), rel=1e-12, abs=1e-300
    )


def test_numbers_and_arrays_of_numpy_are_accepted() -> None:
    table = tomllib.loads(RUBBING)
    plain = make_scene(**table)
    table["material"]["young"] = np.float32(207e9)
    table["geometry"]["dimension"] = np.int64(2)
    table["loads"][0]["direction"] = np.array([0.0, 2.0])
    table["loads"][0]["force"] = np.array(100)
    found = make_scene(**table)
    assert found.loads == plain.loads and found.geometry == plain.geometry
    assert found.material.young == float(np.float32(207e9))
    keys = {"group": "load", "force": np.int64(100), "frequency": np.float64(3.2)}
    assert Load.of(**keys, direction=np.array([0, 2])) == plain.loads[0]


def with_value(path: tuple[str | int, ...], value: Any) -> dict[str, Any]:
    """The table of RUBBING with another value at a path."""
    table: Any = tomllib.loads(RUBBING)
    branch = table
    for name in path[:-1]:
        branch = branch.setdefault(name, {}) if isinstance(branch, dict) else branch[name]
    if value is None:
        del branch[path[-1]]
    else:
        branch[path[-1]] = value
    return dict(table)


FIRST_LOAD = ("loads", 0)


@pytest.mark.parametrize(
    ("path", "value", "accepted"),
    [
        ((*FIRST_LOAD, "harmonics"), [[2, 1.0, 0.0]], True),
        ((*FIRST_LOAD, "harmonics"), [[0, 1.0, 0.0]], False),
        ((*FIRST_LOAD, "harmonics"), [[1.5, 1.0, 0.0]], False),
        (("basis", "derivatives"), ["1V1V"], True),
        (("basis", "derivatives"), ["0V1V"], False),
        (("basis", "derivatives"), ["1V1V", "1V1V"], False),
        (("compare", "modes"), [1, 1], False),
        (
            ("loads",),
            [
                {
                    "acceleration": 1.0,
                    "direction": [0, 1],
                    "frequency": 3.0,
                    "harmonics": [[1, 1, 0]],
                }
            ],
            True,
        ),
        (FIRST_LOAD, {"group": "load", "direction": [0, 1], "force": 1.0, "phase": 0}, True),
        (FIRST_LOAD, {"group": "load", "direction": [0, 1], "force": 1.0, "phase": False}, False),
    ],
)
def test_schema_and_reader_agree(path: tuple[str | int, ...], value: Any, accepted: bool) -> None:
    jsonschema = pytest.importorskip("jsonschema")
    table = with_value(path, value)
    if path[0] == "loads" and not any("frequency" in load for load in table["loads"]):
        table["time"] = {"duration": 1.0, "step": 0.01}
    assert jsonschema.Draft202012Validator(json_schema()).is_valid(table) == accepted
    try:
        parse_scene(table, "test", Path.cwd())
        read = True
    except SceneError:
        read = False
    assert read == accepted


def test_step_of_a_tenth_of_the_period_of_load_is_the_longest() -> None:
    """A load with a sweep does not repeat, so that the step is fixed: 0.04 s for 2.5 Hz."""
    sweep = "loads.0.sweep={to=2.5, duration=1.0}"
    frequency = "loads.0.frequency=2.0"
    assert parse(RUBBING, sweep, frequency, "time={duration=1.0, step=0.04}").time.step == 0.04
    long = refused(RUBBING, sweep, frequency, "time={duration=1.0, step=0.041}")
    assert long == (ErrorKind.CONFLICT, "time.step")


def test_shortest_period_of_harmonics_is_that_of_the_highest_order() -> None:
    load = Load.of(
        group="tip",
        direction=[0, 1],
        force=1,
        frequency=2.0,
        harmonics=[[3, 1.0, 0.0], [1, 1.0, 0.0]],
    )
    assert shortest_period(load) == pytest.approx(1.0 / 6.0, rel=1e-15)


def test_default_steady_tolerance_is_at_least_the_tolerance_of_the_step() -> None:
    assert parse(RUBBING).time.steady_tolerance == 1e-5
    assert parse(RUBBING, "time.tolerance=1e-3").time.steady_tolerance == 1e-3
    assert parse(RUBBING, "time.tolerance=1e-7").time.steady_tolerance == 1e-5


@pytest.mark.parametrize(
    ("name", "allowed"),
    [("frequency", False), ("contacts.0.normal_stiffness", False), ("contacts.0.friction", True)],
)
def test_curve_starts_at_zero_only_where_zero_is_allowed(name: str, allowed: bool) -> None:
    override = f"response={{parameter='{name}', first=0.0, last=2.0}}"
    if allowed:
        assert parse(RUBBING, override).response is not None
    else:
        assert refused(RUBBING, override) == (ErrorKind.RANGE, "response.first")


def test_frequency_that_is_almost_a_multiple_is_refused() -> None:
    second = {"group": "tip", "direction": [0, 1], "force": 1.0}
    table = tomllib.loads(RUBBING)
    first = table["loads"][0]
    for ratio, allowed in ((2.0 + 1e-10, True), (2.0 + 1e-6, False)):
        table["loads"] = [first, {**second, "frequency": first["frequency"] * ratio}]
        if allowed:
            assert parse_scene(table, "test", None).period == 1.0 / first["frequency"]
            continue
        with refusal(ErrorKind.CONFLICT, "loads[1].frequency"):
            parse_scene(table, "test", None)


def test_toml_text_holds_every_kind_of_value() -> None:
    table = {
        "text": 'a "b"\\\n\x7f é',
        "flag": True,
        "small": 1e-300,
        "odd key": [[1, 2.5], []],
        "table": {"inner": {"a": 1}, "none": {}},
        "list": [{"a": {"b": [1]}}, {}],
    }
    assert tomllib.loads(toml_text(table)) == table
    with pytest.raises(TypeError):
        toml_text({"a": None})


def test_heading_follows_overrides() -> None:
    path = next(path for path in DEMOS if path.stem == "slip_liftoff_2d")
    assert scene_heading(read_scene(path)) == "slip and lift-off, 40 N, 3.2 Hz"
    changed = read_scene(path, ["loads[0].frequency=3.1", "basis.modes=2"])
    assert scene_heading(changed) == "slip and lift-off, 40 N, 3.1 Hz, basis.modes = 2"
    table = override_table(scene_table(changed), "basis.modes=1", "s")
    again = parse_scene(titled(table, "basis.modes=1", "s"), "s", None)
    assert scene_heading(again) == "slip and lift-off, 40 N, 3.1 Hz, basis.modes = 1"
    own = read_scene(path, ["title='{not.a.key} {x}'"])
    assert scene_heading(own) == "{not.a.key} {x}"


@pytest.mark.parametrize(
    "override", ["loads.0.pulse={duration=0.05}", "loads.0.table=[[0, 0], [1, 1]]"]
)
def test_override_of_history_removes_the_one_before(override: str) -> None:
    """As the scene of a stored model, which names every default."""
    table = scene_table(parse(RUBBING))
    assert "frequency" in table["loads"][0] and "steps_per_period" in table["time"]
    for order in (1, -1):
        changes = [override, "time.duration=1.0", "time.step=1e-2"][::order]
        scene = parse_scene(override_table(table, changes, "test"), "test", None)
        assert scene.loads[0].transient and scene.loads[0].frequency is None
        assert (scene.time.duration, scene.time.step) == (1.0, 1e-2)
        assert "frequency" in table["loads"][0] and "steps_per_period" in table["time"]

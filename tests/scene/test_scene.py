"""Scenes: every demo is one, every mistake gets its sentence, nothing else ever comes out."""

from __future__ import annotations

import copy
import dataclasses
import json
import math
import tomllib
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from fenicsrom.errors import SceneError
from fenicsrom.scene import (
    BeamSection,
    Material,
    Place,
    Scene,
    Time,
    override_table,
    parse_scene,
    read_scene,
    scene_table,
)
from fenicsrom.scene.paths import shared_meshes

DEMOS = sorted((Path(__file__).parents[2] / "demos").glob("*.toml"))
PAPER = ("open_2d", "slip_liftoff_2d", "slip_liftoff_3d", "stick_slip_2d", "high_load_2d")

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


def refused(text: str, *overrides: str, folder: Path | None = None) -> str:
    with pytest.raises(SceneError) as caught:
        parse(text, *overrides, folder=folder)
    return str(caught.value)


# What is read


def test_an_engine_order_is_a_multiple_of_the_speed() -> None:
    gyroscopic_matrix = (
        RUBBING.replace("frequency = ", "engine_order = 3 #")
        + "\n[rotation]\nspeed_rpm = -1200.0\n"
    )
    scene = parse(gyroscopic_matrix)
    assert scene.loads[0].frequency == 60.0 and scene.period == 1.0 / 60.0
    assert parse_scene(scene_table(scene), scene.source, None).loads == scene.loads
    still = gyroscopic_matrix.replace("-1200.0", "0.0")
    for text in (RUBBING.replace("frequency = ", "engine_order = 3 #"), still):
        assert (
            refused(text)
            == "s.toml: loads[0].engine_order = 3: must not be given in a scene that does not turn"
        )
    both = (
        RUBBING.replace("frequency = ", "engine_order = 3\nfrequency = ")
        + "\n[rotation]\nspeed_rpm = 1200.0\n"
    )
    assert (
        refused(both)
        == "s.toml: loads[0].engine_order = 3: must not be given together with frequency"
    )


def test_the_demos_are_the_papers_cases() -> None:
    assert {path.stem for path in DEMOS} >= set(PAPER)
    scenes = {path.stem: read_scene(path) for path in DEMOS if path.stem in PAPER}
    # name: force, frequency, preload, full model asked for
    cases = {
        "open_2d": (111.29, 3.2, None, True),
        "slip_liftoff_2d": (111.29, 3.2, 40.0, True),
        "slip_liftoff_3d": (111.29, 3.2, 40.0, False),
        "stick_slip_2d": (111.29, 8.1, 250.0, True),
        "high_load_2d": (333.3, 3.2, 200.0, True),
    }
    for name, (force, frequency, preload, full) in cases.items():
        scene = scenes[name]
        dimension = 3 if name.endswith("3d") else 2
        (load,) = scene.loads
        assert scene.geometry.dimension == dimension
        assert scene.geometry.mesh == (shared_meshes() / f"beam{dimension}d.geo").resolve()
        assert scene.geometry.thickness == (0.0254 if dimension == 2 else None)
        assert (
            scene.geometry.parameters["length"] == 2.54
            and scene.geometry.parameters["load_at"] == 0.7
        )
        assert scene.material == Material(
            young=207e9, poisson=0.28, density=7801.0, mass_damping=5.0
        )
        assert (load.force, load.frequency, load.place) == (
            force,
            frequency,
            Place(group="load", at="centre"),
        )
        assert load.direction == (0.0, 1.0, 0.0)[:dimension]
        assert scene.period == 1 / frequency
        assert scene.reference.full is full
        assert scene.reference.beam == BeamSection(
            length=2.54, height=0.0254, width=0.0254, load_at=0.7
        )
        assert (scene.basis.method, scene.basis.modes, scene.basis.derivatives) == (
            "rubin",
            3,
            "mmi-nls",
        )
        assert scene.basis.threshold == 1e-4
        assert scene.time.steps_per_period == (500 if name == "stick_slip_2d" else 200)
        if preload is None:
            assert scene.contacts == () and scene.probe == Place(group="tip", at="centre")
        else:
            (contact,) = scene.contacts
            assert contact.place == Place(group="tip", at="centre")
            assert contact.normal == (1.0, 0.0, 0.0)[:dimension]
            assert (contact.preload, contact.gap, contact.friction) == (preload, 0.0, 0.5)
            assert (contact.normal_stiffness, contact.tangential_stiffness) == (1e4, 1e4)


@pytest.mark.parametrize("path", DEMOS, ids=lambda path: path.stem)
def test_the_linear_variant_of_a_demo_is_one_key(path: Path) -> None:
    linear = read_scene(path, ["geometrically_nonlinear=false"])
    assert linear == dataclasses.replace(read_scene(path), geometrically_nonlinear=False)


def test_defaults_are_filled_in() -> None:
    scene = parse(RUBBING)
    assert (scene.title, scene.geometrically_nonlinear, scene.source) == ("", True, "s.toml")
    assert (scene.geometry.cells, scene.geometry.degree, scene.geometry.plane) == (
        "structured",
        2,
        "stress",
    )
    assert scene.geometry.curved is False and scene.material.mass_damping == 0.0
    assert scene.loads[0].place == Place(group="load", at="mean") and scene.loads[0].phase == 0.0
    assert scene.contacts[0].gap == 0.0 and scene.probe is None
    assert (scene.basis.differentiation, scene.basis.elastic_force) == ("exact", "polynomial")
    assert scene.time == Time(
        scheme="discrete-gradient",
        steps_per_period=200,
        periods=100,
        steady_tolerance=1e-5,
    )
    assert scene.reference.full is False and scene.reference.beam is None
    assert (scene.output.pictures, scene.output.paraview, scene.output.motion) == (
        True,
        True,
        False,
    )
    assert isinstance(scene.loads[0].force, float) and isinstance(
        scene.geometry.parameters["length"], float
    )

    decay = parse(DECAY)
    assert (decay.geometry.cells, decay.geometry.plane, decay.geometry.thickness) == (
        None,
        None,
        None,
    )
    assert decay.period is None and decay.probe == Place(node=(1.0, 0.0, 0.0))
    assert decay.time == Time(
        scheme="generalised-alpha", spectral_radius=0.8, duration=1.0, step=1e-3
    )
    assert decay.reference.beam == BeamSection(
        length=1.0, height=0.1, width=0.2, elements=20, load_at=1.0
    )
    assert parse(DECAY, "reference.beam=false").reference.beam is None


def test_a_tolerance_replaces_the_steps_per_period() -> None:
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


def test_a_unit_vector_is_left_alone_to_the_bit() -> None:
    once = (
        parse(RUBBING, "contacts.0.normal=[1, 24]").contacts[0].normal
    )  # dividing again changes the last bit
    assert parse(RUBBING, f"contacts.0.normal={list(once)}").contacts[0].normal == once


def test_the_period_is_that_of_the_lowest_frequency() -> None:
    first = '{group="load", direction=[0,1], force=1.0, frequency=9.6}'
    scene = parse(
        RUBBING, f'loads=[{first}, {{group="tip", direction=[1,0], force=1, frequency=3.2}}]'
    )
    assert scene.period == 1 / 3.2
    harmonic = parse(RUBBING, f'loads=[{first}, {{group="tip", direction=[1,0], force=5.0}}]')
    assert harmonic.period == 1 / 9.6 and harmonic.loads[1].frequency is None
    sentence = refused(
        RUBBING, f'loads=[{first}, {{group="tip", direction=[1,0], force=1, frequency=3.3}}]'
    )
    assert (
        sentence
        == "s.toml: loads[0].frequency = 9.6: must be an integer multiple of the lowest frequency, 3.3"
    )


@pytest.mark.parametrize(
    ("label", "same"),
    [("1V1S", "1V1S"), ("1S1V", "1V1S"), ("2V1V", "1V2V"), ("1S3V", "3V1S"), ("2S1S", "1S2S")],
)
def test_a_derivative_has_one_label(label: str, same: str) -> None:
    assert parse(RUBBING, f'basis.derivatives=["{label}"]').basis.derivatives == (same,)


def test_the_mesh_is_looked_for_beside_the_scene_first(tmp_path: Path) -> None:
    (tmp_path / "s.toml").write_text(RUBBING)
    assert (
        read_scene(tmp_path / "s.toml").geometry.mesh == (shared_meshes() / "beam2d.geo").resolve()
    )
    (tmp_path / "beam2d.geo").touch()
    assert read_scene(str(tmp_path / "s.toml")).geometry.mesh == (tmp_path / "beam2d.geo").resolve()
    assert parse(RUBBING, folder=None).geometry.mesh == Path("beam2d.geo")


def test_a_file_may_start_with_a_byte_order_mark(tmp_path: Path) -> None:
    (tmp_path / "s.toml").write_text(RUBBING, encoding="utf-8-sig")
    assert read_scene(tmp_path / "s.toml").material.poisson == 0.28


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
    assert (scene.loads[0].force, scene.contacts[0].friction) == (200.0, 0.2)
    assert (scene.time.scheme, scene.title) == ("average-acceleration", "a=b")
    assert scene.geometry.parameters == {"length": 3.0}


@pytest.mark.parametrize(
    ("override", "sentence"),
    [
        ("force", "must be a key, = and a value"),
        ("=1", "must be a key, = and a value"),
        ("loads..force=1", "must be a key, = and a value"),
        ("basis.method=rubin", "the value must be as TOML writes it, text in quotes"),
        ("title=", "the value must be as TOML writes it, text in quotes"),
        ("title=" + 5000 * "9", "the value must be as TOML writes it, text in quotes"),
        ("title=1\nbasis=2", "the value must be as TOML writes it, text in quotes"),
        ("loads.1.force=1", "loads has no entry 1: the only one is 0"),
        ("loads.force=1", "loads has no entry force: the only one is 0"),
        ("material.young.mean=1", "material.young is not a table"),
    ],
)
def test_overrides_that_are_refused(override: str, sentence: str) -> None:
    shown = json.dumps(override)
    shown = shown if len(shown) <= 60 else shown[:59] + "…"
    assert refused(RUBBING, override) == f"s.toml: override {shown}: {sentence}"


# What is refused


@pytest.mark.parametrize(
    ("override", "sentence"),
    [
        # unknown keys
        ("materal={}", "materal = {}: unknown key, did you mean material?"),
        ("material.yung=1.0", "material.yung = 1.0: unknown key, did you mean young?"),
        (
            "contacts.0.frction=0.3",
            "contacts[0].frction = 0.3: unknown key, did you mean friction?",
        ),
        (
            "loads.0.qq=1",
            "loads[0].qq = 1: unknown key, known here are group, box, plane, node, nearest, at, direction, "
            "force, traction, pressure, acceleration, frequency, engine_order, phase, harmonics, sweep, pulse, "
            "table",
        ),
        (
            'source="x"',
            'source = "x": unknown key, known here are title, geometrically_nonlinear, geometry, material, '
            "supports, loads, contacts, rotation, probe, basis, time, reference, output, compare, campbell",
        ),
        # types
        ('material.young="207e9"', 'material.young = "207e9": must be a finite number above 0'),
        ("material.young=true", "material.young = true: must be a finite number above 0"),
        ("basis.modes=3.0", "basis.modes = 3.0: must be an integer from 0 to 1000"),
        ("basis.modes=true", "basis.modes = true: must be an integer from 0 to 1000"),
        ("output.pictures=1", "output.pictures = 1: must be true or false"),
        ("title=1979-05-27", 'title = "1979-05-27": must be a text in quotes'),
        ("geometry.dimension=2.0", "geometry.dimension = 2.0: must be 2 or 3"),
        ("geometry.degree=true", "geometry.degree = true: must be 1 or 2"),
        ("geometry=3", "geometry = 3: must be a table"),
        ("geometry.parameters=3", "geometry.parameters = 3: must be a table of numbers"),
        (
            'loads={group="x"}',
            'loads = {"group": "x"}: must be a list of tables, each headed [[loads]]',
        ),
        ("loads=[1]", "loads[0] = 1: must be a table"),
        ("supports.0.group=7", "supports[0].group = 7: must be a name in quotes"),
        ('supports.0.group=" "', 'supports[0].group = " ": must be a name in quotes'),
        # not a number, infinite, too large for a float
        ("material.density=nan", "material.density = NaN: must be a finite number above 0"),
        ("loads.0.force=inf", "loads[0].force = Infinity: must be a finite number"),
        ("loads.0.force=-inf", "loads[0].force = -Infinity: must be a finite number"),
        (
            "contacts.0.normal=[nan, 1]",
            "contacts[0].normal = [NaN, 1]: must be a list of as many finite numbers as the "
            "dimension",
        ),
        (
            "geometry.parameters.length=nan",
            "geometry.parameters.length = NaN: must be a finite number",
        ),
        (
            "loads.0.force=0x" + 300 * "f",
            "loads[0].force = " + str(16**300 - 1)[:59] + "…: must be a finite number",
        ),
        ("loads.0.force=0x" + 9999 * "f", "loads[0].force = (int): must be a finite number"),
        # ranges
        ("material.young=0", "material.young = 0: must be a finite number above 0"),
        (
            "material.poisson=0.5",
            "material.poisson = 0.5: must be a finite number of at least 0 and below 0.5",
        ),
        (
            "material.poisson=-0.1",
            "material.poisson = -0.1: must be a finite number of at least 0 and below 0.5",
        ),
        (
            "material.mass_damping=-1",
            "material.mass_damping = -1: must be a finite number of at least 0",
        ),
        (
            "contacts.0.normal_stiffness=-1",
            "contacts[0].normal_stiffness = -1: must be a finite number above 0",
        ),
        (
            "contacts.0.tangential_stiffness=0",
            "contacts[0].tangential_stiffness = 0: must be a finite number above 0",
        ),
        (
            "contacts.0.friction=-0.1",
            "contacts[0].friction = -0.1: must be a finite number of at least 0",
        ),
        (
            "contacts.0.preload=-1",
            "contacts[0].preload = -1: must be a finite number of at least 0",
        ),
        ("contacts.0.gap=-1", "contacts[0].gap = -1: must be a finite number of at least 0"),
        ("loads.0.frequency=0", "loads[0].frequency = 0: must be a finite number above 0"),
        ("basis.modes=-1", "basis.modes = -1: must be an integer from 0 to 1000"),
        (
            "basis.threshold=1.5",
            "basis.threshold = 1.5: must be a finite number of at least 0 and of at most 1",
        ),
        (
            "time.steps_per_period=3",
            "time.steps_per_period = 3: must be an integer from 4 to 1000000",
        ),
        ("geometry.thickness=0.0", "geometry.thickness = 0.0: must be a finite number above 0"),
        # choices
        ('basis.method="macneal"', 'basis.method = "macneal": must be "rubin" or "craig-bampton"'),
        (
            'time.scheme="euler"',
            'time.scheme = "euler": must be "average-acceleration" or "generalised-alpha" or '
            '"discrete-gradient"',
        ),
        ('loads.0.at="edge"', 'loads[0].at = "edge": must be "mean" or "centre" or "nodes"'),
        # vectors
        (
            "contacts.0.normal=[0.0, 0]",
            "contacts[0].normal = [0.0, 0]: must have a length above zero",
        ),
        (
            "loads.0.direction=[0, 0, 0]",
            "loads[0].direction = [0, 0, 0]: must have a length above zero",
        ),
        (
            "loads.0.direction=[0, 0, 1]",
            "loads[0].direction = [0.0, 0.0, 1.0]: must have 2 components, as "
            "geometry.dimension says",
        ),
        (
            "contacts.0.normal=[0, 1, 0]",
            "contacts[0].normal = [0.0, 1.0, 0.0]: must have 2 components, as "
            "geometry.dimension says",
        ),
        (
            "probe.node=[0, 1, 0]",
            "probe.node = [0.0, 1.0, 0.0]: must have 2 components, as geometry.dimension says",
        ),
        (
            "loads.0.direction=[1]",
            "loads[0].direction = [1]: must be a list of as many finite numbers as the dimension",
        ),
        (
            "loads.0.direction=1",
            "loads[0].direction = 1: must be a list of as many finite numbers as the dimension",
        ),
        # places
        (
            "loads.0.node=[1, 0]",
            "loads[0].node = [1.0, 0.0]: must not be given together with group",
        ),
        ("probe={}", "probe.group is missing: must be given, or node, nearest, box or plane"),
        (
            'probe={node=[1, 0], at="centre"}',
            'probe.at = "centre": must not be given together with node',
        ),
        (
            "supports=[]",
            "supports = []: must be a list of at least one table, each headed [[supports]]",
        ),
        # geometry
        ('geometry.mesh=""', 'geometry.mesh = "": must be a name in quotes'),
        (
            "geometry.dimension=3",
            "geometry.thickness = 0.01: must not be given in three dimensions",
        ),
        (
            'geometry.mesh="a.msh"',
            'geometry.parameters = {"length": 1.0}: must not be given unless mesh is a .geo file',
        ),
        (
            "geometry.parameters.structured=1",
            "geometry.parameters.structured = 1.0: must be set by geometry.cells",
        ),
        (
            'geometry.parameters={"a;b"=1}',
            "geometry.parameters.a;b = 1: a parameter's name must be of letters, digits "
            "and underscores",
        ),
        # derivatives
        (
            'basis.derivatives="some"',
            'basis.derivatives = "some": must be "none", "all", "mmi", "mmi-nls" or a list of '
            'labels such as "1V1S"',
        ),
        *(
            (
                f"basis.derivatives=[{json.dumps(label)}]",
                f"basis.derivatives[0] = {json.dumps(label)}: must be two modes "
                'such as "1V1V" or "1V2S", counted from 1, V normal and S static',
            )
            for label in ("1V", "1X1V", "V1V1", "0V1V", "1V1V1V", " 1V1V", "1v1v", "1V1V\n", 11)
        ),
        (
            'basis.derivatives=["1V4V"]',
            'basis.derivatives[0] = "1V4V": must be of the 3 normal (V) and 2 static (S) modes',
        ),
        (
            'basis.derivatives=["1V3S"]',
            'basis.derivatives[0] = "1V3S": must be of the 3 normal (V) and 2 static (S) modes',
        ),
        (
            'basis={modes=0, derivatives=["1S1S", "1V1S"]}',
            'basis.derivatives[1] = "1V1S": must be of the 0 normal (V) and 2 static (S) modes',
        ),
        (
            'basis.derivatives=["1V1S", "1S1V"]',
            'basis.derivatives[1] = "1S1V": must not name the same derivative twice',
        ),
        # time
        (
            "time={tolerance=1e-4, steps_per_period=100}",
            "time.tolerance = 0.0001: must not be given together with steps_per_period",
        ),
        (
            "time.duration=1.0",
            "time.duration = 1.0: must not be given with a harmonic load: use periods",
        ),
        (
            "time.step=1.0",
            "time.step = 1.0: must not be given with a harmonic load: use steps_per_period",
        ),
        (
            "time.spectral_radius=0.5",
            'time.spectral_radius = 0.5: must not be given unless scheme is "generalised-alpha"',
        ),
        # reference
        (
            "reference.beam=true",
            "reference.beam_section is missing: must be a table, as beam = true asks for it",
        ),
        (
            "reference.beam_section={}",
            "reference.beam_section.length is missing: must be a finite number above 0",
        ),
    ],
)
def test_a_mistake_gets_its_sentence(override: str, sentence: str) -> None:
    assert refused(RUBBING, override) == f"s.toml: {sentence}"


@pytest.mark.parametrize(
    ("override", "sentence"),
    [
        (
            'geometry.plane="stress"',
            'geometry.plane = "stress": must not be given in three dimensions',
        ),
        (
            'geometry.cells="simplex"',
            'geometry.cells = "simplex": must not be given unless mesh is a .geo file',
        ),
        ("loads.0.phase=1.0", "loads[0].phase = 1.0: must not be given without frequency"),
        ("loads=[]", "probe is missing: must be a table in a scene with neither contact nor load"),
        ("basis.modes=0", "basis.modes = 0: must be at least 1 in a scene without contact"),
        (
            'basis.derivatives=["1S1V"]',
            'basis.derivatives[0] = "1V1S": must be of the 3 normal (V) and 0 static (S) modes',
        ),
        (
            "time={step=1.0}",
            "time.duration is missing: must be a number above 0, as no load has a frequency",
        ),
        (
            "time={duration=1.0}",
            "time.step is missing: must be a number above 0, or tolerance be given, as no load has "
            "a frequency",
        ),
        ("time.tolerance=0.1", "time.tolerance = 0.1: must not be given together with step"),
        ("time.step=2.0", "time.step = 2.0: must be at most the duration of 1"),
        ("time.periods=10", "time.periods = 10: must not be given unless a load has a frequency"),
        (
            "time.steps_per_period=10",
            "time.steps_per_period = 10: must not be given unless a load has a frequency",
        ),
        (
            "time.steady_tolerance=0",
            "time.steady_tolerance = 0.0: must not be given unless a load has a frequency",
        ),
    ],
)
def test_a_mistake_in_a_decay_gets_its_sentence(override: str, sentence: str) -> None:
    assert refused(DECAY, override) == f"s.toml: {sentence}"


CASING = RUBBING.replace(
    "normal = [1.0, 1.0]", 'surface = { kind = "cylinder", point = [0.0, 0.0] }'
)


@pytest.mark.parametrize(
    ("text", "override", "sentence"),
    [
        # surfaces
        (
            CASING,
            "contacts.0.normal=[1.0, 0.0]",
            "contacts[0].normal = [1.0, 0.0]: must not be given together with surface",
        ),
        (
            CASING,
            'contacts.0.surface.kind="plane"',
            'contacts[0].surface.kind = "plane": must be "cylinder" or "sphere"',
        ),
        (
            CASING,
            'contacts.0.surface.kind="sphere"',
            'contacts[0].surface.kind = "sphere": must be "cylinder" in two dimensions',
        ),
        (
            CASING,
            "contacts.0.surface.axis=[0, 1]",
            "contacts[0].surface.axis = [0.0, 1.0]: must not be given but of a cylinder "
            "in three dimensions",
        ),
        (
            CASING,
            "contacts.0.surface.point=[0, 0, 0]",
            "contacts[0].surface.point = [0.0, 0.0, 0.0]: must have 2 components, as "
            "geometry.dimension says",
        ),
        (
            CASING,
            "contacts.0.surface.radius=0",
            "contacts[0].surface.radius = 0: must be a finite number above 0",
        ),
        (
            CASING,
            "contacts.0={surface={kind='cylinder', point=[0, 0], radius=1.0}, gap=1e-3, group='tip', friction=0.1, "
            "normal_stiffness=1, tangential_stiffness=1}",
            "contacts[0].gap = 0.001: must not be given together with surface.radius, from which it follows",
        ),
        (
            CASING,
            "contacts.0.surface.inside=1",
            "contacts[0].surface.inside = 1: must be true or false",
        ),
        (
            CASING,
            'contacts.0.surface.spin="fast"',
            'contacts[0].surface.spin = "fast": must be a finite number',
        ),
        (
            CASING,
            "contacts.0.surface.waves=[[2, 1e-4]]",
            "contacts[0].surface.waves[0] = [2, 0.0001]: must be [order, height, "
            "phase], finite numbers",
        ),
        (
            CASING,
            "contacts.0.surface.waves=[[1.5, 1e-4, 0]]",
            "contacts[0].surface.waves[0] = 1.5: must be of an integer order of at least 1",
        ),
        (
            CASING,
            "contacts.0.surface.raduis=1",
            "contacts[0].surface.raduis = 1: unknown key, did you mean radius?",
        ),
        (
            RUBBING,
            "contacts.0={group='tip', friction=0.1, normal_stiffness=1, tangential_stiffness=1}",
            "contacts[0].normal is missing: must be given, or a surface",
        ),
        # approach
        (
            RUBBING,
            "contacts.0.approach=1e-3",
            "contacts[0].approach = 0.001: must be a list of [time, distance], finite numbers",
        ),
        (
            RUBBING,
            "contacts.0.approach=[[0, 0, 0]]",
            "contacts[0].approach[0] = [0, 0, 0]: must be [time, distance], finite numbers",
        ),
        (
            RUBBING,
            "contacts.0.approach=[[0, 0], [0, 1e-3]]",
            "contacts[0].approach = [0.0, 0.0]: must have times that increase",
        ),
        # nodes
        (
            RUBBING,
            'loads.0.at="nodes"',
            'loads[0].at = "nodes": must be "mean" or "centre", but of a contact',
        ),
        (
            RUBBING,
            'probe={group="tip", at="nodes"}',
            'probe.at = "nodes": must be "mean" or "centre", but of a contact',
        ),
        (
            RUBBING,
            'contacts.0={node=[1, 0], at="nodes", normal=[1, 0], friction=0, normal_stiffness=1, tangential_stiffness=1}',
            'contacts[0].at = "nodes": must not be given together with node',
        ),
        # masters
        (
            RUBBING,
            'basis.masters="tangents"',
            'basis.masters = "tangents": must be "all", "normal" or an integer from 1 to 1000',
        ),
        (
            RUBBING,
            "basis.masters=0",
            'basis.masters = 0: must be "all", "normal" or an integer from 1 to 1000',
        ),
        (
            RUBBING,
            "basis={masters='normal', derivatives=['1V2S']}",
            'basis.derivatives[0] = "1V2S": must be of the 3 normal (V) and 1 static (S) modes',
        ),
        (
            DECAY,
            "basis.masters=3",
            "basis.masters = 3: must not be given in a scene without contact",
        ),
    ],
)
def test_a_mistake_about_a_surface_gets_its_sentence(
    text: str, override: str, sentence: str
) -> None:
    assert refused(text, override) == f"s.toml: {sentence}"


def test_three_dimensions_want_the_axis_of_a_cylinder() -> None:
    solid = {"mesh": "beam3d.geo", "dimension": 3}
    table: Any = tomllib.loads(CASING) | {"geometry": solid}
    table["loads"][0]["direction"] = [0.0, 1.0, 0.0]
    table["contacts"][0]["surface"] = {"kind": "cylinder", "point": [0.0, 0.0, 0.0]}
    with pytest.raises(
        SceneError,
        match=r"surface\.axis is missing: must be given of a cylinder in three dimensions",
    ):
        parse_scene(table, "s.toml", None)
    sphere = {"kind": "sphere", "point": [0.0, 0.0, 0.0]}
    for name, value in (("waves", [[2, 1e-4, 0.0]]), ("spin", 1.0)):
        table["contacts"][0]["surface"] = sphere | {name: value}
        with pytest.raises(
            SceneError, match=rf"contacts\[0\]\.surface\.{name} = .*: must not be given of a sphere"
        ):
            parse_scene(table, "s.toml", None)


REQUIRED = [
    *(
        "geometry",
        "geometry.mesh",
        "geometry.dimension",
        "geometry.thickness",
        "material",
        "supports",
    ),
    *("material.young", "supports.0.group", "loads.0.group", "loads.0.direction", "loads.0.force"),
    *("contacts.0.normal_stiffness", "contacts.0.tangential_stiffness", "contacts.0.friction"),
]


@pytest.mark.parametrize("key", REQUIRED)
def test_a_required_key_is_missed(key: str) -> None:
    table: Any = tomllib.loads(RUBBING)
    *way, last = [int(name) if name.isdigit() else name for name in key.split(".")]
    branch = table
    for name in way:
        branch = branch[name]
    del branch[last]
    shown = key.replace(".0", "[0]")
    with pytest.raises(SceneError, match=r"^s\.toml: ") as caught:
        parse_scene(table, "s.toml", None)
    assert str(caught.value).startswith(f"s.toml: {shown} is missing: must be ")


def test_a_missing_mesh_names_the_folders(tmp_path: Path) -> None:
    sentence = refused(RUBBING, 'geometry.mesh="none.geo"', folder=tmp_path)
    assert (
        sentence
        == f's.toml: geometry.mesh = "none.geo": must be a file in {tmp_path} or {shared_meshes()}'
    )
    sentence = refused(RUBBING, 'geometry.mesh="/none.geo"', folder=tmp_path)
    assert sentence == 's.toml: geometry.mesh = "/none.geo": must be an existing file'
    assert "must be a file in" in refused(
        RUBBING, f'geometry.mesh="{"x" * 5000}.geo"', folder=tmp_path
    )


def test_files_that_cannot_be_read(tmp_path: Path) -> None:
    def sentence(path: Path) -> str:
        with pytest.raises(SceneError) as caught:
            read_scene(path)
        return str(caught.value)

    scene = tmp_path / "s.toml"
    assert sentence(scene) == f"{scene}: cannot be read: No such file or directory"
    assert sentence(tmp_path) == f"{tmp_path}: cannot be read: Is a directory"
    for content, part in (
        (b"[geometry]\nmesh = \n", "at line 2"),
        (b"\xff\xfe", "is not TOML: "),
        (b"x = " + 5000 * b"[", "is not TOML: "),
        (b"x = " + 5000 * b"9", "is not TOML: "),
        (50 * b"a." + b"a = 1", "unknown key"),
        (
            5000 * b"a." + b"a = 1",
            "",
        ),  # an unknown key, or nested too deeply: as deep as Python's parser goes
    ):
        scene.write_bytes(content)
        assert sentence(scene).startswith(f"{scene}: ") and part in sentence(scene)
        assert "\n" not in sentence(scene)


# Whatever comes in, a scene or one sentence comes out


def scene_or_sentence(table: Any) -> Scene | None:
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
WORDS = st.text(max_size=8) | st.sampled_from(
    [
        "root",
        "mean",
        "centre",
        "all",
        "1V1V",
        "1V2S",
        "9S9S",
        "simplex",
        "strain",
        "a.geo",
        "generalised-alpha",
        "\0\n",
    ]
)
KEYS = st.text(max_size=6) | st.sampled_from(
    [
        "group",
        "node",
        "at",
        "frequency",
        "phase",
        "tolerance",
        "duration",
        "periods",
        "probe",
        "beam",
        "cells",
        "plane",
        "traction",
        "pressure",
        "acceleration",
        "harmonics",
        "sweep",
        "pulse",
        "table",
    ]
)
VALUES = st.recursive(
    NUMBERS | WORDS | st.booleans() | st.none() | st.dates(),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(KEYS, inner, max_size=3),
    max_leaves=6,
)


def examples(number: int) -> settings:
    """So many examples, however slow the machine."""
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
            alike = {float: NUMBERS, int: NUMBERS, str: WORDS, bool: st.booleans()}.get(
                type(branch[place]), VALUES
            )
            branch[place] = draw(alike | alike | VALUES)
        elif action == "delete":
            del branch[draw(st.sampled_from(places))]
        elif isinstance(branch, dict):
            branch[draw(KEYS)] = draw(VALUES)
        else:
            branch.append(draw(VALUES))
    return table


@examples(400)
@given(mutants())
def test_a_mutated_table_gives_a_scene_or_a_sentence(table: Any) -> None:
    scene_or_sentence(table)


@examples(100)
@given(VALUES)
def test_any_data_give_a_scene_or_a_sentence(table: Any) -> None:
    scene_or_sentence(table)


@examples(200)
@given(st.data())
def test_any_text_gives_a_scene_or_a_sentence(
    tmp_path_factory: pytest.TempPathFactory, data: st.DataObject
) -> None:
    text = data.draw(st.sampled_from([RUBBING, DECAY]))
    begin = data.draw(st.integers(0, len(text)))
    end = data.draw(st.integers(begin, min(len(text), begin + 20)))
    noise = data.draw(
        st.text(max_size=10) | st.text("[]{}=.,\"'#\n\r0123456789eE-+_ ", max_size=10)
    )
    path = tmp_path_factory.getbasetemp() / "mutated.toml"
    path.write_bytes((text[:begin] + noise + text[end:]).encode("utf-8", "surrogatepass"))
    try:
        assert isinstance(read_scene(path), Scene)
    except SceneError as error:
        assert str(error).startswith(f"{path}: ") and str(error).isprintable()


@examples(200)
@given(
    st.text(max_size=20)
    | st.builds("{}={}".format, st.text("loads.[0]forceab", max_size=15), st.text(max_size=5))
)
def test_any_override_gives_a_scene_or_a_sentence(override: str) -> None:
    try:
        scene_or_sentence(override_table(tomllib.loads(RUBBING), [override], "s.toml"))
    except SceneError as error:
        assert str(error).startswith("s.toml: override ") and str(error).isprintable()


@examples(200)
@given(
    st.lists(st.floats(allow_nan=False, allow_infinity=False), min_size=2, max_size=2).filter(any)
)
def test_directions_have_unit_length_and_survive_the_round_trip(vector: list[float]) -> None:
    table = tomllib.loads(RUBBING)
    table["contacts"][0]["normal"] = vector
    scene = scene_or_sentence(table)
    assert scene is not None
    (normal,) = (contact.normal for contact in scene.contacts)
    assert abs(math.hypot(*normal) - 1.0) <= 1e-14
    largest = max(map(abs, vector))
    assert normal[0] * (vector[1] / largest) == pytest.approx(
        normal[1] * (vector[0] / largest), rel=1e-12, abs=1e-300
    )


@pytest.mark.parametrize("path", DEMOS, ids=lambda path: path.stem)
def test_a_demo_survives_the_round_trip(path: Path) -> None:
    scene = read_scene(path)
    assert parse_scene(json.loads(json.dumps(scene_table(scene))), scene.source, HERE) == scene


def test_a_scene_cannot_be_changed() -> None:
    scene = parse(RUBBING)
    with pytest.raises(dataclasses.FrozenInstanceError):
        scene.material.young = 1.0  # type: ignore[misc]

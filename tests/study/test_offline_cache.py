"""The cache of offline results: what a result depends on, equal results, damage, and its limit."""

from __future__ import annotations

import os
import pickle
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import fields, is_dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from support import STOCKY, beam_scene, refusal

from fenicsrom import study
from fenicsrom.cli import main
from fenicsrom.errors import ErrorKind
from fenicsrom.files import reads_other_files
from fenicsrom.online.store import store as result_cache
from fenicsrom.online.store.scene_changes import changed_key
from fenicsrom.records import Study
from fenicsrom.scene import Scene, make_scene
from fenicsrom.study.offline_cache import keys_of

MESH = Path(__file__).parents[2] / "meshes" / "blade.geo"

TABLE: dict[str, Any] = {
    "geometry": {"mesh": str(MESH), "dimension": 3, "parameters": {"tip_radius": 1.0}},
    "material": {"young": 1e11, "poisson": 0.3, "density": 4000.0, "mass_damping": 20.0},
    "materials": [{"group": "tip_cells", "young": 2e11, "poisson": 0.3, "density": 4000.0}],
    "supports": [{"group": "root"}],
    "loads": [
        {"group": "tip", "direction": [1.0, 0.0, 0.0], "force": 5.0, "frequency": 50.0},
        {"group": "pressure", "pressure": 100.0},
        {"group": "pressure", "pressure": 50.0, "frequency": 50.0},
    ],
    "contacts": [
        {
            "group": "tip_nodes",
            "at": "nodes",
            "surface": {
                "kind": "cylinder",
                "point": [-0.3, 0.0, 0.0],
                "axis": [0.0, 1.0, 0.0],
                "radius": 0.5,
                "spin": 1.0,
                "waves": [[2, 2e-4, 0.0]],
            },
            "gap": 0.0,
            "normal_stiffness": 1e8,
            "tangential_stiffness": 1e8,
            "friction": 0.2,
        }
    ],
    "rotation": {"speed_rpm": 3000.0, "axis": [0.0, 1.0, 0.0], "point": [-0.3, 0.0, 0.0]},
    "damping": {"stiffness": 1e-6},
    "probe": {"group": "tip", "at": "mean"},
    "basis": {"modes": 4, "masters": 10, "derivatives": "none"},
    "time": {"periods": 10, "steps_per_period": 100},
    "response": {"first": 40.0, "last": 60.0},
    "backbone": {"first": 1e-6, "last": 1e-4},
}
"""A scene with all tables but one."""

ONLINE = set(
    """
    title source reference output.pictures output.paraview output.motion output.animation
    output.sectors compare statics campbell map backbone ringdown basis.accuracy basis.size
""".split()
)
"""Keys and tables on which no offline result depends."""

MOTION = set(
    """
    time response material.mass_damping loads.0.action.force loads.0.history
    loads.2.action.pressure loads.2.history contacts.0.preload contacts.0.gap
    contacts.0.abradable contacts.0.approach contacts.0.normal_stiffness
    contacts.0.tangential_stiffness contacts.0.friction contacts.0.surface.radius
    contacts.0.surface.spin contacts.0.surface.waves contacts.0.surface.angle_from
""".split()
)
"""Keys and tables on which a reduced model depends only if a motion selects its derivatives."""

PROJECTED = set(
    """
    damping output.stresses basis.derivatives basis.threshold basis.differentiation
    basis.elastic_force
""".split()
)
"""Keys and tables on which the reduced model depends, and the modes do not."""


def leaves(value: Any, path: str = "") -> Iterator[tuple[str, Any]]:
    """All keys of a scene, by the attributes that lead to them, and their values."""
    if is_dataclass(value):
        for field in fields(value):
            yield from leaves(getattr(value, field.name), f"{path}.{field.name}")
    elif isinstance(value, tuple) and value and is_dataclass(value[0]):
        for k, entry in enumerate(value):
            yield from leaves(entry, f"{path}.{k}")
    else:
        yield path.lstrip("."), value


def other(value: Any) -> Any:
    """Another value of a key."""
    if isinstance(value, bool):
        return not value
    if isinstance(value, int | float):
        return value + 1
    if isinstance(value, str):
        return f"{value}x"
    if isinstance(value, Path):
        return value.with_name("beam2d.geo")
    if isinstance(value, tuple):
        return (*value, *value) or ((0.0, 1.0), (1.0, 2.0))
    return {**value, "more": 1.0} if isinstance(value, dict) else 1.0


def changed(value: Any, path: list[str]) -> Any:
    """A copy of a scene with another value of one key."""
    if not path:
        return other(value)
    if isinstance(value, tuple):
        k = int(path[0])
        return (*value[:k], changed(value[k], path[1:]), *value[k + 1 :])
    return replace(value, **{path[0]: changed(getattr(value, path[0]), path[1:])})


def within(path: str, names: set[str]) -> bool:
    """Whether a key is one of some names, or in one of some tables."""
    return any(f"{path}.".startswith(f"{name}.") for name in names)


@pytest.fixture(scope="module")
def whole() -> Scene:
    scene = make_scene(**TABLE)
    other = beam_scene(2, attachments=[{"group": "tip", "at": "mean", "mass": 0.1}])
    return replace(scene, attachments=other.attachments)  # not allowed with a rotation


@pytest.mark.slow
def test_backbone_decides_only_derivatives_along_the_motion(whole: Scene) -> None:
    for derivatives, matter in (("principal", True), ("mmi-nls", False)):
        scene = replace(whole, basis=replace(whole.basis, derivatives=derivatives))
        assert scene.backbone is not None
        for key, changes in (("last", matter), ("first", False)):
            other = replace(scene, backbone=replace(scene.backbone, **{key: 2e-5}))
            assert (keys_of(scene) != keys_of(other)) is changes


@pytest.mark.slow
@pytest.mark.parametrize("derivatives", ["none", "mmi-nls"])
def test_every_key_of_the_schema_that_matters_changes_the_hashes(
    whole: Scene, derivatives: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A new key of the schema matters unless it is in one of the sets above."""
    monkeypatch.setattr(result_cache, "package_digest", lambda folder: "the same")
    scene = replace(whole, basis=replace(whole.basis, derivatives=derivatives))
    found = keys_of(scene)
    assert found is not None
    listed = dict(leaves(scene))
    assert len(listed) > 80
    for path in listed:
        # one period of the loads is enough to know the linear transient, whatever ends the run
        if derivatives == "mmi-nls" and within(path, {"time", "response"}):
            continue
        if path == "geometry.apart":  # follows from the contacts and ties
            continue
        variant = changed(scene, path.split("."))
        if path == "geometry.also":
            variant = replace(scene, geometry=replace(scene.geometry, also=(MESH,)))
        new = keys_of(variant)
        assert new is not None
        modes, model = (a != b for a, b in zip(found[:2], new[:2], strict=True))
        assert modes != within(path, ONLINE | MOTION | PROJECTED), path
        online = ONLINE if derivatives == "mmi-nls" else ONLINE | MOTION
        assert model != within(path, online), path
        if derivatives == "none" and changed_key(scene, variant) is not None:
            assert model, path


def test_time_integration_of_the_selecting_motion_changes_its_hash(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(result_cache, "package_digest", lambda folder: "the same")
    scene = beam_scene(2)
    found = keys_of(scene)
    for override, same in (
        ("time.periods=7", True),
        ("time.steady_tolerance=1e-7", True),
        ("time.steps_per_period=150", False),
        ("time.scheme='average-acceleration'", False),
        ("response={parameter='frequency', first=1.0, last=8.0}", False),
    ):
        new = keys_of(beam_scene(2, (override,)))
        assert found is not None and new is not None
        assert new[0] == found[0] or "response" in override
        assert (new[1] == found[1]) == same, override
        assert new[2] != found[2]  # another motion has another residual


def test_program_options_and_mesh_file_change_the_hashes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    scene = beam_scene(2)
    mesh = tmp_path / "mesh.geo"
    mesh.write_bytes(scene.geometry.mesh.read_bytes())
    scene = replace(scene, geometry=replace(scene.geometry, mesh=mesh))
    found = {keys_of(scene)}
    monkeypatch.setenv("PETSC_OPTIONS", "-info")
    found.add(keys_of(scene))
    mesh.write_text(mesh.read_text() + "\n")
    found.add(keys_of(scene))
    monkeypatch.setattr(result_cache, "package_digest", lambda folder: "other code")
    found.add(keys_of(scene))
    assert len(found) == 4
    mesh.write_text('Include "other.geo";\n')
    assert keys_of(scene) is None


# ------------------------------------------------------------------ results

STATIC = {"group": "load", "at": "centre", "direction": [0.0, 1.0], "force": 2e4}
SHAKE = {**STATIC, "force": 1e4, "frequency": 40.0}
SHORT = (*STOCKY, "time.periods=2", "time.steps_per_period=50", "basis.modes=2")


def loaded_scene(*overrides: str) -> Scene:
    """A short beam under a static and a varying load."""
    return beam_scene(2, (*SHORT, *overrides), loads=[SHAKE, STATIC])


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A cache of this test."""
    monkeypatch.setenv(result_cache.VARIABLE, str(tmp_path / "cache"))
    return tmp_path / "cache"


def run(scene: Scene, fresh: bool = False) -> Study:
    pytest.importorskip("dolfinx")
    return study.run(scene, fresh=fresh)


def numbers(found: Study) -> dict[str, Any]:
    """The results of a run: models, motion, labels and sentences."""
    motion = found.motions["reduced"]
    return {
        "displacement": motion.displacement,
        "work": motion.work,
        "cubic": found.model.elastic.cubic,
        "mass": found.model.mass,
        "candidates": found.candidates.elastic.cubic,
        "vectors": found.basis.vectors,
        "labels": np.array(found.labels),
        "deflection": found.deflection,
        "weights": np.array(list(found.selection.weights.values())),
        "errors": np.array([error.amplitude for error in found.errors.values()]),
        "warnings": np.array(found.warnings),
    }


def assert_equal_runs(one: Study, two: Study) -> None:
    for name, value in numbers(one).items():
        np.testing.assert_array_equal(numbers(two)[name], value, err_msg=name)


@pytest.mark.parametrize("method", ["rubin", "craig-bampton"])
@pytest.mark.slow
def test_cached_results_are_the_fresh_ones_bit_for_bit(method: str, folder: Path) -> None:
    scene = loaded_scene(f"basis.method='{method}'")
    first, second = run(scene), run(scene)
    assert_equal_runs(first, second)
    assert "modes" in first.seconds and "modes" not in second.seconds
    assert second.solid._made is None  # no solid was built
    assert second.solid.mass.getSize() == first.solid.mass.getSize()  # now it is
    rough = loaded_scene(f"basis.method='{method}'", "contacts.0.friction=0.1")
    third = run(rough)  # the friction selects the derivatives
    assert "modes" not in third.seconds and "reduction" in third.seconds
    again = run(rough, fresh=True)
    assert "modes" in again.seconds
    assert_equal_runs(again, third)


def test_run_from_the_cache_warns_of_a_crushed_equilibrium_again(folder: Path) -> None:
    sizes = ("length=0.2", "height=0.4", "elements_along=2")
    parameters = [f"geometry.parameters.{size}" for size in sizes]
    spin = "rotation={speed_rpm=8e4, point=[0.4, 0.0]}"
    scene = loaded_scene(*parameters, spin, "basis.derivatives='none'", "time.periods=1")
    first, second = run(scene), run(scene)
    assert "solid" not in second.seconds and first.warnings == second.warnings
    assert len([text for text in second.warnings if "24." in text and "strain" in text]) == 1
    for found in (first, second):
        kept = found.stored.deformation
        assert kept is not None and kept.smallest_stretch == pytest.approx(0.753, abs=0.002)


REUSING = """
import pickle, sys
from fenicsrom import study
study.run(pickle.load(sys.stdin.buffer))
print([name for name in ("dolfinx", "gmsh", "petsc4py") if name in sys.modules])
"""


@pytest.mark.slow
def test_run_that_reuses_all_stages_imports_no_finite_elements(folder: Path) -> None:
    scene = loaded_scene()
    run(scene)
    done = subprocess.run(
        [sys.executable, "-c", REUSING], input=pickle.dumps(scene), capture_output=True, check=True
    )
    assert done.stdout == b"[]\n"


@pytest.mark.slow
def test_unselected_model_serves_other_loads_and_friction(folder: Path) -> None:
    run(loaded_scene("basis.derivatives='none'"))
    other = loaded_scene(
        "basis.derivatives='none'",
        "loads.0.force=500",
        "contacts.0.friction=0.2",
        "material.mass_damping=7",
    )
    found = run(other)  # the body is made again for the residual along the other motion
    assert not {"modes", "reduction"} & found.seconds.keys()
    assert_equal_runs(run(other, fresh=True), found)
    assert run(other).solid._made is None


@pytest.mark.slow
def test_full_motion_of_a_second_run_comes_from_the_cache(folder: Path) -> None:
    scene = loaded_scene("basis.derivatives='none'", "time.periods=1", "reference.full=true")
    first, second = run(scene), run(scene)
    again = run(scene, fresh=True)
    one, two, three = (found.motions["full"] for found in (first, second, again))
    np.testing.assert_array_equal(two.displacement, one.displacement)
    assert two.seconds == one.seconds != three.seconds
    told = [{note.key for note in found.left_out} for found in (first, second, again)]
    assert ["full motion" in keys for keys in told] == [False, True, False]


@pytest.mark.slow
def test_damaged_archive_is_computed_again(folder: Path) -> None:
    scene = loaded_scene()
    first = run(scene)
    for k, path in enumerate(sorted(folder.iterdir())):
        content = path.read_bytes()
        middle = len(content) // 2
        damaged = content[:middle] + bytes([content[middle] ^ 255]) + content[middle + 1 :]
        path.write_bytes(content[: middle // 2] if k else damaged)
        again = run(scene)
        assert_equal_runs(first, again)
        assert "reduction" in again.seconds or again.solid._made is not None
        assert len(path.read_bytes()) == len(content)
    last = run(scene)
    assert "reduction" not in last.seconds and last.solid._made is None


# ------------------------------------------------------------------ the folder


def archive(path: Path, size: int, used: float) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(bytes(size))
    os.utime(path, (used, used))


NAMES = [f"{k:040x}.npz" for k in range(4)]


def test_oldest_archives_are_removed_beyond_the_limit(folder: Path) -> None:
    for k, name in enumerate(NAMES):
        archive(folder / name, 100, used=1000.0 + k)
    os.utime(folder / NAMES[0])
    result_cache.trim(folder, 250)
    left = [NAMES[3], NAMES[0]]
    assert [entry.path.name for entry in result_cache.entries(folder)] == left
    result_cache.trim(folder, 200)
    assert len(result_cache.entries(folder)) == 2
    killed, written_now = f".{40 * '1'}.{12 * '2'}.npz", f".{40 * '3'}.{12 * '4'}.npz"
    archive(folder / killed, 100, used=1000.0)
    archive(folder / written_now, 100, used=time.time())
    result_cache.trim(folder, 200)
    assert {path.name for path in folder.iterdir()} == {*left, written_now}


def test_files_that_are_no_archives_stay(folder: Path) -> None:
    """FENICSROM_CACHE may name a folder with files of the user."""
    archive(folder / "reduced_model.npz", 100, used=1000.0)
    result_cache.trim(folder, 0)
    assert result_cache.clear(folder) == 0 and (folder / "reduced_model.npz").exists()


@pytest.mark.parametrize(
    "line",
    [
        b'Include "other.geo";',
        b'Merge "part.step";',
        b'v() = ListFromFile["len.txt"];',
        b'v() = ShapeFromFile("p.step");',
        b'l = GetEnv("LENGTH");',
    ],
)
def test_mesh_file_that_reads_other_files_is_told(line: bytes) -> None:
    assert reads_other_files(line) and not reads_other_files(b"l = 2.54; Point(1) = {0, 0, 0};")


def test_command_shows_and_empties_the_cache(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    archive(folder / NAMES[1], 2_000_000, used=1000.0)
    assert main(["cache"]) == 0
    shown = capsys.readouterr().out
    assert f"{folder}: 1 file, 2.0 MB" in shown
    assert main(["cache", "--clear"]) == 0
    assert result_cache.entries(folder) == []


@pytest.mark.slow
@pytest.mark.parametrize("size", [3, 400])
def test_size_that_no_model_has_is_refused_after_the_modes_and_keeps_the_cache(
    size: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from fenicsrom.study import building

    monkeypatch.setenv(result_cache.VARIABLE, str(tmp_path))
    contact = {"group": "tip", "at": "nodes", "normal": [1.0, 0.0], "friction": 0.5}
    contact |= {"normal_stiffness": 1e6, "tangential_stiffness": 1e6}
    scene = beam_scene(2, SHORT, contacts=[contact], loads=[SHAKE])
    wrong = replace(scene, basis=replace(scene.basis, size=size))
    with monkeypatch.context() as patched:
        patched.setattr(building, "linear_transient", lambda run: pytest.fail("it goes on"))
        with refusal(ErrorKind.RANGE, "basis.size"):
            study.build_model(wrong)
    study.build_model(scene)
    kept = sorted(path.name for path in tmp_path.iterdir())
    assert len(kept) == 2
    with refusal(ErrorKind.RANGE, "basis.size"):
        study.build_model(wrong)
    assert sorted(path.name for path in tmp_path.iterdir()) == kept

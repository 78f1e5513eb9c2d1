"""The public interface: lazy imports, arrays of a model, histories, and the demos that use it."""

from __future__ import annotations

import runpy
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from support import (
    beam_scene,
    fresh_python,
    gmsh_session,
    isotropic_tensor,
    oscillator,
    random_model,
    random_polynomial,
    refusal,
)

import fenicsrom
from fenicsrom.assess.studies.sweep_runs import Sweep, digest_of
from fenicsrom.errors import ErrorKind
from fenicsrom.online.model.matrices import UNITS, full_tensors
from fenicsrom.online.model.polynomial import elastic_force, elastic_polynomial
from fenicsrom.online.motion.motion import HISTORY_ARRAYS
from fenicsrom.online.store.archive import StoredModel
from fenicsrom.records import Rerun
from fenicsrom.reduction.basis import strain_products

PACKAGE = Path(fenicsrom.__file__).parent
ROOT = PACKAGE.parent


# ------------------------------------------------------------------ the package


def test_public_names_exist() -> None:
    pytest.importorskip("dolfinx")
    for name in fenicsrom.__all__:
        assert getattr(fenicsrom, name).__name__ == name
    with pytest.raises(AttributeError):
        fenicsrom.no_such_name  # noqa: B018


def test_import_of_the_package_is_light() -> None:
    code = """
import sys
import fenicsrom
heavy = {"numpy", "scipy", "numba", "dolfinx", "mpi4py", "matplotlib"} & set(sys.modules)
assert not heavy, heavy
fenicsrom.read_scene, fenicsrom.SceneError
heavy = {"numba", "dolfinx", "mpi4py", "matplotlib"} & set(sys.modules)
assert not heavy, heavy
"""
    fresh_python(code)


def test_package_list_of_the_wheel_is_complete() -> None:
    if not (ROOT / "pyproject.toml").exists():
        pytest.skip("not a checkout")
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())
    packages = set(project["tool"]["setuptools"]["packages"])
    on_disk = {
        ".".join(path.parent.relative_to(ROOT).parts) for path in PACKAGE.rglob("__init__.py")
    }
    assert packages == on_disk | {"fenicsrom.meshes", "fenicsrom.demos"}
    data = project["tool"]["setuptools"]["package-data"]
    assert "py.typed" in data["fenicsrom"] and (PACKAGE / "py.typed").exists()
    others = [path for path in PACKAGE.rglob("*.*") if path.suffix in (".c", ".html", ".js")]
    assert len(others) > 4
    for path in others:
        package = ".".join(path.parent.relative_to(ROOT).parts)
        assert f"*{path.suffix}" in data[package]


# ------------------------------------------------------------------ the arrays of a model


def prestressed(n: int) -> Any:
    """An elastic polynomial about a deformed state: its force at q = 0 is not zero."""
    rng = np.random.default_rng(7)
    gradients = 0.3 * rng.standard_normal((30, 1 + n, 2, 2))
    tensor = isotropic_tensor(1.0, 0.8, 2)
    return elastic_polynomial(strain_products([(np.full(30, 0.1), gradients)], tensor, n), n)


@pytest.mark.parametrize("elastic", [random_polynomial(4), prestressed(3)], ids=["flat", "bent"])
def test_full_tensors_give_the_force_and_tangent_of_the_program(elastic: Any) -> None:
    n = elastic.force.size
    quadratic, cubic = full_tensors(elastic)
    q = np.random.default_rng(1).standard_normal(n)
    force, tangent = np.zeros(n), np.zeros((n, n))
    elastic_force(elastic, q, force, tangent)
    ours = elastic.force + elastic.stiffness @ q + quadratic @ q @ q / 2 + cubic @ q @ q @ q / 6
    np.testing.assert_allclose(ours, force, rtol=0, atol=1e-13 * np.abs(force).max())
    slope = elastic.stiffness + quadratic @ q + cubic @ q @ q / 2
    np.testing.assert_allclose(slope, tangent, rtol=0, atol=1e-13 * np.abs(tangent).max())


def test_full_tensors_are_symmetric_in_all_indices() -> None:
    quadratic, cubic = full_tensors(random_polynomial(4))
    for axes in ((1, 0, 2), (0, 2, 1)):
        np.testing.assert_allclose(quadratic, quadratic.transpose(axes), rtol=0, atol=1e-13)
    for axes in ((1, 0, 2, 3), (0, 2, 1, 3), (0, 1, 3, 2)):
        np.testing.assert_allclose(cubic, cubic.transpose(axes), rtol=0, atol=1e-13)
    assert np.abs(quadratic).max() > 0.1 and np.abs(cubic).max() > 0.1


def test_model_arrays_are_those_of_the_model() -> None:
    model = random_model(4, damping=0.3, masters=2)
    arrays = fenicsrom.model_arrays(model)
    q = np.random.default_rng(2).standard_normal(4)
    force, _ = model.elastic_at(q)
    np.testing.assert_allclose(arrays.elastic_force(q), force, rtol=1e-13)
    np.testing.assert_array_equal(arrays.damping, 0.3 * model.mass)
    np.testing.assert_array_equal(arrays.contact_displacement(q), model.contact_displacement(q))
    assert set(arrays.asdict()) == set(UNITS)
    arrays.mass[0, 0] = -1.0  # copies
    assert model.mass[0, 0] > 0.0


def test_functions_say_what_to_pass(tmp_path: Path) -> None:
    model, scene, motion = oscillator()
    stored = StoredModel(model, scene, "rubin", ("1V", "2V"), 9, np.ones(2), {})
    np.testing.assert_array_equal(
        fenicsrom.model_arrays(stored).mass, fenicsrom.model_arrays(model).mass
    )
    for function, wrong in (
        (fenicsrom.model_arrays, scene),
        (fenicsrom.model_arrays, None),
        (fenicsrom.amplitudes, stored),
        (fenicsrom.amplitudes, {"reduced": motion}),
        (fenicsrom.contact_fractions, model),
        (fenicsrom.read_scene, scene),
        (fenicsrom.run, stored),
        (fenicsrom.response, motion),
    ):
        with pytest.raises(TypeError, match=f"{type(wrong).__name__}: must be a") as caught:
            function(wrong)
        assert "\n" not in str(caught.value)


def test_computation_takes_the_file_of_a_scene(tmp_path: Path) -> None:
    missing = tmp_path / "scene.toml"
    with refusal(ErrorKind.FILE, file=missing.name):
        fenicsrom.statics(str(missing))


# ------------------------------------------------------------------ overrides and short records


def test_overrides_by_keys_are_those_by_texts() -> None:
    scene = ROOT / "demos" / "slip_liftoff_2d.toml"
    values = {
        "loads.0.force": np.float64(50.0),
        "basis.modes": np.int64(2),
        "output.pictures": False,
        "title": 'of "x"',
        "contacts.0.normal": (0.0, -1.0),
        "time.scheme": "average-acceleration",
    }
    texts = ["loads.0.force=50.0", "basis.modes=2", "output.pictures=false"]
    texts += ["title='of \"x\"'", "contacts.0.normal=[0.0, -1.0]"]
    texts += ["time.scheme='average-acceleration'"]
    found = fenicsrom.read_scene(scene, values)
    assert found == fenicsrom.read_scene(scene, texts) and found.loads[0].size == 50.0
    model, made, _ = oscillator()
    stored = StoredModel(model, made, "rubin", ("1V", "2V"), 9, np.ones(2), {})
    changed = stored.with_overrides({"loads.0.force": 50.0})
    assert changed.scene == stored.with_overrides("loads.0.force=50.0").scene != made
    with refusal(ErrorKind.TYPE, names="object"):
        fenicsrom.read_scene(scene, {"loads.0.force": object()})
    with refusal(ErrorKind.RANGE, "basis.modes"):
        fenicsrom.read_scene(scene, {"basis.modes": -1})


def records() -> list[Any]:
    """Public records that need no mesh."""
    model, scene, motion = oscillator()
    stored = StoredModel(model, scene, "rubin", ("1V", "2V"), 9, np.ones(2), {})
    demo = fenicsrom.read_scene(ROOT / "demos" / "blade_rub.toml", "output.pictures=false")
    study = fenicsrom.Study(demo, motions={"reduced": motion}, errors={})
    found = [stored, motion, study, scene, demo, fenicsrom.model_arrays(stored)]
    found += [Rerun(stored, motion, {}, None, ["a\nwarning"])]
    return [*found, Sweep(scene, (), [{"run": 1, "outcome": "done"}] * 1000, 1)]


def test_scenes_of_a_sweep_that_differ_in_one_number_have_different_digests() -> None:
    scene = ROOT / "demos" / "blade_rub.toml"
    found = {
        digest_of(fenicsrom.read_scene(scene, f"{key}={value}"), "model")
        for key, values in {"contacts.0.friction": (0.1, 0.2), "time.periods": (7, 8)}.items()
        for value in values
    }
    assert len(found) == 4


# ------------------------------------------------------------------ histories


def test_history_read_back_equals_the_motion(tmp_path: Path) -> None:
    from fenicsrom.post.run.summary import write_history

    _, scene, motion = oscillator()
    write_history(tmp_path / "history.npz", {"reduced": motion, "full": motion})
    found = fenicsrom.read_history(tmp_path / "history.npz", scene.period)
    assert set(found) == {"reduced", "full"}
    for attribute in HISTORY_ARRAYS.values():
        np.testing.assert_array_equal(
            getattr(found["reduced"], attribute), getattr(motion, attribute)
        )
    assert fenicsrom.amplitudes(found["full"]) == fenicsrom.amplitudes(motion)
    assert fenicsrom.amplitudes(fenicsrom.read_history(tmp_path / "history.npz")["full"]) != (
        fenicsrom.amplitudes(motion)  # of the whole run, the transient included
    )


def test_history_that_is_damaged_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "history.npz"

    def kind() -> ErrorKind:
        with pytest.raises(fenicsrom.SceneError) as caught:
            fenicsrom.read_history(path)
        assert caught.value.source == str(path)
        return caught.value.kind

    assert kind() is ErrorKind.FILE
    path.write_bytes(b"no archive")
    assert kind() is ErrorKind.FORMAT
    np.savez(path, reduced_time=np.zeros(3))
    assert kind() is ErrorKind.FORMAT
    path.unlink()
    path.mkdir()
    assert kind() is ErrorKind.FILE


# ------------------------------------------------------------------ meshes in memory


def frequencies(mesh: Any, scene: Any) -> Any:
    """The first three natural frequencies in Hz of a scene on a mesh."""
    return fenicsrom.component_modes(fenicsrom.solid_of(scene, mesh), scene.basis).frequencies_hz


def test_gmsh_model_in_memory_gives_the_mesh_of_its_file(tmp_path: Path) -> None:
    pytest.importorskip("dolfinx")
    pytest.importorskip("gmsh")
    with gmsh_session() as gmsh:
        gmsh.model.add("plate")
        gmsh.model.occ.addRectangle(0.0, 0.0, 0.0, 1.0, 0.2)
        gmsh.model.occ.synchronize()
        gmsh.model.addPhysicalGroup(2, [1], name="solid")
        gmsh.model.addPhysicalGroup(1, [4], name="root")
        gmsh.model.addPhysicalGroup(1, [2], name="tip")
        gmsh.model.addPhysicalGroup(1, [3], name="load")
        gmsh.option.setNumber("Mesh.MeshSizeMax", 0.1)
        gmsh.model.mesh.generate(2)
        found = fenicsrom.mesh_from_gmsh_model(dimension=2)
        gmsh.write(str(tmp_path / "plate.msh"))
        with pytest.raises(fenicsrom.SceneError) as caught:
            fenicsrom.mesh_from_gmsh_model(dimension=3)
        assert caught.value.kind is ErrorKind.MESH
    assert set(found.cell_groups) == {"solid"}
    assert set(found.facet_groups) == {"root", "tip", "load"}
    geometry = {"mesh": str(tmp_path / "plate.msh"), "dimension": 2, "thickness": 0.01}
    scene = beam_scene(2, geometry=geometry)
    from mpi4py import MPI

    ours, theirs = (
        frequencies(found, scene),
        frequencies(fenicsrom.build_mesh(scene.geometry, MPI.COMM_WORLD), scene),
    )
    np.testing.assert_allclose(ours, theirs, rtol=1e-8)


def test_dolfinx_mesh_with_tags_gives_the_beam_of_the_geo_file(beam2d: Any) -> None:
    import dolfinx.mesh
    from mpi4py import MPI

    scene = beam_scene(2)
    domain = dolfinx.mesh.create_rectangle(
        MPI.COMM_WORLD, [[0.0, 0.0], [2.54, 0.0254]], [20, 1], dolfinx.mesh.CellType.quadrilateral
    )
    root = dolfinx.mesh.locate_entities_boundary(domain, 1, lambda x: x[0] < 1e-9)
    tip = dolfinx.mesh.locate_entities_boundary(domain, 1, lambda x: x[0] > 2.54 - 1e-9)
    load = dolfinx.mesh.locate_entities(domain, 1, lambda x: abs(x[0] - 0.7 * 2.54) < 1e-9)
    facets = np.concatenate([root, tip, load])
    values = np.repeat(np.array([1, 2, 3], dtype=np.int32), [len(root), len(tip), len(load)])
    order = np.argsort(facets)
    tags = dolfinx.mesh.meshtags(domain, 1, facets[order], values[order])
    mesh = fenicsrom.mesh_from_dolfinx(domain, tags, {"root": 1, "tip": [2], "load": 3})
    ours = frequencies(mesh, scene)
    np.testing.assert_allclose(ours, frequencies(beam2d.mesh, scene), rtol=1e-6)
    with pytest.raises(fenicsrom.SceneError) as caught:
        fenicsrom.mesh_from_dolfinx(domain, tags, {"root": 7})
    assert caught.value.kind is ErrorKind.PLACE


# ------------------------------------------------------------------ the demos


def demo(name: str) -> dict[str, Any]:
    """What a script of demos/ computes."""
    pytest.importorskip("dolfinx")
    return runpy.run_path(str(ROOT / "demos" / f"{name}.py"))


def test_demo_of_many_loads_sticks_slips_and_lifts_off() -> None:
    found = demo("loop_over_loads")
    motions, amplitudes = found["motions"], found["amplitudes"]
    assert amplitudes[30.0] == pytest.approx(3.0 * amplitudes[10.0], rel=2e-3)
    assert amplitudes[60.0] > 10.0 * amplitudes[30.0]
    assert 1e3 * amplitudes[111.29] == pytest.approx(157.60, rel=2e-3)  # tests/cli/test_demos.py
    fractions = [fenicsrom.contact_fractions(motions[force]) for force in (30.0, 60.0, 111.29)]
    assert fractions[0]["stick"] == pytest.approx(1.0, rel=1e-12)
    assert fractions[1]["slip"] > 0.3 and fractions[1]["open"] == 0.0
    assert fractions[2]["open"] == pytest.approx(0.37, abs=0.02)


@pytest.mark.slow
def test_demo_of_matrices_in_scipy_moves_as_the_program_does() -> None:
    found = demo("hand_over_matrices")
    assert found["solution"].success
    assert found["difference"] < 1e-5
    assert np.abs(found["probe"]).max() > 0.01  # m: far in the nonlinear range


@pytest.mark.slow
def test_demo_built_from_python_rubs_and_balances_its_energy() -> None:
    found = demo("build_from_python")
    motion, stored = found["motion"], found["stored"]
    assert motion.relative_imbalance < 1e-6
    shares = fenicsrom.contact_fractions(motion)
    assert min(shares.values()) > 0.1
    # a straight cantilever as long as both legs is softer than the bracket, one leg is stiffer
    straight = [
        1.8751**2 / (2 * np.pi) * np.sqrt(207e9 * 0.03**2 / 12 / 7801.0) / length**2
        for length in (0.8, 0.4)
    ]
    assert straight[0] < stored.frequencies_hz[0] < straight[1]

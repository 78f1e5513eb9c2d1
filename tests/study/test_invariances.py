"""The same body in other units, another place, another direction or with other node numbers.

Lengths, masses and times of a scene are multiplied by powers of ten through the units in which the
scene is written, so that every key with a dimension takes part.
"""

from __future__ import annotations

from decimal import Decimal
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
from numpy.typing import NDArray
from support import STEEL, gmsh_session, touching

pytest.importorskip("dolfinx")

import fenicsrom
from fenicsrom.online.motion.measures import amplitude, peak_normal_force
from fenicsrom.scene import parse_scene
from fenicsrom.scene.keys import unit_system

pytestmark = pytest.mark.slow

Array = NDArray[np.float64]
SAME = 1e-8  # largest relative difference of two answers
ANGLE, AXIS = np.radians(37.0), np.array([1.0, 2.0, 3.0]) / np.sqrt(14.0)
FAR = np.array([6e3, -8e3, 0.0])  # m


def scene_table(kind: str) -> dict[str, Any]:
    """A beam of four elements whose tip slips and lifts off: "2D", "3D" or "rotating"."""
    d = 2 if kind == "2D" else 3
    x, y = np.eye(d)[0], np.eye(d)[1]
    table: dict[str, Any] = {
        "geometry": {"mesh": f"beam{d}d.geo", "dimension": d},  # its mesh is not used
        "material": STEEL | {"mass_damping": 20.0},
        "supports": [{"group": "root"}],
        "loads": [{"group": "tip", "direction": y.tolist(), "force": 40.0, "frequency": 30.0}],
        "contacts": [touching(normal=x.tolist(), preload=30.0, friction=0.3, normal_stiffness=2e4)],
        "basis": {"modes": 3},
        "time": {"steps_per_period": 60},
    }
    if d == 2:
        table["geometry"]["thickness"] = 0.02
    if kind == "rotating":
        table["rotation"] = {"speed_rpm": 600.0, "axis": [0.0, 0.0, 1.0], "point": [-0.1, 0.0, 0.0]}
        table["contacts"][0]["preload"] = 2000.0
    return table


class Answer(NamedTuple):
    """What must not change: frequencies (Hz), amplitudes (m), peak force (N), estimates, texts."""

    frequencies: Array
    amplitudes: Array
    force: float
    errors: Array
    warnings: int
    labels: tuple[str, ...]
    accepted: bool


def answer(table: dict[str, Any], mesh: Any) -> Answer:
    """The answer of a run; the amplitudes along the tangents count together."""
    study = fenicsrom.run(parse_scene(table, "test", Path.cwd()), mesh=mesh)
    motion = study.motions["reduced"]
    normal, *tangents = amplitude(motion)
    likely = [text for text in study.warnings if not text.startswith("implausible")]
    return Answer(
        study.modes.frequencies_hz[:3],
        np.array([normal, np.linalg.norm(tangents)]),
        peak_normal_force(motion),
        np.array([error.amplitude for error in study.errors.values()]),
        len(likely),
        study.basis.labels,
        study.unfinished is None,
    )


def assert_same(found: Answer, own: Answer, length: float = 1.0, force: float = 1.0) -> None:
    """Compare answers; lengths and forces of the first are multiplied."""
    assert found.labels == own.labels
    assert (found.warnings, found.accepted) == (own.warnings, own.accepted)
    np.testing.assert_allclose(found.amplitudes, length * own.amplitudes, rtol=SAME)
    np.testing.assert_allclose(found.force, force * own.force, rtol=SAME)
    np.testing.assert_allclose(found.errors, own.errors, rtol=1e-4, atol=1e-5)


@pytest.fixture(scope="module", params=["2D", "3D", "rotating"])
def kind(request: pytest.FixtureRequest) -> str:
    return str(request.param)


def turn(d: int) -> Array:
    """The rotation (d, d) by `ANGLE`, in space about `AXIS`."""
    c, s = np.cos(ANGLE), np.sin(ANGLE)
    if d == 2:
        return np.array([[c, -s], [s, c]])
    x, y, z = AXIS
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.eye(3) + s * cross + (1.0 - c) * cross @ cross


def beam_mesh(d: int, matrix: Array, offset: Array, shuffled: bool) -> Any:
    """The mesh of the beam x -> matrix x + offset, with its nodes in another order if shuffled."""
    with gmsh_session() as gmsh:
        occ = gmsh.model.occ
        if d == 2:
            occ.addRectangle(0.0, -0.005, 0.0, 0.5, 0.01)
        else:
            occ.addBox(0.0, -0.005, -0.01, 0.5, 0.01, 0.02)
        occ.synchronize()
        for name, x in (("root", 0.0), ("tip", 0.5)):
            box = gmsh.model.getEntitiesInBoundingBox(x - 1e-6, -1, -1, x + 1e-6, 1, 1, d - 1)
            gmsh.model.addPhysicalGroup(d - 1, [tag for _, tag in box], name=name)
        gmsh.model.addPhysicalGroup(d, [1], name="solid")
        gmsh.option.setNumber("Mesh.MeshSizeMax", 0.05)
        gmsh.model.mesh.generate(d)
        old = gmsh.model.mesh.getNodes()[0]
        if shuffled:
            gmsh.model.mesh.renumberNodes(old, np.random.default_rng(1).permutation(old))
        affine = np.eye(3, 4)
        affine[:d, :d], affine[:d, 3] = matrix, offset
        gmsh.model.mesh.affineTransform(affine.ravel())
        return fenicsrom.mesh_from_gmsh_model(d)


def placed(kind: str, matrix: Array, offset: Array) -> dict[str, Any]:
    """The table of a scene whose body, directions and axis are turned and moved."""
    table = scene_table(kind)
    for entry, key in ((table["loads"][0], "direction"), (table["contacts"][0], "normal")):
        entry[key] = (matrix @ entry[key]).tolist()
    if "rotation" in table:
        rotation = table["rotation"]
        rotation["axis"] = (matrix @ rotation["axis"]).tolist()
        rotation["point"] = (matrix @ rotation["point"] + offset).tolist()
    return table


@pytest.fixture(scope="module")
def own(kind: str) -> Answer:
    d = 2 if kind == "2D" else 3
    return answer(scene_table(kind), beam_mesh(d, np.eye(d), np.zeros(d), False))


@pytest.mark.parametrize("change", ["turned", "moved", "renumbered"])
def test_body_elsewhere_or_with_other_numbers_has_the_same_answer(
    change: str, kind: str, own: Answer
) -> None:
    d = 2 if kind == "2D" else 3
    matrix = turn(d) if change == "turned" else np.eye(d)
    offset = FAR[:d] if change == "moved" else np.zeros(d)
    mesh = beam_mesh(d, matrix, offset, change == "renumbered")
    found = answer(placed(kind, matrix, offset), mesh)
    np.testing.assert_allclose(found.frequencies, own.frequencies, rtol=SAME)
    assert_same(found, own)


@pytest.mark.parametrize(("length", "mass", "time"), [(-6, 3, 0), (3, -9, 0), (0, 9, -3)], ids=str)
def test_body_of_other_size_mass_and_time_has_the_same_answer(
    length: int, mass: int, time: int, kind: str, own: Answer, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The unit "cm" stands for another power of ten here, as do "g" and "ms"."""
    monkeypatch.setitem(unit_system.LENGTHS, "cm", Decimal(10) ** length)
    monkeypatch.setitem(unit_system.MASSES, "g", Decimal(10) ** mass)
    monkeypatch.setitem(unit_system.TIMES, "ms", Decimal(10) ** time)
    table = scene_table(kind) | {"units": {"length": "cm", "mass": "g", "time": "ms"}}
    table["loads"][0]["frequency"] *= 10.0**-time
    if "rotation" in table:
        table["rotation"]["speed_rpm"] *= 10.0**-time
    d = 2 if kind == "2D" else 3
    mesh = beam_mesh(d, 10.0**length * np.eye(d), np.zeros(d), False)
    found = answer(table, mesh)
    np.testing.assert_allclose(found.frequencies, 10.0**-time * own.frequencies, rtol=SAME)
    force = 10.0 ** (mass + length - 2 * time)
    assert_same(found, own, length=10.0**length, force=force)

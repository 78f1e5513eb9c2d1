"""The CalculiX deck of a scene: its mesh, keywords and numbers, and what it cannot hold."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from support import beam_scene, make_solid, refusal

pytest.importorskip("meshio")
pytest.importorskip("dolfinx")

from fenicsrom.cli import main
from fenicsrom.errors import ErrorKind
from fenicsrom.exchange.calculix import FIELD, Deck, write_deck
from fenicsrom.exchange.deck import scene_deck
from fenicsrom.formats import read
from fenicsrom.formats.abaqus_sets import Keyword, read_keywords
from fenicsrom.formats.shapes import SHAPES, facet_nodes
from fenicsrom.scene import Geometry, Scene
from tests.disks import CYCLIC, PERIODS, N, bladed, extruded, hub, ring, turned
from tests.disks import scene_of as scene_of_sector

SHORT = ("geometry.parameters.length=0.5", "geometry.parameters.elements_along=3")
PLY = {
    "young": [140e9, 10e9, 9e9],
    "poisson": [0.3, 0.28, 0.4],
    "shear": [5e9, 4.5e9, 3.5e9],
    "density": 1600.0,
}


def scene_of(dimension: int, *overrides: str, **tables: Any) -> Scene:
    """A short beam, clamped at its root, without contacts."""
    given = {"contacts": None, "loads": [], "probe": {"group": "tip"}} | tables
    return beam_scene(dimension, (*SHORT, *overrides), **given)


def written(deck: Deck, tmp_path: Path) -> list[Keyword]:
    """The keywords of a deck."""
    write_deck(tmp_path / "deck.inp", deck)
    return read_keywords(tmp_path / "deck.inp")


def data(keywords: list[Keyword], name: str) -> np.ndarray:
    """The numbers below all keywords of a name, one row for each line."""
    lines = [line.split(",") for word in keywords if word.name == name for line in word.lines]
    return np.array([[float(entry) for entry in line] for line in lines])


@pytest.mark.parametrize(
    ("dimension", "cells", "degree", "element"),
    [
        (3, "simplex", 2, "C3D10"),
        (3, "structured", 2, "C3D20"),
        (2, "simplex", 2, "CPE6"),
        (2, "structured", 2, "CPE8"),
        (2, "simplex", 1, "CPE3"),
    ],
)
def test_deck_is_read_back_with_its_mesh_and_groups(
    dimension: int, cells: str, degree: int, element: str, tmp_path: Path
) -> None:
    plane = ["geometry.plane='strain'"] if dimension == 2 else []
    shape = f"geometry.cells='{cells}'", f"geometry.degree={degree}"
    deck = scene_deck(scene_of(dimension, *shape, *plane))
    assert deck.element == element
    write_deck(tmp_path / "deck.inp", deck)
    found = read(tmp_path / "deck.inp")
    np.testing.assert_allclose(found.points, deck.mesh.points, rtol=1e-13, atol=1e-16)
    (block,) = [block for block in found.blocks if block.name == element]
    (ours,) = deck.mesh.blocks
    assert block.kind == ours.kind
    np.testing.assert_array_equal(block.nodes, ours.nodes)
    assert ours.groups["solid"].all() and block.groups["solid"].all()
    for name in ("root", "tip", "load"):
        np.testing.assert_array_equal(
            np.sort(found.node_groups[name]), np.sort(deck.mesh.node_groups[name])
        )


def test_deck_is_a_mesh_of_a_scene_with_the_same_facets(tmp_path: Path) -> None:
    from mpi4py import MPI

    from fenicsrom.fem.mesh.mesh import build_mesh

    scene = scene_of(3, "geometry.cells='simplex'")
    write_deck(tmp_path / "deck.inp", scene_deck(scene))
    geometry = Geometry(mesh=tmp_path / "deck.inp", dimension=3)
    ours, again = (build_mesh(found, MPI.COMM_SELF) for found in (scene.geometry, geometry))
    assert {"root", "tip"} <= set(again.facet_groups)
    for name in ("root", "tip"):
        assert again.facets(name).size == ours.facets(name).size > 0
    np.testing.assert_allclose(again.bounds(), ours.bounds(), atol=1e-12)


@pytest.mark.parametrize(("dimension", "cells"), [(2, "structured"), (3, "simplex")])
def test_cells_of_deck_have_positive_volume_if_those_of_the_mesh_are_mirrored(
    dimension: int, cells: str, tmp_path: Path
) -> None:
    first = scene_deck(scene_of(dimension, f"geometry.cells='{cells}'"))
    mirror = replace(first.mesh, points=first.mesh.points * [1.0, -1.0, 1.0])
    write_deck(tmp_path / "mirror.inp", replace(first, mesh=mirror))
    geometry: dict[str, Any] = {"mesh": str(tmp_path / "mirror.inp"), "dimension": dimension}
    if dimension == 2:
        geometry["thickness"] = 0.02
    scene = beam_scene(
        dimension, geometry=geometry, contacts=None, loads=[], probe={"group": "tip"}
    )
    (block,) = first.mesh.blocks
    beside = {9: (1, 2), 16: (1, 3), 11: (1, 2, 3), 17: (1, 3, 4)}[block.kind]
    for deck in (first, scene_deck(scene)):
        (block,) = deck.mesh.blocks
        x = deck.mesh.points[block.nodes][:, :, :dimension]
        assert np.all(np.linalg.det(x[:, beside] - x[:, :1]) > 0.0)
        for k, (a, b) in enumerate(SHAPES[block.kind].edges, SHAPES[block.kind].corners):
            np.testing.assert_allclose(x[:, k], 0.5 * (x[:, a] + x[:, b]), atol=1e-12)


@pytest.mark.parametrize("cells", ["simplex", "structured"])
def test_forces_do_the_work_of_the_load(cells: str) -> None:
    """A traction that acts on the whole tip does the work t · ∫ u dA on any quadratic motion."""
    load = {"group": "tip", "direction": [0.0, 1.0, 0.0], "traction": 2.0}
    deck = scene_deck(scene_of(3, f"geometry.cells='{cells}'", loads=[load]))
    side = 0.0254
    x, y, z = deck.mesh.points.T
    motion = 3.0 + y * z + 5.0 * z**2 - 2.0 * y
    middle_y, middle_z = (float(np.mean([c.min(), c.max()])) for c in (y, z))
    mean = 3.0 + middle_y * middle_z - 2.0 * middle_y + 5.0 * (middle_z**2 + side**2 / 12.0)
    assert deck.forces[:, 1] @ motion == pytest.approx(2.0 * side**2 * mean, rel=1e-12)
    assert not np.any(deck.forces[:, [0, 2]])
    assert not np.any(deck.forces[x < x.max() - 1e-9])


def test_keywords_hold_the_scene(tmp_path: Path) -> None:
    scene = scene_of(
        3,
        "geometry.cells='simplex'",
        "basis.modes=4",
        material=PLY | {"axes": [[0.6, 0.8, 0.0], [0.0, 0.0, 1.0]]},
        loads=[{"group": "tip", "direction": [0.0, 1.0, 0.0], "force": -7.0}],
        supports=[{"group": "root"}, {"group": "tip", "components": ["z"]}],
        rotation={"speed_rpm": 300.0, "axis": [0.0, 0.0, 2.0], "point": [-0.1, 0.2, 0.0]},
        attachments=[{"node": [0.5, 0.0127, 0.0127], "stiffness": 30.0, "mass": 2.0}],
    )
    found = written(scene_deck(scene), tmp_path)
    names = [word.name for word in found]
    steps = [word.parameters for word in found if word.name == "STEP"]
    assert list(steps[0]) == ["NLGEOM", "INC"] and list(steps[1]) == ["PERTURBATION"]
    assert names.index("STATIC") < names.index("END STEP") < names.index("FREQUENCY")
    assert data(found, "FREQUENCY") == 4.0
    constants = [*PLY["young"], *PLY["poisson"], *PLY["shear"]]
    lines = next(word.lines for word in found if word.name == "ELASTIC")
    assert [float(entry) for line in lines for entry in line.split(",")] == constants
    np.testing.assert_allclose(data(found, "ORIENTATION"), [[0.6, 0.8, 0, 0, 0, 1]], atol=1e-15)
    assert data(found, "DENSITY") == 1600.0
    forces = data(found, "CLOAD")
    assert np.all(forces[:, 1] == 2.0) and forces[:, 2].sum() == pytest.approx(-7.0)
    centrifugal = next(word.lines for word in found if word.name == "DLOAD")
    omega = 10.0 * np.pi
    for line in centrifugal:
        numbers = [float(entry) for entry in line.split(",")[2:]]
        np.testing.assert_allclose(numbers, [omega**2, -0.1, 0.2, 0, 0, 0, 1], rtol=1e-12)
    mass = next(w for w in found if w.name == "ELEMENT" and w.parameters["TYPE"] == "MASS")
    assert [line.split(",")[0] for line in centrifugal[1:]] == [mass.lines[0].split(",")[0]]
    solid = make_solid(scene)
    clamped = data(found, "BOUNDARY")
    assert len(clamped) == solid.clamped.size and np.all(clamped[:, 1] == clamped[:, 2])
    assert names.count("SPRING") == 2, "z is clamped there"
    assert np.all(data(found, "SPRING") == np.array([[1.0], [30.0], [2.0], [30.0]]))


def test_slanted_supports_are_equations_of_their_nodes(tmp_path: Path) -> None:
    """The equations of a node have the directions as their solutions, each a first component."""
    supports = [
        {"group": "root"},
        {"node": [0.5, 0.0127, 0.0127], "normal": [0.0, 3.0, 4.0]},
        {"node": [0.5, -0.0127, 0.0127], "normal": [1.0, 2.0, 2.0]},
        {"node": [0.5, -0.0127, 0.0127], "normal": [2.0, -2.0, 1.0]},
    ]
    deck = scene_deck(scene_of(3, "geometry.cells='simplex'", supports=supports))
    held: dict[int, list[np.ndarray]] = {}
    for node, terms in deck.equations:
        row = np.zeros(3)
        for axis, factor in terms:
            row[axis] = factor
        assert terms[0][1] == 1.0
        held.setdefault(node, []).append(row)
        beside = [other for n, other in deck.equations if n == node and other != terms]
        assert terms[0][0] not in [axis for other in beside for axis, _ in other]
    one, two = sorted(held.values(), key=len)
    np.testing.assert_allclose(one, [[0.0, 0.75, 1.0]], atol=1e-12)
    np.testing.assert_allclose(np.array(two) @ [2.0, 1.0, -2.0], 0.0, atol=1e-12)
    assert np.linalg.matrix_rank(two) == 2
    keywords = written(deck, tmp_path)
    words = [word for word in keywords if word.name == "EQUATION"]
    assert [word.lines[0] for word in words].count("2") >= 1 and len(words) == 3
    places = {int(number): place for number, *place in data(keywords, "NODE")}
    for word, (node, terms) in zip(words, deck.equations, strict=True):
        assert len(word.lines[1].split(",")) == 3 * int(word.lines[0])
        numbers, axes, factors = np.array(word.lines[1].split(","), float).reshape(-1, 3).T
        assert len({*numbers}) == 1 and tuple(zip(axes - 1, factors, strict=True)) == terms
        np.testing.assert_allclose(places[int(numbers[0])], deck.mesh.points[node], atol=1e-12)
        assert np.abs(places[int(numbers[0])]) == pytest.approx([0.5, 0.0127, 0.0127])


@pytest.mark.parametrize(("dimension", "cells", "count"), [(3, "simplex", 2), (2, "simplex", 1)])
def test_follower_pressure_acts_on_the_faces_of_its_region(
    dimension: int, cells: str, count: int, tmp_path: Path
) -> None:
    load = {"group": "tip", "pressure": 5.0, "follower": True}
    deck = scene_deck(scene_of(dimension, f"geometry.cells='{cells}'", loads=[load]))
    assert not np.any(deck.forces) and sum("follower" in note for note in deck.notes) == 1
    (pressed,) = deck.pressures
    assert len(pressed.cells) == count
    (block,) = deck.mesh.blocks
    faces = facet_nodes(block.kind)
    for cell, face in zip(pressed.cells, pressed.faces, strict=True):
        assert set(block.nodes[cell, faces[face]]) <= set(deck.mesh.node_groups["tip"])
    (lines,) = [word.lines for word in written(deck, tmp_path) if word.name == "DLOAD"]
    assert len(lines) == count
    wanted = f"{1 + pressed.cells[0]}, P{1 + pressed.faces[0]}, 5.0"
    assert lines[0] == wanted


def test_linear_scene_has_no_geometric_effects(tmp_path: Path) -> None:
    load = {"group": "tip", "direction": [0.0, 1.0], "force": 3.0}
    scene = scene_of(2, "geometrically_nonlinear=false", loads=[load])
    words = written(scene_deck(scene), tmp_path)
    assert [word.parameters for word in words if word.name == "STEP"] == [{}, {}]
    free = written(scene_deck(scene_of(2)), tmp_path)
    assert [word.name for word in free if word.name in ("STATIC", "FREQUENCY")] == ["FREQUENCY"]


def test_deck_of_frequencies_has_no_load_that_varies(tmp_path: Path) -> None:
    varying = {"group": "tip", "direction": [0.0, 1.0], "force": 3.0, "frequency": 2.0}
    static = {"group": "tip", "direction": [1.0, 0.0], "force": 5.0}
    steps = ("time.steps_per_period=20",)
    for loads, kept in (([varying], []), ([varying, static], ["STATIC", "CLOAD"])):
        scene = scene_of(2, *steps, loads=loads)
        found = [word.name for word in written(scene_deck(scene, frequencies=True), tmp_path)]
        steps_of = [name for name in found if name in ("STATIC", "CLOAD", "FREQUENCY", "DYNAMIC")]
        assert steps_of == [*kept, "FREQUENCY"] and "AMPLITUDE" not in found
        assert "DYNAMIC" in [word.name for word in written(scene_deck(scene), tmp_path)]


def test_materials_of_groups_have_their_cells_and_thickness(tmp_path: Path) -> None:
    steel = {"young": 207e9, "poisson": 0.28, "density": 7801.0}
    groups = [{"group": "solid", **steel, "density": 10.0, "thickness": 0.5}]
    deck = scene_deck(scene_of(2, materials=groups))
    (section,) = deck.sections
    assert section.cells.size == len(deck.mesh.blocks[0].nodes)
    words = written(deck, tmp_path)
    assert data(words, "DENSITY") == 10.0 and data(words, "SOLID SECTION") == 0.5


def test_loads_in_time_are_a_transient_of_the_scenes_steps(tmp_path: Path) -> None:
    """The sum of force times displacement, in rigid translation, is the size of the load."""
    forces = [
        {"group": "tip", "direction": [0.0, 0.6, 0.8], "force": 5.0, "frequency": 2.0},
        {"direction": [0.0, 0.0, 1.0], "acceleration": 3.0, "frequency": 2.0, "phase": 0.3},
    ]
    scene = scene_of(3, "geometry.cells='simplex'", loads=forces, time={"steps_per_period": 16})
    deck = scene_deck(scene)
    words = written(deck, tmp_path)
    assert [word.name for word in words if word.name in ("FREQUENCY", "DYNAMIC")] == [
        "FREQUENCY",
        "DYNAMIC",
    ]
    np.testing.assert_allclose(data(words, "DYNAMIC"), [[0.03125, 1.5]])
    table = data(words, "AMPLITUDE").reshape(2, 49, 2)
    times = np.arange(49) * 0.03125
    for rows, expected in zip(
        table,
        (5.0 * np.sin(4.0 * np.pi * times), 3.0 * np.sin(4.0 * np.pi * times + 0.3)),
        strict=True,
    ):
        np.testing.assert_allclose(rows[:, 0], times, atol=1e-15)
        np.testing.assert_allclose(rows[:, 1], expected, atol=1e-12)
    assert deck.transient is not None
    np.testing.assert_allclose(deck.transient.forces[0].sum(axis=0), [0.0, 0.6, 0.8], atol=1e-12)
    assert sum(word.name == "CLOAD" for word in words) == 2
    adaptive = replace(scene, time=scene_of(3, time={"tolerance": 1e-3, "duration": 1.0}).time)
    found = scene_deck(adaptive)
    assert found.transient is None and any("fixed time step" in note for note in found.notes)


def test_deck_says_what_it_leaves_out(tmp_path: Path) -> None:
    scene = beam_scene(3, (*SHORT, "rotation={speed_rpm=10, axis=[0,0,1], coriolis=true}"))
    notes = scene_deck(scene).notes
    for words in ("contacts", "damping", "Coriolis", "stiffer"):
        assert sum(words in note for note in notes) == 1
    assert not scene_deck(scene_of(3, "geometry.cells='simplex'", "material.mass_damping=0")).notes


def test_numbers_fit_the_fields_that_calculix_reads(tmp_path: Path) -> None:
    shift = {"speed_rpm": 1e3 / 3.0, "axis": [1e-9, 1.0, -1.0 / 3.0], "point": [1e-17, -1 / 3, 0.0]}
    deck = scene_deck(scene_of(3, "geometry.cells='simplex'", rotation=shift))
    for word in written(deck, tmp_path):
        for line in word.lines:
            assert all(len(entry.strip()) <= FIELD for entry in line.split(","))
            assert line.count(",") <= 15


def test_sets_have_names_of_their_own_without_regard_to_case(tmp_path: Path) -> None:
    groups = {"a b": [0], "A_B": [1], "all_cells": [2]}
    deck = scene_deck(scene_of(2))
    deck.mesh.node_groups.clear()
    deck.mesh.node_groups.update({name: np.array(nodes) for name, nodes in groups.items()})
    words = written(deck, tmp_path)
    names = [word.parameters["NSET"] for word in words if word.name == "NSET"]
    assert names == ["a_b", "A_B_2", "all_cells_2", "PROBE"]


def test_sector_is_a_cyclic_tie_of_its_cut_faces(tmp_path: Path) -> None:
    """The following face is the leading one turned, and its nodes have no other condition."""
    points, cells, _ = extruded((*bladed(), {}))
    scene = scene_of_sector(
        tmp_path,
        points,
        cells,
        cyclic=CYCLIC | {"axis": [0.0, 0.0, 2.0], "diameters": [3, 1], "mistuning": [0.01] * N},
        loads=[{"group": "rim", "direction": [0.0, 0.0, 1.0], "force": 1.0, "frequency": 9.0}],
        probe={"group": "rim"},
        basis={"modes": 4},
        time=PERIODS,
    )
    deck = scene_deck(scene)
    assert sum("no [cyclic]" in note or "mistuning" in note for note in deck.notes) == 2
    words = written(deck, tmp_path)
    places = {int(number): place for number, *place in data(words, "NODE")}
    sets = {
        word.parameters["NSET"]: [int(entry) for line in word.lines for entry in line.split(",")]
        for word in words
        if word.name == "NSET"
    }
    surfaces = {w.parameters["NAME"]: w.lines[0] for w in words if w.name == "SURFACE"}
    (tie,) = [word for word in words if word.name == "TIE"]
    following, leading = (sets[surfaces[name.strip()]] for name in tie.lines[0].split(","))
    own = np.array([places[node] for node in leading])
    near = [turned([places[node] for node in following], sense) for sense in (1.0, -1.0)]
    apart = [np.linalg.norm(x[:, None] - own, axis=2).min(axis=1).max() for x in near]
    assert len(following) == len(leading) == 8 and min(apart) < 1e-12
    (model,) = [word for word in words if word.name == "CYCLIC SYMMETRY MODEL"]
    assert model.parameters["N"] == str(N) and tie.parameters["NAME"] == model.parameters["TIE"]
    np.testing.assert_allclose(data(words, "CYCLIC SYMMETRY MODEL"), [[0, 0, 0, 0, 0, 1]])
    held = {int(row[0]) for row in data(words, "BOUNDARY")}
    assert held == set(sets["bore"]) - set(following)
    steps = [word.parameters for word in words if word.name == "SELECT CYCLIC SYMMETRY MODES"]
    assert [(step["NMIN"], step["NMAX"]) for step in steps] == [("1", "1"), ("3", "3")]
    assert data(words, "FREQUENCY").tolist() == [[8.0], [8.0]]
    again = read(tmp_path / "deck.inp")
    told = "; ".join((*again.not_read, *again.physics.not_taken))
    assert "*CYCLIC SYMMETRY MODEL (give [cyclic])" in told and "*TIE of the cut faces" in told
    assert {place for place, _ in again.physics.supports} == {"bore"}


@pytest.mark.parametrize(("part", "key"), [(ring, "cyclic"), (hub, "cyclic.left")])
def test_disk_that_calculix_cannot_make_is_refused(tmp_path: Path, part: Any, key: str) -> None:
    """Of plane cells, or with cut faces that meet on the axis."""
    axis = {} if part is ring else {"axis": [0.0, 0.0, 1.0]}
    kind = ErrorKind.CONFLICT if part is ring else ErrorKind.PLACE
    with refusal(kind, key):
        scene_deck(scene_of_sector(tmp_path, *part(), cyclic=CYCLIC | axis))


@pytest.mark.parametrize(
    ("key", "tables"),
    [
        (
            "supports",
            {"supports": [{"group": "root"}, {"node": [0.5, 0.0, 0.0], "components": ["x"]}]},
        ),
        ("attachments", {"attachments": [{"group": "tip", "mass": 1.0}]}),
    ],
)
def test_node_that_elements_of_calculix_lack_is_refused(key: str, tables: dict[str, Any]) -> None:
    overrides = ["geometry.parameters.elements_through=1"]
    with refusal(ErrorKind.CONFLICT, key):
        scene_deck(scene_of(3, *overrides, **tables))


def test_command_writes_the_deck_or_says_what_is_missing(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    demo = Path(__file__).parents[2] / "demos" / "slip_liftoff_2d.toml"
    deck = tmp_path / "beam.inp"
    words = ["export", str(demo), "--format", "inp", "--output", str(deck)]
    assert main([*words, "--set", "geometry.parameters.elements_along=4"]) == 0
    assert len(read(deck).blocks[0].nodes) > 0
    out = capsys.readouterr().out
    assert "contacts with friction are left out" in out and "ccx" in out
    for wrong in (
        ["export", str(demo), "--format", "mat"],
        ["export", str(tmp_path / "reduced_model.npz"), "--format", "inp"],
        ["export", str(tmp_path / "none.toml"), "--format", "inp"],
        [*words, "--set", "geometry.mesh='none.msh'"],
    ):
        assert main(wrong) == 2
        error = capsys.readouterr().err
        assert "Traceback" not in error and error.strip().count("\n") == 0

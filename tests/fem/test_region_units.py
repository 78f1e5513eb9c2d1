"""Numbers of facets, edges and nodes in other units than SI give the same contacts and motion."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mpi4py import MPI

from fenicsrom import build_model, build_solid, make_scene
from fenicsrom.assess.curves.response_problem import family_of
from fenicsrom.exchange.deck import scene_deck
from fenicsrom.fem.mesh.mesh import Ints
from fenicsrom.fem.solid.finer import FinerSolid
from fenicsrom.online.contact.points import contacts_of
from fenicsrom.scene import Scene
from fenicsrom.study.forecast import region_units, set_up

pytestmark = pytest.mark.slow

BAR = {
    2: """
Point(1) = {0, 0, 0};  Point(2) = {0.4, 0, 0};  Point(3) = {0.4, 0.02, 0};  Point(4) = {0, 0.02, 0};
Line(1) = {1, 2};  Line(2) = {2, 3};  Line(3) = {3, 4};  Line(4) = {4, 1};
Curve Loop(1) = {1, 2, 3, 4};  Plane Surface(1) = {1};
Transfinite Curve {1, 3} = 5;  Transfinite Curve {2, 4} = 2;  Transfinite Surface {1};
Recombine Surface {1};
Physical Surface("body") = {1};  Physical Curve("root") = {4};  Physical Curve("facets") = {2};
Physical Point("nodes") = {2, 3};
""",
    3: """
Point(1) = {0, 0, 0};  Point(2) = {0, 0.02, 0};  Point(3) = {0, 0.02, 0.03};
Point(4) = {0, 0, 0.03};
Line(1) = {1, 2};  Line(2) = {2, 3};  Line(3) = {3, 4};  Line(4) = {4, 1};
Curve Loop(1) = {1, 2, 3, 4};  Plane Surface(1) = {1};
Transfinite Curve {1:4} = 2;  Transfinite Surface {1};  Recombine Surface {1};
out[] = Extrude {0.4, 0, 0} { Surface{1}; Layers{4}; Recombine; };
ends[] = Boundary { Surface{out[0]}; };
points[] = PointsOf { Surface{out[0]}; };
Physical Volume("body") = {out[1]};  Physical Surface("root") = {1};
Physical Surface("facets") = {out[0]};  Physical Curve("edges") = {ends[1]};
Physical Point("nodes") = {points[0], points[2]};
""",
}
REGIONS = [(2, "facets"), (2, "nodes"), (3, "facets"), (3, "edges"), (3, "nodes")]
LENGTHS = {"facets": 2, "edges": 1, "nodes": 0}  # dimension of the region
INCH, POUND = 0.0254, 4.4482216152605
SYSTEMS: dict[str, tuple[dict[str, str], float, float, float]] = {
    "mm, t, s": ({"length": "mm", "mass": "t"}, 1e-3, 1e3, 1.0),
    "mm, kg, ms": ({"length": "mm", "mass": "kg", "time": "ms"}, 1e-3, 1.0, 1e-3),
    "in, slinch, s": ({"length": "in", "mass": "slinch"}, INCH, POUND / INCH, 1.0),
}


def bar(
    folder: Path, dimension: int, region: str, system: str | None = None, **tables: Any
) -> Scene:
    """A bar that is pressed against a wall at a region, and held by springs and dashpots there.

    Args:
        folder: of the mesh.
        dimension: of the body.
        region: its group "facets", "edges" or "nodes".
        system: the units; None for SI units.
        tables: more tables of the scene.
    """
    names, length, mass, time = SYSTEMS[system] if system else ({}, 1.0, 1.0, 1.0)
    force = mass * length / time**2
    per = length ** LENGTHS[region]
    (folder / "bar.geo").write_text(BAR[dimension])
    across = [0.0, 1.0, 0.0][:dimension]
    geometry = {"mesh": "bar.geo", "dimension": dimension, "degree": 1}
    return make_scene(
        folder=folder,
        units=names,
        geometry=geometry | ({"thickness": 0.03 / length} if dimension == 2 else {}),
        material={
            "young": 7e10 * length**2 / force,
            "poisson": 0.3,
            "density": 2700.0 * length**3 / mass,
            "mass_damping": 40.0 * time,
        },
        geometrically_nonlinear=False,
        basis={"modes": 2},
        supports=[{"group": "root"}],
        attachments=[
            {
                "group": region,
                "mass": 0.01 / mass,
                "stiffness_per_area": 3e3 * length * per / force,
                "damping_per_area": 2.0 * length * per / force / time,
            }
        ],
        loads=[{"group": "facets", "direction": across, "force": 40.0 / force, "frequency": 90.0}],
        contacts=[
            {
                "group": region,
                "at": "nodes",
                "normal": across,
                "preload": 10.0 * per / force,
                "normal_stiffness": 2e4 * length * per / force,
                "tangential_stiffness": 1e4 * length * per / force,
                "friction": 0.3,
            }
        ],
        **tables,
    )


@pytest.mark.parametrize(("dimension", "region"), REGIONS)
def test_region_in_other_units_has_the_numbers_of_si_units(
    tmp_path: Path, dimension: int, region: str
) -> None:
    plain = bar(tmp_path, dimension, region)
    solid = build_solid(plain, MPI.COMM_SELF)
    measure = {"facets": 0.02 * 0.03, "nodes": 2.0}.get(region)
    if measure is None:
        measure = float(np.ptp(solid.points.position, axis=0).max())
        assert measure in (0.02, 0.03)
    expected = contacts_of(plain, solid.points)
    assert expected.normal_stiffness.sum() == pytest.approx(2e4 * measure, rel=1e-12)
    assert solid.springs.max() * len(solid.points.contact) == pytest.approx(3e3 * measure)
    for system in SYSTEMS:
        scene = bar(tmp_path, dimension, region, system)
        other = build_solid(scene, MPI.COMM_SELF)
        found = contacts_of(scene, other.points)
        for name in ("preload", "normal_stiffness", "tangential_stiffness"):
            np.testing.assert_allclose(getattr(found, name), getattr(expected, name), rtol=1e-12)
        for name in ("springs", "point_masses"):
            np.testing.assert_allclose(getattr(other, name), getattr(solid, name), rtol=1e-12)
        np.testing.assert_allclose(other.dashpots.data, solid.dashpots.data, rtol=1e-12)


DECKS = {
    "brick": """*NODE
1, 0, 0, 0
2, 0, 10, 0
3, 0, 10, 10
4, 0, 0, 10
5, 40, 0, 0
6, 40, 10, 0
7, 40, 10, 10
8, 40, 0, 10
*ELEMENT, TYPE=C3D8
1, 1, 2, 3, 4, 5, 6, 7, 8
*NSET, NSET=root
1, 2, 3, 4
*NSET, NSET=edge
5, 6
*NSET, NSET=face
5, 6, 7, 8
""",
    "quadratic": """*NODE
1, 0, 0, 0
2, 20, 0, 0
3, 0, 20, 0
4, 0, 0, 20
5, 10, 0, 0
6, 10, 10, 0
7, 0, 10, 0
8, 0, 0, 10
9, 10, 0, 10
10, 0, 10, 10
11, 20, 20, 20
12, 20, 10, 10
13, 10, 20, 10
14, 10, 10, 20
*ELEMENT, TYPE=C3D10
1, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10
2, 2, 3, 4, 11, 6, 10, 9, 12, 13, 14
*NSET, NSET=root
1, 2, 3, 5, 6, 7
*NSET, NSET=edge
4, 11, 14
*NSET, NSET=half
4, 14
*NSET, NSET=face
2, 4, 11, 9, 12, 14
""",
    "plane": """*NODE
1, 0, 0
2, 20, 0
3, 40, 0
4, 40, 20
5, 20, 20
6, 0, 20
7, 10, 0
8, 30, 0
9, 40, 10
10, 30, 20
11, 10, 20
12, 0, 10
13, 20, 10
*ELEMENT, TYPE=CPS8
1, 1, 2, 5, 6, 7, 13, 11, 12
2, 2, 3, 4, 5, 8, 9, 10, 13
*NSET, NSET=root
1, 6, 12
*NSET, NSET=inner
2, 5, 13
*NSET, NSET=face
3, 4, 9
""",
}


@pytest.mark.parametrize(
    ("deck", "group", "unit", "total", "degree"),
    [
        ("brick", "edge", "node", 2 * 2e4, 2),
        ("brick", "face", "mm² of facets", 100 * 2e4, 1),
        ("quadratic", "edge", "node", 3 * 2e4, 1),
        ("quadratic", "half", "node", 2 * 2e4, 2),
        ("plane", "inner", "node", 3 * 2e4, 1),
        ("plane", "face", "mm² of facets", 20 * 2e4, 2),
    ],
)
def test_node_set_of_a_deck_has_the_stiffness_of_its_nodes_unless_it_is_a_face(
    tmp_path: Path, deck: str, group: str, unit: str, total: float, degree: int
) -> None:
    (tmp_path / "bar.inp").write_text(DECKS[deck])
    d = 2 if deck == "plane" else 3
    across = [0.0, 0.0, 1.0][-d:]
    contact = {"group": group, "at": "nodes", "normal": across, "friction": 0.1}
    contact |= {"normal_stiffness": 20.0, "tangential_stiffness": 5.0}
    thick = {"thickness": 1.0} if d == 2 else {}
    scene = make_scene(
        folder=tmp_path,
        units={"length": "mm", "mass": "t"},
        geometry={"mesh": "bar.inp", "dimension": d, "degree": degree, **thick},
        material={"young": 2.1e5, "poisson": 0.3, "density": 7.85e-9},
        supports=[{"group": "root"}],
        attachments=[{"group": group, "stiffness_per_area": 20.0}],
        loads=[{"group": "face", "direction": across, "force": 1.0, "frequency": 1.0}],
        contacts=[contact],
    )
    solid = set_up(scene)
    assert contacts_of(scene, solid.points).normal_stiffness.sum() == pytest.approx(total)
    finer = FinerSolid(scene, solid)  # has more nodes on the edges
    for found in (solid, finer):
        assert found.springs.sum() == pytest.approx(d * total)  # along each direction
    assert finer.points.tributary_area.all()
    assert region_units(scene, solid) == [
        f"contacts[0].normal_stiffness = 20 N/mm per {unit}",
        f"contacts[0].tangential_stiffness = 5 N/mm per {unit}",
        f"attachments[0].stiffness_per_area = 20 N/mm per {unit}",
    ]


@pytest.mark.parametrize(
    ("deck", "parts"), [("brick", ("1, 2", "3, 4")), ("plane", ("1, 12", "6"))]
)
def test_node_sets_that_hold_a_face_together_hold_its_middle(
    tmp_path: Path, deck: str, parts: tuple[str, ...]
) -> None:
    sets = "".join(f"*NSET, NSET=part{k}\n{nodes}\n" for k, nodes in enumerate(parts))
    (tmp_path / "bar.inp").write_text(DECKS[deck] + sets)
    d = 2 if deck == "plane" else 3
    thick = {"thickness": 1.0} if d == 2 else {}

    def clamped(*supports: tuple[str, str]) -> Ints:
        scene = make_scene(
            folder=tmp_path,
            geometry={"mesh": "bar.inp", "dimension": d, "degree": 2, **thick},
            material={"young": 2.1e5, "poisson": 0.3, "density": 7.85e-9},
            supports=[{"group": name, "components": list(axes)} for name, axes in supports],
            probe={"group": "face"},
        )
        return set_up(scene).clamped

    shared, more = "xyz"[: d - 1], "xyz"[d - 1 : d]
    held = clamped(("part0", shared + more), ("part1", shared + more))
    np.testing.assert_array_equal(held, clamped(("root", shared + more)))
    held = clamped(("part0", shared), ("part1", shared + more))
    np.testing.assert_array_equal(held, clamped(("root", shared), ("part1", more)))


def test_node_of_a_set_beside_its_facets_is_named(tmp_path: Path) -> None:
    (tmp_path / "bar.inp").write_text(DECKS["plane"] + "*NSET, NSET=mixed\n3, 4, 9, 5\n")
    scene = make_scene(
        folder=tmp_path,
        geometry={"mesh": "bar.inp", "dimension": 2, "thickness": 1.0},
        material={"young": 2.1e5, "poisson": 0.3, "density": 7.85e-9},
        supports=[{"group": "root"}],
        attachments=[{"group": "mixed", "stiffness_per_area": 20.0}],
        probe={"group": "face"},
    )
    said = [note for note in set_up(scene).warnings if "on none of its facets" in note]
    assert len(said) == 1 and "1 node of the group 'mixed' is" in said[0]


def test_node_set_of_a_deck_is_exported_with_its_nodes(tmp_path: Path) -> None:
    (tmp_path / "bar.inp").write_text(DECKS["brick"])
    scene = make_scene(
        folder=tmp_path,
        geometry={"mesh": "bar.inp", "dimension": 3, "degree": 2},
        material={"young": 2.1e11, "poisson": 0.3, "density": 7850.0},
        supports=[{"group": "root"}],
        loads=[{"group": "face", "direction": [0, 0, 1], "force": 1.0}],
    )
    groups = scene_deck(scene).mesh.node_groups
    assert {name: len(nodes) for name, nodes in groups.items()} == {"root": 8, "edge": 2, "face": 8}


def test_region_in_millimetres_moves_as_in_si_units(tmp_path: Path) -> None:
    dimension, region = 3, "edges"
    plain, other = (
        build_model(bar(tmp_path, dimension, region, system)).simulate()
        for system in (None, "mm, t, s")
    )
    assert np.ptp(plain.gap) > 1e-5
    np.testing.assert_allclose(other.gap, plain.gap, rtol=1e-9, atol=1e-15)
    # under the scene in SI units, the model of the scene in mm has the numbers of that scene
    free = (
        replace(bar(tmp_path, dimension, region, system), attachments=())
        for system in (None, "mm, t, s")
    )
    alone, stored = map(build_model, free)
    found = stored.with_scene(alone.scene).simulate()
    np.testing.assert_allclose(found.gap, alone.simulate().gap, rtol=1e-9, atol=1e-15)


def test_family_over_a_number_is_that_of_si_units(tmp_path: Path) -> None:
    parameter, value, found = "contacts.0.preload", 12.0, []
    for system, unit in ((None, 1.0), ("in, slinch, s", POUND)):
        response = {"parameter": parameter, "first": 0.5 * value / unit, "last": value / unit}
        scene = bar(tmp_path, 3, "nodes", system, response=response)
        assert scene.response is not None
        stored = build_model(scene)
        problem = family_of(stored)(scene.response.last)
        found.append((problem.contacts.preload, problem.model.load_histories.sines))
        assert stored.with_values({"loads.0.force": 7.0}).scene.loads[0].size == 7.0
    for one, other in zip(*found, strict=True):
        np.testing.assert_allclose(other, one, rtol=1e-12)

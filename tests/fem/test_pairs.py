"""Contact between bodies: averaged rows, the equilibrium, and what is refused."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from mpi4py import MPI
from numpy.typing import NDArray
from support import refusal

import fenicsrom as fr
from fenicsrom.assess.curves.response_problem import scenes_of_curves
from fenicsrom.assess.errors.plausibility import turns
from fenicsrom.assess.studies.axes import cases_of, scales_of
from fenicsrom.assess.studies.stability import Verdict, build, examine
from fenicsrom.errors import ConvergenceError, ErrorKind
from fenicsrom.exchange.deck import scene_deck
from fenicsrom.fem.body import pairs
from fenicsrom.fem.body.stress_points import stress_table
from fenicsrom.fem.mesh.mesh import build_mesh
from fenicsrom.fem.solid.reaction_rows import reaction_table
from fenicsrom.fem.solid.solid import Solid, solid_of
from fenicsrom.notes import NoteKind
from fenicsrom.online.contact.points import trial_forces
from fenicsrom.online.motion.motion import Motion
from fenicsrom.online.store.scene_changes import Trained, changed_key, shares_model
from fenicsrom.online.stress.reactions import Recovery, find_stresses
from fenicsrom.post.run.summary import quantities, unjudged
from fenicsrom.reduction import training
from fenicsrom.reduction.modes import component_modes
from fenicsrom.reduction.snapshots import Snapshots
from fenicsrom.scene import Families, Response, Scene, make_scene, scene_table
from fenicsrom.study.building import contact_frequencies
from fenicsrom.study.offline_cache import modes_table
from fenicsrom.study.stage import Run
from tests.boxes import blocks, stacked

Array = NDArray[np.float64]
STEEL = {"young": 210e9, "poisson": 0.3, "density": 7800.0}


def scene_of(mesh: Path, d: int, contact: dict[str, Any], degree: int = 1, **more: Any) -> Scene:
    """A scene with one contact between bodies."""
    table: dict[str, Any] = {
        "geometrically_nonlinear": False,
        "geometry": {"mesh": str(mesh), "dimension": d, "degree": degree},
        "material": STEEL,
        "contacts": [
            {"normal_stiffness": 1e15, "tangential_stiffness": 1e13, "friction": 0.3, **contact}
        ],
        "time": {"periods": 1},
    }
    if d == 2:
        table["geometry"]["thickness"] = 1.0
    return make_scene(**table | more)


def solid(scene: Scene) -> Solid:
    """The solid of a scene, on one process."""
    return solid_of(scene, build_mesh(scene.geometry, MPI.COMM_SELF))


def forces(body: Solid) -> Array:
    """The normal forces of the contact points at the equilibrium, N."""
    return np.maximum(trial_forces(body.contacts, body.contact_rows @ body.equilibrium), 0.0)


@pytest.mark.slow
@pytest.mark.parametrize("first", ["1 low y", "0 high y"], ids=["fine", "coarse"])
@pytest.mark.parametrize("kind", ["quadrilaterals", "hexahedra", "tetrahedra"])
def test_constant_pressure_passes_between_meshes_that_do_not_match(
    tmp_path: Path, kind: str, first: str
) -> None:
    """Reference: constant pressure between two meshes that do not match | closed form | 1 MPa |
    0.1 to 0.6 %; 0.6 % on the coarse side | 0.6 %; 1.5 %
    """
    d, tetrahedra = 2 if kind == "quadrilaterals" else 3, kind == "tetrahedra"
    upper, lower, degree = (7, 5, 2) if d == 2 else (4, 3, 1)
    mesh = stacked(tmp_path / "blocks.vtu", d, upper, lower, tetrahedra=tetrahedra)
    second = {"1 low y": "0 high y", "0 high y": "1 low y"}[first]
    planes = [("x", "0 low x"), ("x", "1 low x"), ("y", "0 low y")]
    planes += [("z", "0 low z"), ("z", "1 low z")] if d == 3 else []
    scene = scene_of(
        mesh,
        d,
        {"group": first, "against": second},
        degree,
        supports=[{"group": name, "components": [axis]} for axis, name in planes],
        loads=[
            {"group": "1 high y", "pressure": 1e6},
            {"group": "1 high y", "force": 1.0, "direction": [0.0, 1.0, 0.0][:d], "frequency": 1.0},
        ],
    )
    body = solid(scene)
    x = body.space.tabulate_dof_coordinates()[:, :d]
    strain = -1e6 / 210e9
    expected = x * np.array([-0.3, 1.0, -0.3])[:d] * strain
    above = x[:, 1] > 0.05 + 1e-9
    above[body.mesh.nodes("1 low y", body.space)] = True
    expected[above, 1] -= 1e6 / 1e15
    found = body.equilibrium.reshape(-1, d)
    limits = (1e-3, 6e-3) if first == "1 low y" else (7e-3, 1.5e-2)  # of nodes: 1 to 11 %
    assert np.abs(found - expected).max() < limits[0] * np.abs(expected).max()
    pressure = forces(body) / body.points.tributary_area
    assert np.abs(pressure / 1e6 - 1.0).max() < limits[1]
    assert body.points.tributary_area.sum() == pytest.approx(0.1 * (1.0 if d == 2 else 0.06))


BOLT = {"head": "head2", "nut": "nut2", "force": 4000.0}
PAIR = {
    **{"group": "upper", "against": "lower", "friction": 0.3},
    **{"normal_stiffness": 2e13, "tangential_stiffness": 1e13},
}


def lap(group: str = "upper", against: str = "lower", **more: Any) -> Scene:
    """The lap joint of two strips with two bolts of 4 kN."""
    table: dict[str, Any] = {
        "geometry": {"mesh": "lap2d.geo", "dimension": 2, "thickness": 0.02},
        "material": STEEL,
        "supports": [{"group": "root"}],
        "contacts": [{**PAIR, "group": group, "against": against}],
        "bolts": [BOLT | {"head": "head1", "nut": "nut1"}, BOLT],
        "loads": [{"node": [0.5, 0.02], "direction": [0, 1], "force": 60.0, "frequency": 30.0}],
        "probe": {"node": [0.5, 0.02]},
        "time": {"periods": 1},
    }
    return make_scene(**table | more)


def struck(force: float, **more: Any) -> Scene:
    """The lap joint of fewer cells whose tip a blow lifts for 15 ms."""
    blow = {"group": "tip", "direction": [0, 1], "force": force, "pulse": {"duration": 0.015}}
    return lap(**{"geometry": COARSE, "loads": [blow], "probe": {"group": "tip"}} | more)


def hertz(body: Solid, count: int) -> Array:
    """The lowest natural frequencies with the closed points stuck, Hz."""
    return np.sqrt(body.eigenmodes(body.factor, count)[0]) / (2.0 * np.pi)


def compliance(body: Solid) -> float:
    """Displacement of the tip for 1 N there, m."""
    return float(body.probe_rows[1] @ body.factor.solve(body.load_vectors[:, :1])[:, 0])


LINEAR = [130.0843, 541.0867, 833.8455, 933.0342, 820.7967, 531.1622, 209.9904]
NONLINEAR = [129.6696]  # N at x = 0.2125 m and on


@pytest.mark.parametrize(
    ("nonlinear", "pressed", "expected", "tip"),
    [
        (False, LINEAR, [32.748591, 209.949201, 564.360850, 1221.026590], 1.088406564e-4),
        (True, NONLINEAR, [32.748278, 209.948114, 564.362115, 1221.018583], 1.088427e-4),
    ],
    ids=["linear", "nonlinear"],
)
def test_lap_joint_matches_an_independent_program(
    nonlinear: bool, pressed: list[float], expected: list[float], tip: float
) -> None:
    """Reference: bolted lap joint: seven forces, four frequencies, compliance | another program |
    130.0843 to 933.0342 N; 32.748591 to 1221.026590 Hz; 1.0884066e-4 m/N | agree | 2e-6; 3e-8; 1e-6

    Its elements and rows are linear; the numbers with large displacements are those of a prototype.
    """
    body = solid(lap(geometrically_nonlinear=nonlinear))
    found = forces(body)
    assert np.sum(found > 0.0) == 14 and found.sum() == pytest.approx(8000.0, rel=1e-9)
    at = np.searchsorted(body.points.position[:, 0], 0.2125 - 1e-9)
    np.testing.assert_allclose(found[at : at + len(pressed)], pressed, rtol=2e-6)
    np.testing.assert_allclose(hertz(body, 4), expected, rtol=3e-8)
    assert compliance(body) == pytest.approx(tip, rel=1e-6)


def test_exchange_of_matching_bodies_changes_nothing() -> None:
    pair = [
        lap(geometrically_nonlinear=False),
        lap("lower", "upper", geometrically_nonlinear=False),
    ]
    one, other = map(solid, pair)
    np.testing.assert_allclose(hertz(one, 3), hertz(other, 3), rtol=1e-8)
    assert compliance(one) == pytest.approx(compliance(other), rel=1e-8)


def test_equilibrium_balances_bolts_and_contact() -> None:
    body = solid(lap())
    residual = body.residual(body.equilibrium, body.static_load)
    pushed = body.contact_rows.T @ np.ravel(np.pad(forces(body)[:, None], ((0, 0), (0, 1))))
    alone = body.internal_force(body.equilibrium) + pushed
    assert np.abs(residual).max() < 1e-6 * 4000.0
    np.testing.assert_allclose(alone, residual, atol=1e-5)  # no tangential force is left
    rows = body.contact_rows @ body.factor.solve(body.contact_rows.T.toarray())
    assert np.linalg.eigvalsh(0.5 * (rows + rows.T))[0] > 0.0


@pytest.mark.slow
def test_deflection_of_a_joint_is_not_judged_by_elements_with_the_same_contact_points() -> None:
    found = fr.modes(lap(output={"pictures": False, "paraview": False}))
    assert found.mesh_check.deflection is None and found.mesh_check.frequencies
    assert (quantities(found), unjudged(found)) == (["frequencies"], ["static deflection"])


def test_pair_displacement_is_zero_as_both_bodies_turn() -> None:
    body = solid(lap())
    x = body.space.tabulate_dof_coordinates()[:, :2]
    turn = np.array([[np.cos(0.1), -np.sin(0.1)], [np.sin(0.1), np.cos(0.1)]])
    assert np.abs(body.contact_rows @ (x @ turn.T - x).ravel()).max() < 1e-15


def test_pressure_passes_through_a_body_between_two_contacts(tmp_path: Path) -> None:
    sizes = zip((0.0, 0.03, 0.05), (0.03, 0.05, 0.1), (3, 5, 4), strict=True)
    parts = [((0.0, low), (0.1, high), (n, 1)) for low, high, n in sizes]
    stiff = {"normal_stiffness": 1e13, "tangential_stiffness": 1e12, "friction": 0.3}
    pairs = [("1 low y", "0 high y"), ("1 high y", "2 low y")]
    scene = make_scene(
        geometry={
            **{"mesh": str(blocks(tmp_path / "three.vtu", *parts)), "dimension": 2},
            "thickness": 1.0,
        },
        material=STEEL,
        supports=[{"group": "0 low y"}],
        contacts=[{"group": a, "against": b, **stiff} for a, b in pairs],
        loads=[{"group": "2 high y", "pressure": 1e6}],
        time={"duration": 1.0, "step": 0.1},
        probe={"group": "2 high y"},
    )
    body = solid(scene)
    for k in range(2):
        assert forces(body)[body.points.contact == k].sum() == pytest.approx(1e5, rel=1e-4)


def test_centre_of_a_region_is_a_node_of_its_own_body(tmp_path: Path) -> None:
    mesh = stacked(tmp_path / "two.vtu", 2, 3, 4)  # only the lower body has a node there
    held = [{"group": "0 low y"}, {"group": "1 high y"}]
    place = {"group": "1 low y", "at": "centre"}
    load = [{**place, "force": 1.0, "direction": [0.0, 1.0], "frequency": 1.0}]
    contact = {"group": "1 low y", "against": "0 high y"}
    body = solid(scene_of(mesh, 2, contact, supports=held, loads=load, probe=place))
    lower = 2 * body.mesh.nodes("0 high y", body.space)[:, None] + np.arange(2)
    assert not body.load_vectors[lower].any() and not body.probe_rows[:, lower.ravel()].any()


def test_springs_to_the_ground_hold_a_joint_whose_bolts_press_it() -> None:
    springs = [{"group": name, "stiffness": 1e6} for name in ("root", "tip")]
    body = solid(lap(supports=[], attachments=springs))
    assert forces(body).max() > 0.0 and body.free_motions.shape[1] == 0


def test_bolt_with_both_ends_on_one_body_is_implausible() -> None:
    ends = {"nut1": [], "head2": ["bolts[0].head = 'head1' and bolts[0].nut = 'head2' are on one"]}
    for nut, expected in ends.items():
        bolts = [{"head": "head1", "nut": nut, "force": 4e3}, BOLT]
        body = solid(lap(bolts=bolts))
        said = [note for note in body.warnings if note.kind is NoteKind.IMPLAUSIBLE]
        assert [expected[k] in note for k, note in enumerate(said)] == [True] * len(expected)
        body.destroy()


def test_slide_of_a_frictionless_start_is_named() -> None:
    for force in (60.0, 1e3):
        loads = [{"node": [0.5, 0.02], "direction": [1, 0], "force": force}]
        body = solid(lap(loads=loads, time={"duration": 1.0, "step": 0.1}))
        said = [note for note in body.warnings if "slide by up to 0.0" in note]
        assert len(said) == (force > 100.0)  # 8 kN of bolts over 20 mm turn by 2.5 mm


def test_plates_that_turn_far_beside_fixed_normals_are_in_doubt(tmp_path: Path) -> None:
    """Two plates without friction bend as one of them under half of the pressure."""
    plates = [((0.0, y), (0.2, y + 0.005), (n, 1)) for y, n in ((0.0, 10), (0.005, 12))]
    held = [{"group": f"{k} low x"} for k in range(2)]
    contact = {"group": "1 low y", "against": "0 high y", "friction": 0.0}
    for pressure, doubtful in ((1e5, False), (5e5, True)):
        tips = []
        for count, mesh in enumerate((plates[:1], plates), 1):
            load = {"pressure": 0.5 * count * pressure, "follower": True}
            scene = scene_of(
                blocks(tmp_path / f"{count}.vtu", *mesh),
                2,
                contact,
                2,
                geometrically_nonlinear=True,
                supports=held[:count],
                loads=[{"group": f"{count - 1} high y", **load}],
                probe={"group": f"{count - 1} high x"},
                time={"duration": 1.0, "step": 0.1},
            )
            body = solid(scene if count == 2 else replace(scene, contacts=()))
            tips.append(float((body.probe_rows @ body.equilibrium)[1]))
        found = [*turns(body, scene, body.equilibrium[:, None])]
        assert [note.key for note in found] == ["contacts[0]"] * doubtful
        assert (abs(tips[1] / tips[0] - 1.0) > 3e-3) is doubtful


def test_body_that_friction_alone_holds_is_the_named_cause(tmp_path: Path) -> None:
    load = {"group": "1 high x", "direction": [1.0, 0.0]}
    scene = scene_of(
        stacked(tmp_path / "two.vtu", 2, 3, 2),
        2,
        {"group": "1 low y", "against": "0 high y"},
        supports=[{"group": "0 low y"}],
        loads=[
            {"group": "1 high y", "pressure": 1e6},
            {**load, "force": 1e3},
            {**load, "force": 1.0, "frequency": 1.0},
        ],
    )
    with pytest.raises(ConvergenceError, match=r"holds 1 translation of the piece .* 0.05 to"):
        solid(scene)


def test_tangential_stiffness_may_be_small_and_none_may_be_huge(tmp_path: Path) -> None:
    more: dict[str, Any] = {
        "supports": [{"group": "0 low y"}],
        "loads": [
            {"group": "1 high y", "pressure": 1e6},
            {"group": "1 high x", "force": 1.0, "direction": [1.0, 0.0], "frequency": 1.0},
        ],
    }
    pair = {"group": "1 low y", "against": "0 high y"}
    mesh = stacked(tmp_path / "two.vtu", 2, 3, 2)
    body = solid(scene_of(mesh, 2, pair | {"tangential_stiffness": 5e3}, **more))
    assert hertz(body, 1) == pytest.approx(np.sqrt(5e3 / (7800.0 * 0.05)) / 2 / np.pi, rel=1e-5)
    for name in ("normal_stiffness", "tangential_stiffness"):
        with refusal(ErrorKind.RANGE, f"contacts[0].{name}", names="N/m³"):
            solid(scene_of(mesh, 2, pair | {name: 1e21}, **more))


def test_region_without_a_facet_opposite_is_refused(tmp_path: Path) -> None:
    boxes = ((0.0, 0.0), (0.1, 0.05), (3, 2)), ((0.097, 0.05), (0.197, 0.1), (1, 2))
    mesh = blocks(tmp_path / "apart.vtu", *boxes)
    held = [{"group": "0 low y"}, {"group": "1 high y"}]
    load = [{"group": "1 high x", "force": 1.0, "direction": [0.0, 1.0], "frequency": 1.0}]
    contact = {"group": "1 low y", "against": "0 high y"}
    with refusal(ErrorKind.PLACE, "contacts[0].against", names="less than 10 % of the area"):
        solid(scene_of(mesh, 2, contact, supports=held, loads=load))


def test_closest_point_that_is_not_converged_is_no_partner(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    mesh = stacked(tmp_path / "two.vtu", 2, 3, 4)
    held = [{"group": "0 low y"}, {"group": "1 high y"}]
    load = [{"group": "1 high x", "force": 1.0, "direction": [0.0, 1.0], "frequency": 1.0}]
    contact = {"group": "1 low y", "against": "0 high y"}
    monkeypatch.setattr(pairs, "ITERATIONS", 1)  # the first one moves, the second one confirms
    with refusal(ErrorKind.PLACE, "contacts[0].against", names="no facet of '0 high y'"):
        solid(scene_of(mesh, 2, contact, supports=held, loads=load))


@pytest.mark.slow
def test_gap_of_the_mesh_or_of_the_scene_holds(tmp_path: Path) -> None:
    boxes = ((0.0, 0.0), (0.1, 0.05), (3, 2)), ((0.0, 0.051), (0.1, 0.1), (4, 2))
    mesh = blocks(tmp_path / "apart.vtu", *boxes)
    held = [{"group": "0 low y"}, {"group": "1 high y"}]
    contact = {"group": "1 low y", "against": "0 high y"}
    load = [{"group": "1 low y", "force": 1.0, "direction": [0.0, 1.0], "frequency": 1.0}]
    body = solid(scene_of(mesh, 2, contact, supports=held, loads=load))
    np.testing.assert_allclose(body.points.gap, 1e-3, rtol=1e-9)
    assert not forces(body).any() and not body.equilibrium.any()  # open, and held without it
    closed = solid(scene_of(mesh, 2, contact | {"gap": 0.0}, supports=held, loads=load))
    assert not closed.contacts.radius.any()
    squeezed = solid(scene_of(mesh, 2, contact | {"gap": -1e-6}, supports=held, loads=load))
    assert np.all(forces(squeezed) > 0.0)  # a press fit
    pressed = solid(scene_of(mesh, 2, contact | {"preload": 1e6}, supports=held, loads=load))
    assert np.all(forces(pressed) > 0.0)
    near = contact | {"reach": 0.5e-3}
    with refusal(ErrorKind.PLACE, "contacts[0].against", names="0.001 m away"):
        solid(scene_of(mesh, 2, near, supports=held, loads=load))
    with pytest.raises(ConvergenceError, match="press the body on"):
        solid(scene_of(mesh, 2, contact, supports=held[:1], loads=load))
    rolling = [{"group": "0 low y", "components": ["y"]}]
    with refusal(ErrorKind.SUPPORT, "supports", names="1 translation of"):
        solid(scene_of(mesh, 2, contact, supports=rolling, loads=load))


@pytest.mark.slow
@pytest.mark.parametrize("d", [2, 3])
def test_contact_does_not_reach_through_a_body_between(tmp_path: Path, d: int) -> None:
    def plates(covered: float) -> Scene:
        sizes = ((0.0, 0.02), 0.1, 3), ((0.021, 0.022), covered, 2), ((0.023, 0.04), 0.1, 4)
        parts = [((0.0, y[0], 0.0)[:d], (x, y[1], 0.06)[:d], (n, 1, n)[:d]) for y, x, n in sizes]
        held = [{"group": f"{k} low x"} for k in range(3)]
        load = [{"group": "0 high x", "force": 1.0, "direction": [0, 1, 0][:d], "frequency": 1.0}]
        contact = {"group": "2 low y", "against": "0 high y"}
        mesh = blocks(tmp_path / f"{covered}.vtu", *parts)
        return scene_of(mesh, d, contact, supports=held, loads=load)

    body = solid(plates(0.05))
    assert np.all(body.points.position[:, 0] > 0.02)
    area = body.points.tributary_area.sum() / (1.0 if d == 2 else 0.06)
    assert area == pytest.approx(0.05, rel=2e-2)
    with refusal(ErrorKind.PLACE, "contacts[0].against", names="other facets lie between"):
        solid(plates(0.1))


@pytest.mark.parametrize(
    ("boxes", "groups", "reason"),
    [
        ([(0.0, 0.049)], ("1 low y", "0 high y"), "inside"),
        ([(0.0, 0.05)], ("1 high y", "0 high y"), "not opposite"),
        ([(0.0, 0.05)], ("1 low y", "1 low x"), "share 1 node"),
        ([(0.2, 0.05)], ("1 low y", "0 high y"), "no facet"),
    ],
    ids=["inside", "facing", "shared", "beside"],
)
def test_impossible_pair_is_refused(
    tmp_path: Path, boxes: list[tuple[float, float]], groups: tuple[str, str], reason: str
) -> None:
    (x, y) = boxes[0]
    parts = ((0.0, 0.0), (0.1, 0.05), (3, 2)), ((x, y), (x + 0.1, y + 0.05), (4, 2))
    mesh = blocks(tmp_path / "two.vtu", *parts)
    held = [{"group": "0 low y"}, {"group": "1 high y"}]
    load = [{"group": "1 low y", "force": 1.0, "direction": [0.0, 1.0], "frequency": 1.0}]
    contact = {"group": groups[0], "against": groups[1]}
    with refusal(ErrorKind.PLACE, "contacts[0].against", names=reason):
        solid(scene_of(mesh, 2, contact, supports=held, loads=load))


def test_region_inside_of_a_body_touches_nothing() -> None:
    pair = {"group": "load", "against": "tip"}
    load = {"group": "tip", "direction": [0, 1], "force": 1.0, "frequency": 1.0}
    with refusal(ErrorKind.PLACE, "contacts[0].group", names="inside"):
        solid(scene_of(Path("beam2d.geo"), 2, pair, supports=[{"group": "root"}], loads=[load]))


@pytest.mark.parametrize(
    ("masters", "change", "shared"),
    [
        ("all", {"friction": 0.2}, True),
        ("all", {"normal_stiffness": 1e13}, False),
        ("all", {"gap": 1e-6}, False),
        ("motion", {"friction": 0.2}, False),  # other friction chooses other vectors
    ],
)
def test_runs_share_the_model_and_the_cache_of_a_joint_if_they_share_its_equilibrium(
    masters: str, change: dict[str, float], shared: bool
) -> None:
    scene = lap(basis={"masters": masters})
    other = replace(scene, contacts=(replace(scene.contacts[0], **change),))
    assert changed_key(scene, other) is None
    assert shares_model(scene, other) == (modes_table(scene) == modes_table(other)) == shared


PLANE = {"plane": {"point": [0.0, 0.05], "normal": [0.0, 1.0]}}
BOX = {"box": [[-0.01, 0.04], [0.11, 0.06]]}
HELD: dict[str, Any] = {
    "supports": [{"group": "0 low y"}, {"group": "1 high y"}],
    "loads": [{"group": "1 low y", "force": 1.0, "direction": [0.0, 1.0], "frequency": 1.0}],
}


@pytest.mark.parametrize(
    ("contact", "finer"),
    [
        ({"group": "1 low y", "against": PLANE}, 4),
        ({**BOX, "against": "0 high y"}, 4),
        ({**PLANE, "against": BOX}, 4),
        ({**PLANE, "against": BOX}, 3),  # the lower body has the smaller facets
    ],
)
def test_contact_by_a_box_or_a_plane_is_that_of_the_groups(
    tmp_path: Path, contact: dict[str, Any], finer: int
) -> None:
    mesh = stacked(tmp_path / "two.vtu", 2, finer, 7 - finer)
    names = {"group": "1 low y", "against": "0 high y"}
    if finer == 3:
        names = {"group": "0 high y", "against": "1 low y"}
    scene = scene_of(mesh, 2, contact, **HELD, geometrically_nonlinear=True)
    found, expected = (solid(scene_of(mesh, 2, one, **HELD)) for one in (contact, names))
    assert abs(found.contact_rows - expected.contact_rows).max() == 0.0
    for own, named in zip(found.sides[0], expected.sides[0], strict=True):
        np.testing.assert_array_equal(own, named)
    assert abs(found.probe_rows - expected.probe_rows).max() == 0.0  # nodes of both bodies coincide
    lifted = np.zeros((found.local, 1))  # the first body moves by 1 mm, and does not turn
    lifted[2 * found.sides[0][0] + 1] = 1e-3
    assert not [*turns(found, scene, lifted)]


@pytest.mark.parametrize(
    ("contact", "reason"),
    [
        ({**PLANE, "against": PLANE}, "facets of several bodies"),
        ({"group": "0 high y", "against": {"box": [[0.0, 0.0], [0.2, 0.0]]}}, "one body only"),
    ],
)
def test_ambiguous_boxes_of_a_contact_are_refused(
    tmp_path: Path, contact: dict[str, Any], reason: str
) -> None:
    lower = ((0.0, 0.0), (0.1, 0.05), (2, 2))
    upper = [((x, 0.05), (x + 0.04, 0.1), (2, 2)) for x in (0.0, 0.05)]
    mesh = blocks(tmp_path / "three.vtu", lower, *upper)
    with refusal(ErrorKind.PLACE, "contacts[0].against", names=reason):
        solid(scene_of(mesh, 2, contact, **HELD))


def test_contact_against_a_region_names_one(tmp_path: Path) -> None:
    mesh = stacked(tmp_path / "two.vtu", 2, 3, 4)
    with refusal(ErrorKind.MISSING, "contacts[0].against.group"):
        scene_of(mesh, 2, {"group": "1 low y", "against": {}}, **HELD)
    with refusal(ErrorKind.CONFLICT, "contacts[0].against.box"):
        scene_of(mesh, 2, {"group": "1 low y", "against": {"group": "0 high y", **BOX}}, **HELD)


def test_export_refuses_pairs() -> None:
    with refusal(ErrorKind.CONFLICT, "contacts[0].against", names="averaged between two meshes"):
        scene_deck(lap())


def test_stresses_and_reactions_of_bodies_that_touch_are_those_of_the_pressure(
    tmp_path: Path,
) -> None:
    scene = scene_of(
        stacked(tmp_path / "two.vtu", 2, 4, 3),
        2,
        {"group": "1 low y", "against": "0 high y"},
        2,
        material=STEEL | {"poisson": 0.0},
        supports=[{"group": "0 low y"}, {"group": "1 low x", "components": ["x"]}],
        loads=[{"group": "1 high y", "pressure": 1e6}],
        time={"duration": 1.0, "step": 0.1},
        output={"stresses": "cauchy"},
    )
    body = solid(scene)
    nothing = np.zeros((body.local, 0))
    table = stress_table(body, scene, body.equilibrium, nothing)
    recovery = Recovery(table, reaction_table(body, scene, nothing))
    found = find_stresses(recovery, scene, None, None, {})
    assert found.largest.von_mises == pytest.approx(1e6, rel=1e-2)
    np.testing.assert_allclose(found.reactions.values[0, 0, :2], [0.0, 1e5], atol=1.0)
    np.testing.assert_allclose(found.reactions.by_momentum[0], [0.0, 1e5], atol=1.0)


COARSE = {
    **{"mesh": "lap2d.geo", "dimension": 2, "thickness": 0.02},
    "parameters": {"elements_overlap": 6, "elements_lower": 6, "elements_along": 6}
    | {"elements_through": 1},
}


@pytest.mark.slow
@pytest.mark.parametrize("change", [{}, {"friction": 0.0}, {"friction": 0.0, "soft": 1e-7}])
def test_stuck_modes_of_a_joint_without_friction_are_in_doubt(change: dict[str, float]) -> None:
    soft = change.pop("soft", 1.0) * PAIR["normal_stiffness"]
    pair = {**PAIR, "group": "upper", "against": "lower", "tangential_stiffness": soft}
    held = [{"group": "root"}, {"group": "tip", "components": ["x"]}]
    scene = lap(contacts=[pair | change], geometry=COARSE, supports=held)
    body, modes = solid(scene), SimpleNamespace(omega=np.ones(1), rigid=0)
    study = SimpleNamespace(scene=scene, solid=body, modes=modes, warnings=[])
    contact_frequencies(cast(Run, SimpleNamespace(study=study)))
    doubtful = bool(change) and soft == PAIR["normal_stiffness"]
    assert [note.key for note in study.warnings] == ["contacts[0].friction"] * doubtful
    body.destroy()


@pytest.mark.slow
def test_vectors_of_a_backbone_come_from_its_largest_motion() -> None:
    scene = lap(
        backbone={"mode": 1, "first": 1e-4, "last": 2e-3},
        geometrically_nonlinear=False,
        geometry=COARSE,
        time={"periods": 1, "steps_per_period": 40},
    )

    def decay(reduction: Any) -> list[Motion]:
        return training.motion_of_scene(reduction.model, scene)

    trained = training.train(solid(scene), scene, decay, [scene])
    assert trained.dissipation > 0.0
    assert (trained.loads, trained.friction) == ((60.0,), (0.3,))
    assert trained.amplitude == pytest.approx(2e-3, rel=0.1)  # less its first half period


@pytest.mark.slow
@pytest.mark.long
def test_response_of_a_joint_with_chosen_interface_vectors_is_that_with_all_directions() -> None:
    """The friction of the peak chooses 16 vectors of 26 directions."""
    load = {"group": "tip", "direction": [0, 1], "force": 1.0, "frequency": 32.0}
    found = {}
    for masters in ("motion", "all"):
        scene = lap(
            geometrically_nonlinear=False,
            geometry=COARSE,
            material=STEEL | {"mass_damping": 2.0},
            loads=[load],
            probe={"group": "tip"},
            basis={"masters": masters, "accuracy": 0.05},
            time={"periods": 1, "steps_per_period": 40},
            response={"first": 32.5, "last": 32.8},
        )
        curve = fr.response(scene, MPI.COMM_SELF).curves[0]
        found[masters] = max(curve.points, key=lambda point: float(point.probe_amplitude[1]))
    chosen, whole = found["motion"], found["all"]
    assert 32.55 < chosen.parameter < 32.75
    assert chosen.parameter == pytest.approx(whole.parameter, rel=3e-4)
    for name, within in (("probe_amplitude", 5e-3), ("friction_dissipation", 2e-2)):
        np.testing.assert_allclose(getattr(chosen, name), getattr(whole, name), rtol=within)


def test_scenes_of_curves_hold_their_largest_load_and_smallest_friction() -> None:
    curves = Response(
        parameter="loads.0.force",
        first=10.0,
        last=90.0,
        families=Families(key="contacts.0.friction", values=(0.15, 0.4)),
    )
    found = scenes_of_curves(replace(lap(), response=curves))
    pairs = [(scene.loads[0].size, scene.contacts[0].friction) for scene in found]
    assert sorted(pairs) == [(10.0, 0.15), (10.0, 0.4), (90.0, 0.15), (90.0, 0.4)]


@pytest.mark.parametrize("held", [False, True])
def test_bolt_whose_faces_are_not_square_to_it_is_named(held: bool) -> None:
    bolts = [BOLT | {"head": "head1", "nut": "nut1"}, BOLT | {"head": "head1"}]  # 50 by 20 mm
    supports = [{"group": "root"}, *([{"group": "tip", "components": ["x"]}] if held else [])]
    scene = lap(bolts=bolts, supports=supports, geometry=COARSE, geometrically_nonlinear=False)
    if held:
        body = solid(scene)
        tilted = [note for note in body.warnings if "tilted" in note]
        assert [note.key for note in tilted] == ["bolts[1].head", "bolts[1].nut"]
        assert f"{np.degrees(np.arctan2(*np.abs(body.bolts.line[1]))):.0f}°" in tilted[0]
    else:
        with pytest.raises(
            ConvergenceError, match=r"only friction holds.*bolts\[1\].head = 'head1'"
        ):
            solid(scene)


def test_bolt_through_one_body_is_named_with_the_contacts_that_open(tmp_path: Path) -> None:
    bolt = {"head": "1 low y", "nut": "1 high y", "force": 1e3}
    pair = {"group": "1 low y", "against": "0 high y"}
    held = [{"group": "0 low y"}]
    more: dict[str, Any] = {"bolts": [bolt], "supports": held, "time": {"duration": 1, "step": 0.1}}
    with pytest.raises(ConvergenceError, match=r"bolts\[0\].nut.*are on one body"):
        solid(scene_of(stacked(tmp_path / "two.vtu", 2, 3, 4), 2, pair, **more))


def test_nodes_at_the_same_place_do_not_turn() -> None:
    x = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [2.0, 0.0, 0.0]])
    space = SimpleNamespace(tabulate_dof_coordinates=lambda: x)
    sides = {0: (np.arange(4), np.arange(0))}
    body = SimpleNamespace(dimension=2, comm=MPI.COMM_SELF, space=space, sides=sides)
    moved = np.array([0.0, 0.0, 0.0, 1e-3, 0.0, 0.0, 0.0, 0.1])  # the last node: 0.1 rad
    for field, count in ((0.0 * moved, 0), (moved, 1)):
        notes = [*turns(cast(Solid, body), lap(), field[:, None])]
        assert len(notes) == count and all("nan" not in note for note in notes)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({}, ""),
        ({"force": 61.5}, "loads.0.force is 61.5, and was 60"),
        ({"friction": 0.2}, "contacts.0.friction is 0.2, and was 0.3"),
        ({"size": 1.1e-3}, "the probe moves by 0.0011 m, and moved by 0.001 m"),
        ({"length": 0.2}, "the motion lasts 0.2 s, and lasted 0.1 s"),
    ],
    ids=["inside", "load", "friction", "amplitude", "length"],
)
def test_run_beyond_its_training_has_a_note(change: dict[str, float], words: str) -> None:
    given = {"force": 60.0, "friction": 0.3, "size": 1e-3, "length": 0.1} | change
    load = {"group": "tip", "direction": [0, 1], "pulse": {"duration": 0.01}}
    scene = lap(
        contacts=[PAIR | {"friction": given["friction"]}],
        loads=[load | {"force": given["force"]}],
        time={"duration": 0.1, "step": 1e-3},
    )
    trained = Trained((60.0,), (0.3,), amplitude=1e-3, duration=0.1, dissipation=1.0)
    probe = np.array([[0.0, -given["size"]], [0.0, given["size"]]])
    motion: Any = SimpleNamespace(probe=probe, time=np.array([0.0, given["length"]]), period=None)
    size, length = training.probe_amplitude(motion), training.duration(motion)
    notes = training.beyond(trained, scene, size, length)
    assert bool(notes) == bool(words) and all(f": {words}; run" in note for note in notes)


def bars(path: Path, rigid: bool) -> Scene:
    """Two bars that are pulled apart against friction, or one bar on a rigid base (test B).

    EA = 21 MN, k_t b = 4e9 N/m², and 600 N of friction over 0.2 m.
    """
    parts = [((0.0, y), (0.2, y + 0.005), (20, 1)) for y in (0.0, 0.005)]
    held = [("0 low x", ["x"]), ("0 low y", ["y"]), ("1 high y", ["y"])]
    if rigid:
        held = [("0 low y", ["x", "y"]), held[2]]
    normal = 2e12
    return make_scene(
        geometrically_nonlinear=False,
        geometry={"mesh": str(blocks(path, *parts)), "dimension": 2, "thickness": 0.02},
        material={"young": 210e9, "poisson": 0.0, "density": 780.0, "mass_damping": 3e4},
        supports=[{"group": name, "components": axes} for name, axes in held],
        contacts=[
            {
                **{"group": "1 low y", "against": "0 high y", "friction": 0.3},
                **{"normal_stiffness": normal, "tangential_stiffness": 2e11},
                "preload": 0.5e6 * (1.0 + normal * 0.01 / 210e9),  # the bars take a part of it
            }
        ],
        loads=[{"group": "1 high x", "direction": [1, 0], "force": 480.0, "frequency": 50.0}],
        probe={"group": "1 high x"},
        basis={"modes": 3, "masters": "all"},
        time={"periods": 2, "steps_per_period": 150, "steady": "march"},
        output={"pictures": False, "paraview": False},
    )


@pytest.mark.slow
@pytest.mark.parametrize(
    ("rigid", "half_range", "loss"),
    [(False, 3.683016796e-6, 2.572044949e-4), (True, 2.278096149e-6, 7.492807205e-4)],
    ids=["two bars", "one bar"],
)
def test_microslip_of_bars_dissipates_as_the_closed_form_says(
    tmp_path: Path, rigid: bool, half_range: float, loss: float
) -> None:
    """Reference: microslip of two bars, of one on a rigid base: half range, loss | closed form |
    3.68302, 2.27810 µm; 0.257204, 0.749281 mJ | 0.1 to 0.3 %; 0.6 to 0.8 % | 0.5 %; 2 %
    """
    motion = fr.run(bars(tmp_path / "bars.vtu", rigid), MPI.COMM_SELF).motions["reduced"]
    last = motion.last_period()
    tip, spent = motion.probe[last, 0], motion.friction_dissipation[last]
    assert 0.5 * np.ptp(tip) == pytest.approx(half_range, rel=5e-3)
    assert spent[-1] - spent[0] == pytest.approx(loss, rel=2e-2)


@pytest.mark.slow
def test_response_of_bars_over_the_load_dissipates_as_the_closed_form_says(tmp_path: Path) -> None:
    """The range of the motion and the loss grow with the load; at 480 N they are known."""
    scene = bars(tmp_path / "bars.vtu", rigid=False)
    table = Response(parameter="loads.0.force", first=450.0, last=480.0)
    scene = replace(scene, response=table, basis=replace(scene.basis, masters="motion"))
    last = fr.response(scene, MPI.COMM_SELF).curves[0].points[-1]
    assert last.parameter == pytest.approx(480.0)
    assert last.probe_amplitude[0] == pytest.approx(3.683016796e-6, rel=5e-3)
    assert last.friction_dissipation == pytest.approx(2.572044949e-4, rel=2e-2)


@pytest.mark.slow
@pytest.mark.long
def test_interface_vectors_of_the_motion_give_the_friction_of_the_full_model() -> None:
    scene = struck(
        60.0,
        time={"duration": 0.06, "step": 2e-4},
        reference={"full": True},
        output={"pictures": False, "paraview": False},
    )
    found = fr.run(scene, MPI.COMM_SELF)
    assert found.scene.basis.masters == "motion" and found.unfinished is None
    assert found.modes.rows.shape[0] == 16 < 2 * 13
    full, reduced = found.motions["full"], found.motions["reduced"]
    assert full.friction_dissipation[-1] == pytest.approx(found.trained.dissipation, rel=2e-2)
    assert reduced.friction_dissipation[-1] == pytest.approx(
        full.friction_dissipation[-1], rel=1e-2
    )
    tip = np.interp(full.time, reduced.time, reduced.probe[:, 1])
    assert np.linalg.norm(tip - full.probe[:, 1]) < 1e-2 * np.linalg.norm(full.probe[:, 1])


def test_linear_transient_of_pressed_bodies_without_loads_is_rest() -> None:
    """The rounding of the forces that press them would be all energy of such a motion."""
    scene = lap(
        geometry=COARSE,
        contacts=[PAIR],
        loads=[],
        probe={"group": "tip"},
        time={"duration": 0.02, "step": 1e-4},
        backbone={"mode": 1, "first": 1e-4, "last": 2e-3},
    )
    body = solid(scene)
    modes = component_modes(body, scene.basis)
    assert not Snapshots(body, scene, modes).linear.coordinates.any()


def test_stability_of_bodies_that_touch_scales_their_own_contacts(tmp_path: Path) -> None:
    scene = scene_of(
        stacked(tmp_path / "two.vtu", 2, 2, 3),
        2,
        {"group": "1 low y", "against": "0 high y", "normal_stiffness": 1e14},
        supports=[{"group": "0 low y"}],
        loads=[
            {"group": "1 high y", "pressure": 1e6},
            {"group": "1 high x", "force": 5e4, "direction": [1.0, 0.0], "frequency": 1000.0},
        ],
        material=STEEL | {"mass_damping": 200.0},
        time={"periods": 3, "steps_per_period": 40},
    )
    body = solid(scene)
    scales = scales_of(build(scene, "reduced")[0], scene)
    squares = body.eigenmodes(body.factor, 1)[0]
    assert scales.omega == pytest.approx(np.sqrt(squares[0]), rel=1e-6)
    cases, left_out = cases_of(scene, scales, ["contact stiffness", "tolerance"])
    assert [case.value for case in cases][2] == "1 times the scene's"
    assert "contacts.0.normal_stiffness=100000000000000.0" in cases[2].overrides
    assert len(left_out) == 1
    found = examine(cases[2], scene_table(scene), "two.toml", tmp_path)
    assert found.verdict in (Verdict.CONVERGED, Verdict.UNSTEADY), found.why

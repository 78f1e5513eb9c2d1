"""Models for other programs, and superelements of other programs."""

from __future__ import annotations

import runpy
import shutil
import subprocess
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from support import STEEL, beam_scene, linear_model, random_model, refusal

from fenicsrom.cli import main
from fenicsrom.errors import ErrorKind
from fenicsrom.exchange.export import SUFFIXES, export
from fenicsrom.exchange.matrix_set import MatrixSet
from fenicsrom.exchange.nastran import read_dmig, write_dmig
from fenicsrom.exchange.op4 import op4_matrices, read_op4, write_op4
from fenicsrom.exchange.superelement import read_matrices, superelement_model
from fenicsrom.online.contact.points import contacts_of
from fenicsrom.online.model.matrices import model_arrays
from fenicsrom.online.motion.measures import amplitude
from fenicsrom.online.run.simulate import load_histories, simulate
from fenicsrom.online.store.archive import StoredModel, load_model, save_model
from fenicsrom.scene import Damping, Scene, scene_table
from fenicsrom.scene.reading.superelement import parse_superelement_scene, read_superelement_scene

DEMO = Path(__file__).parents[2] / "demos" / "superelement"
RIGHT_SIDE = DEMO / "right_side.m"
SECTION = {"length": 2.54, "height": 0.0254, "width": 0.0254, "elements": 6, "load_at": 0.5}
SHORT = tuple(
    """
    geometrically_nonlinear=false time.steps_per_period=60 time.periods=3 time.steady='march'
    contacts.0.preload=5.0
""".split()
)


def rubbing_scene() -> Scene:
    """A linear beam against a wall beside its tip, so that the tip slips and lifts off."""
    scene = beam_scene(2, SHORT, reference={"beam": True, "beam_section": SECTION})
    table = scene_table(scene)
    table["contacts"][0]["normal"] = [0.8, 0.6]
    table["loads"][0]["direction"] = [0.0, 1.0]
    return beam_scene(2, (), **{key: table[key] for key in table if key != "source"})


def beam_matrices(scene: Scene) -> MatrixSet:
    from fenicsrom.reduction.beam import TimoshenkoBeam

    assert scene.reference.beam_section is not None
    beam = TimoshenkoBeam(scene.reference.beam_section, scene.material, True)
    return MatrixSet(np.array(beam.mass), np.array(beam.stiffness))


def interface_table(scene: Scene) -> dict[str, Any]:
    """The scene in terms of the unknowns of the beam: u, w and theta of its six free nodes."""
    table = scene_table(scene)
    return {
        "superelement": {"dimension": 2, "mass_damping": scene.material.mass_damping},
        "nodes": [
            {"name": "load", "position": [1.27, 0.0], "coordinates": [7, 8]},
            {"name": "tip", "position": [2.54, 0.0], "coordinates": [16, 17]},
        ],
        "loads": [{**table["loads"][0], "at": "mean"}],
        "contacts": [{**table["contacts"][0], "at": "mean"}],
        "time": table["time"],
    }


def imported(matrices: MatrixSet, table: dict[str, Any]) -> StoredModel:
    given = parse_superelement_scene(table, "scene", Path.cwd(), Path("beam.op4"))
    return superelement_model(matrices, given)


@pytest.fixture(scope="module")
def beam() -> StoredModel:
    scene = rubbing_scene()
    return imported(beam_matrices(scene), interface_table(scene))


def test_imported_superelement_rubs_as_the_beam_of_the_program_does(beam: StoredModel) -> None:
    from fenicsrom.reduction.beam import beam_model

    scene = rubbing_scene()
    theirs = simulate(beam_model(scene), scene)
    ours = beam.simulate()
    size = np.abs(theirs.displacement).max()
    assert size > 1e-3
    np.testing.assert_allclose(ours.displacement, theirs.displacement, rtol=0, atol=1e-9 * size)
    assert set(np.unique(theirs.state)) == {-1, 0, 1}  # the tip is open, slips and sticks


@pytest.mark.slow
@pytest.mark.parametrize("form", ["dmig", "op4", "mat"])
def test_exported_and_imported_model_gives_the_same_motion(
    beam: StoredModel, form: str, tmp_path: Path
) -> None:
    written = export(beam, tmp_path / f"beam{SUFFIXES[form]}", form)
    matrices, scene = written.files
    again = superelement_model(read_matrices(matrices), read_superelement_scene(scene, matrices))
    save_model(tmp_path / "model.npz", again)
    ours = load_model(tmp_path / "model.npz").simulate()
    theirs = beam.simulate()
    size = np.abs(theirs.displacement).max()
    # DMIG entries have eleven digits, and the tip sticks and slips
    tolerance = 1e-6 if form == "dmig" else 1e-9
    np.testing.assert_allclose(
        ours.displacement, theirs.displacement, rtol=0, atol=tolerance * size
    )
    largest = np.abs(theirs.force).max()
    np.testing.assert_allclose(ours.force, theirs.force, rtol=0, atol=tolerance * largest)


def test_contact_at_nodes_keeps_its_areas_and_rows(tmp_path: Path) -> None:
    scene = rubbing_scene()
    table = interface_table(scene)
    table["nodes"] += [
        {"name": "pad", "position": [x, 0.0127], "coordinates": [k, k + 1], "area": area}
        for x, k, area in ((1.27, 7, 0.25), (1.6933, 10, 0.5))
    ]
    table["contacts"][0] |= {"group": "pad", "at": "nodes"}
    pad = imported(beam_matrices(scene), table)
    matrices, beside = export(pad, tmp_path / "pad.op4", "op4").files
    again = superelement_model(read_matrices(matrices), read_superelement_scene(beside, matrices))
    np.testing.assert_array_equal(again.model.points.tributary_area, [0.25, 0.5])
    for name in ("position", "frame"):
        theirs, ours = getattr(pad.model.points, name), getattr(again.model.points, name)
        np.testing.assert_array_equal(ours, theirs)
    np.testing.assert_allclose(again.model.contact_rows, pad.model.contact_rows, atol=1e-10)
    assert np.abs(pad.model.contact_rows).sum(axis=1).min() > 0.9


def test_pad_in_millimetres_has_the_springs_of_the_pad_in_si_units(tmp_path: Path) -> None:
    """The area of a node is in the units of the scene; the exported scene is in SI units."""
    scene, found = rubbing_scene(), []
    for length, units in ((1.0, {}), (1e3, {"units": {"length": "mm", "mass": "t"}})):
        table = interface_table(scene) | units
        for node in table["nodes"]:
            node["position"] = [length * x for x in node["position"]]
        table["nodes"].append({"name": "pad", "position": [1270.0 * length / 1e3, 0.0]})
        table["nodes"][-1] |= {"coordinates": [7, 8], "area": 0.25 * length**2}
        contact = table["contacts"][0]
        contact |= {"group": "pad", "at": "nodes", "preload": contact["preload"] / length**2}
        for key in ("normal_stiffness", "tangential_stiffness"):
            contact[key] /= length**3
        pad = imported(beam_matrices(scene), table)
        matrices, beside = export(pad, tmp_path / f"pad{length:g}.op4", "op4").files
        given = read_superelement_scene(beside, matrices)
        again = superelement_model(read_matrices(matrices), given)
        found += [contacts_of(each.scene, each.model.points) for each in (pad, again)]
    assert found[0].normal_stiffness == pytest.approx([0.25e4])
    for other in found[1:]:
        for name in ("preload", "normal_stiffness", "tangential_stiffness"):
            np.testing.assert_allclose(getattr(other, name), getattr(found[0], name), rtol=1e-12)


def test_static_load_on_superelement_shifts_its_equilibrium() -> None:
    scene = rubbing_scene()
    table = interface_table(scene)
    hung = {"group": "tip", "direction": [0.0, -1.0], "force": 3.0}
    table["loads"] = [*table["loads"], hung]
    model = imported(beam_matrices(scene), table).model
    inertia = SECTION["width"] * SECTION["height"] ** 3 / 12.0
    sag = 3.0 * SECTION["length"] ** 3 / (3.0 * scene.material.young * inertia)
    assert model.contact_offset[0] == pytest.approx(-0.6 * sag, rel=1e-3)  # shear adds 0.01 %
    assert model.probe_offset[1] == pytest.approx(-sag, rel=1e-3)
    np.testing.assert_allclose(model.elastic.force, 3.0 * model.loads[:, 1])


def test_support_of_a_scene_clamps_the_coordinates_of_its_nodes() -> None:
    """A chain of three masses, clamped at its first."""
    stiffness = np.array([[1.0, -1.0, 0.0], [-1.0, 2.0, -1.0], [0.0, -1.0, 1.0]])
    free = MatrixSet(np.eye(3), stiffness)
    table: dict[str, Any] = {
        "superelement": {"dimension": 2},
        "nodes": [
            {"name": "root", "position": [0.0, 0.0], "coordinates": [1, 0]},
            {"name": "end", "position": [2.0, 0.0], "coordinates": [3, 0]},
        ],
        "loads": [{"group": "end", "direction": [1.0, 0.0], "force": 1.0, "frequency": 0.1}],
    }
    with refusal(ErrorKind.SUPPORT, key="superelement"):
        imported(free, table)
    stored = imported(free, {**table, "supports": [{"group": "root"}]})
    chain = 2.0 * np.sin(np.pi * np.array([1.0, 3.0]) / 10.0) / (2.0 * np.pi)  # (2k - 1) pi / 10
    np.testing.assert_allclose(stored.frequencies_hz, chain)
    assert stored.labels == ("q2", "q3")


def test_model_in_3d_is_exported_and_imported(tmp_path: Path) -> None:
    """Five masses on springs; the load moves the body along one axis only, and so does its row."""
    stiffness = np.diag([400.0, 500.0, 600.0, 700.0, 800.0])
    table: dict[str, Any] = {
        "superelement": {"dimension": 3, "mass_damping": 0.5},
        "nodes": [
            {"name": "tip", "position": [1.0, 0.2, 0.3], "coordinates": [1, 2, 3]},
            {"name": "load", "position": [0.5, 0.0, 0.0], "coordinates": [0, 5, 0]},
        ],
        "loads": [{"group": "load", "direction": [0.0, 1.0, 0.0], "force": 9.0, "frequency": 2.0}],
        "contacts": [
            {
                "nearest": [0.9, 0.0, 0.0],
                "surface": {"kind": "cylinder", "point": [0.0, 0.0, 0.0], "axis": [1.0, 0.0, 0.0]},
                "gap": 1e-3,
                "normal_stiffness": 1e4,
                "tangential_stiffness": 1e4,
                "friction": 0.3,
            }
        ],
    }
    made = imported(MatrixSet(np.eye(5), stiffness), table)
    matrices, scene = export(made, tmp_path / "a.op4", "op4").files
    again = superelement_model(read_matrices(matrices), read_superelement_scene(scene, matrices))
    np.testing.assert_array_equal(again.model.points.frame, made.model.points.frame)
    np.testing.assert_allclose(again.model.contact_rows, made.model.contact_rows, atol=1e-15)
    np.testing.assert_array_equal(again.model.loads, [[0.0], [0.0], [0.0], [0.0], [1.0]])
    assert again.model.damping == 0.5
    with refusal(ErrorKind.RANGE, key="nodes[0].coordinates[1]"):
        table["nodes"][0]["coordinates"] = [1, 1, 0]
        imported(MatrixSet(np.eye(5), stiffness), table)


def test_damping_of_a_file_is_read_if_it_is_proportional_to_the_mass() -> None:
    scene = rubbing_scene()
    plain = beam_matrices(scene)
    damped = MatrixSet(plain.mass, plain.stiffness, 3.0 * plain.mass)
    stored = imported(damped, interface_table(scene))
    assert stored.scene.material.mass_damping == pytest.approx(8.0)
    assert stored.model.damping == stored.scene.material.mass_damping


@pytest.mark.parametrize("where", ["file", "exported"])
def test_damping_that_is_not_proportional_rubs_as_in_the_beam(where: str, tmp_path: Path) -> None:
    from fenicsrom.reduction.beam import beam_model

    scene = replace(rubbing_scene(), damping=Damping(stiffness=2e-4, ratios=(0.0, 0.1)))
    damping = {"stiffness": 2e-4, "ratios": [0.0, 0.1]}
    theirs = simulate(beam_model(scene), scene)
    plain, table = beam_matrices(scene), interface_table(scene)
    made = imported(plain, {**table, "damping": damping})
    if where == "file":
        assert made.model.velocity_matrix.shape == made.model.mass.shape
        matrix = 5.0 * plain.mass + made.model.velocity_matrix
        table["superelement"]["mass_damping"] = 0.0
        made = imported(MatrixSet(plain.mass, plain.stiffness, matrix), table)
        assert made.model.damping == 0.0
    if where == "exported":
        matrices, again = export(made, tmp_path / "beam.op4", "op4").files
        given = read_superelement_scene(again, matrices)
        made = superelement_model(read_matrices(matrices), given)
    save_model(tmp_path / "model.npz", made)
    ours = load_model(tmp_path / "model.npz").simulate()
    size = np.abs(theirs.displacement).max()
    lighter = imported(plain, interface_table(scene)).simulate()
    assert np.abs(ours.displacement - lighter.displacement).max() > 0.01 * size
    np.testing.assert_allclose(ours.displacement, theirs.displacement, rtol=0, atol=1e-9 * size)


def test_dashpots_and_gyroscopic_matrix_of_a_file_give_the_exact_response() -> None:
    """The amplitude of a linear model is that of (K − ω² M + i ω C)⁻¹ f in the limit.

    Reference: amplitude of a superelement with damping and gyroscopic matrices | (K − ω²M + iωC)⁻¹
    f | closed form | agrees; order 2 | 1e-5
    """
    plain, table = beam_matrices(rubbing_scene()), interface_table(rubbing_scene())
    damping = np.zeros_like(plain.mass)
    damping[7, 7] = damping[16, 16] = 9.0
    damping[15, 16], damping[16, 15] = 3.0, -3.0
    table = {key: table[key] for key in ("superelement", "nodes", "loads")}
    table["superelement"]["mass_damping"] = 0.0
    table |= {"probe": {"group": "tip"}}
    omega = 2.0 * np.pi * table["loads"][0]["frequency"]
    force = np.zeros(len(damping))
    force[7] = table["loads"][0]["force"]
    dynamic = plain.stiffness - omega**2 * plain.mass + 1j * omega * damping
    exact = np.abs(np.linalg.solve(dynamic, force))[[15, 16]]
    found = []
    for steps in (100, 200):
        table["time"] = {"steps_per_period": steps, "periods": 40}
        made = imported(MatrixSet(plain.mass, plain.stiffness, damping), table)
        motion = made.simulate()
        assert motion.steady
        x = motion.displacement[motion.last_period(), 0][:-1]
        wave = np.exp(-2j * np.pi * np.arange(steps) / steps)
        found.append(np.abs(2.0 / steps * wave @ x))
    errors = [np.abs(amplitudes / exact - 1.0).max() for amplitudes in found]
    assert errors[1] < 2e-3
    assert errors[0] / errors[1] == pytest.approx(4.0, abs=0.1)
    np.testing.assert_allclose((4.0 * found[1] - found[0]) / 3.0, exact, rtol=1e-5)


def test_damping_that_cannot_be_is_refused() -> None:
    plain, table = beam_matrices(rubbing_scene()), interface_table(rubbing_scene())
    with refusal(ErrorKind.SUPPORT, key="superelement", names="energy"):
        imported(MatrixSet(plain.mass, plain.stiffness, -1e-5 * plain.stiffness), table)
    with refusal(ErrorKind.RANGE, key="damping.ratios"):
        imported(plain, {**table, "damping": {"ratios": 0.01, "modes": 19}})


@pytest.mark.parametrize(
    ("change", "kind", "key"),
    [
        ({"geometry": {"dimension": 2}}, ErrorKind.CONFLICT, "geometry"),
        ({"superelement": {}}, ErrorKind.MISSING, "superelement.dimension"),
        (
            {"nodes": [{"name": "tip", "position": [0.0, 0.0], "coordinates": [1, 19]}]},
            ErrorKind.PLACE,
            "nodes[0].coordinates",
        ),
        (
            {"nodes": [{"name": "tip", "position": [0.0, 0.0], "coordinates": [16, 17]}]},
            ErrorKind.PLACE,
            "loads[0].group",
        ),
    ],
)
def test_wrong_scene_of_superelement_is_refused(
    change: dict[str, Any], kind: ErrorKind, key: str
) -> None:
    scene = rubbing_scene()
    with refusal(kind, key=key):
        imported(beam_matrices(scene), {**interface_table(scene), **change})


def test_demo_of_a_superelement_rubs_as_the_full_beam(tmp_path: Path) -> None:
    script = runpy.run_path(str(DEMO / "make_matrices.py"))
    made = script["craig_bampton"](script["full_beam"]())
    stored = op4_matrices(DEMO / "beam.op4")
    for name, matrix in made.items():  # the modes have any sign
        np.testing.assert_allclose(
            np.linalg.eigvalsh(stored[name]), np.linalg.eigvalsh(matrix), rtol=1e-6
        )
    model = tmp_path / "beam.npz"
    words = ["import", str(DEMO / "beam.op4"), "--scene", str(DEMO / "rub.toml")]
    assert main([*words, "--output", str(model)]) == 0
    found = load_model(model)
    assert found.size == 9
    # the full beam, which the table of demos/paper/README.md shows as "40 N, linear"
    assert 1e3 * amplitude(found.simulate())[1] == pytest.approx(123.52, abs=0.01)


# ------------------------------------------------------------------ Nastran and Abaqus


MATRICES = {
    "KAAX": np.array([[2.0e10, -1.0 / 3.0, 0.0], [-1.0 / 3.0, 5.0e-7, 0.0], [0.0, 0.0, 7.0]]),
    "MAAX": np.diag([1.0, 2.0, 3.0]),
    "BAAX": np.array([[0.1, 2.0, 0.0], [-2.0, 0.1, 0.0], [0.0, 0.0, 0.0]]),
    "INTERF": np.array([[1.0, 0.0], [0.0, -1.5e-12], [0.25, 0.0]]),
}


def assert_matrices(found: MatrixSet, tolerance: float) -> None:
    np.testing.assert_allclose(found.stiffness, MATRICES["KAAX"], rtol=tolerance)
    np.testing.assert_allclose(found.mass, MATRICES["MAAX"], rtol=tolerance)
    np.testing.assert_allclose(found.damping, MATRICES["BAAX"], rtol=tolerance)
    np.testing.assert_allclose(found.interface, MATRICES["INTERF"].T, rtol=tolerance)


def test_op4_file_keeps_every_bit(tmp_path: Path) -> None:
    write_op4(tmp_path / "a.op4", MATRICES)
    assert_matrices(read_op4(tmp_path / "a.op4"), 0.0)


@pytest.mark.parametrize("damping", [np.zeros((1, 1)), np.zeros((3, 0)), np.zeros((2, 2))])
def test_damping_of_zeros_stands_for_none(damping: np.ndarray, tmp_path: Path) -> None:
    """Programs write a placeholder of another size where a model has no damping."""
    matrices = {"KAAX": np.eye(3), "MAAX": 2.0 * np.eye(3), "BAAX": damping}
    write_op4(tmp_path / "a.op4", matrices)
    found = read_op4(tmp_path / "a.op4")
    assert found.damping is None and np.array_equal(found.mass, 2.0 * np.eye(3))
    np.savez(tmp_path / "a.npz", stiffness=np.eye(3), mass=np.eye(3), damping=damping)
    assert read_matrices(tmp_path / "a.npz").damping is None
    write_op4(tmp_path / "b.op4", {**matrices, "BAAX": np.ones((1, 1))})
    with refusal(ErrorKind.MISMATCH, file="b.op4"):
        read_op4(tmp_path / "b.op4")


def test_op4_file_of_numbers_that_rounding_left_is_read_back(tmp_path: Path) -> None:
    """An exponent of three digits would shift the numbers behind it."""
    given = np.array([[2.0, 0.0], [-3e-107, 4.0]])
    write_op4(tmp_path / "a.op4", {"KAAX": given, "MAAX": np.eye(2)})
    np.testing.assert_array_equal(op4_matrices(tmp_path / "a.op4")["KAAX"], np.diag([2.0, 4.0]))


def test_dmig_entries_keep_eleven_digits(tmp_path: Path) -> None:
    write_dmig(tmp_path / "a.bdf", MATRICES, 3)
    found = read_dmig(tmp_path / "a.bdf")
    assert_matrices(found, 1e-10)
    assert found.labels == ((1, 0), (2, 0), (3, 0))


def test_op4_file_is_read_by_pyyeti_and_pynastran(tmp_path: Path) -> None:
    """Reference: OUTPUT4 files, DMIG entries | pyYeti 1.4.7, pyNastran 1.4.1 | – | equal | 1e-10"""
    op4 = pytest.importorskip("pyyeti.nastran.op4")
    write_op4(tmp_path / "a.op4", MATRICES)
    theirs = op4.read(str(tmp_path / "a.op4"))
    for name, matrix in MATRICES.items():
        np.testing.assert_array_equal(theirs[name.lower()], matrix)
    for sparse in ("bigmat", "nonbigmat", "dense"):
        op4.write(str(tmp_path / "b.op4"), theirs, binary=False, sparse=sparse)
        for name, matrix in op4_matrices(tmp_path / "b.op4").items():
            np.testing.assert_allclose(matrix, MATRICES[name], rtol=1e-15)


def test_dmig_entries_are_read_by_pynastran(tmp_path: Path) -> None:
    bdf = pytest.importorskip("pyNastran.bdf.bdf")
    write_dmig(tmp_path / "a.bdf", MATRICES, 3)
    theirs = bdf.read_bdf(str(tmp_path / "a.bdf"), xref=False, punch=True, debug=None)
    for name in ("KAAX", "MAAX", "BAAX"):
        matrix, rows, columns = theirs.dmigs[name].get_matrix(is_sparse=False)
        order = [[there[k][0] for k in range(len(there))] for there in (rows, columns)]
        mine = MATRICES[name][np.ix_(np.array(order[0]) - 1, np.array(order[1]) - 1)]
        np.testing.assert_allclose(matrix, mine, rtol=1e-10)


NARROW = """\
$ a stiffness with short fields and without the letter of the exponent, a mass between commas
DMIG    KAAX    0       6       1       0
DMIG    KAAX    101     1               101     1       5.+3            +
+       101     2       -1.5+2          102     1       2.0
DMIG    KAAX    101     2               101     2       6.0D3
DMIG    KAAX    102     1               102     1       7.0
DMIG,MAAX,0,6,2,0
DMIG,MAAX,101,1,,101,1,1.0
DMIG,MAAX,101,2,,101,2,1.0
DMIG,MAAX,102,1,,102,1,2.0
GRID    101             0.0     0.0     0.0
"""


def test_dmig_entries_of_other_programs_are_read(tmp_path: Path) -> None:
    (tmp_path / "a.pch").write_text(NARROW)
    found = read_matrices(tmp_path / "a.pch")
    assert found.labels == ((101, 1), (101, 2), (102, 1))
    expected = [[5000.0, -150.0, 2.0], [-150.0, 6000.0, 0.0], [2.0, 0.0, 7.0]]
    np.testing.assert_array_equal(found.stiffness, expected)
    np.testing.assert_array_equal(found.mass, np.diag([1.0, 1.0, 2.0]))


def test_matrices_of_abaqus_name_nodes_and_leave_out_clamped_unknowns(tmp_path: Path) -> None:
    (tmp_path / "job_STIF2.mtx").write_text(
        "1,1, 1,1, 1.0e36\n2,1, 2,1, 5.0\n2,1, 2,2, -1.0\n2,2, 2,2, 6.0\n"
    )
    (tmp_path / "job_MASS2.mtx").write_text("1,1, 1,1, 9.0\n2,1, 2,1, 2.0\n2,2, 2,2, 3.0\n")
    found = read_matrices(tmp_path / "job_STIF2.mtx")
    assert found.labels == ((2, 1), (2, 2))
    np.testing.assert_array_equal(found.stiffness, [[5.0, -1.0], [-1.0, 6.0]])
    np.testing.assert_array_equal(found.mass, np.diag([2.0, 3.0]))
    table: dict[str, Any] = {
        "superelement": {"dimension": 2},
        "nodes": [{"name": "end", "position": [1.0, 0.0], "grid": 2}],
        "loads": [{"group": "end", "direction": [0.0, 1.0], "force": 1.0, "frequency": 0.1}],
    }
    np.testing.assert_array_equal(imported(found, table).model.loads[:, 0], [0.0, 1.0])


@pytest.mark.parametrize(
    ("name", "content", "kind"),
    [
        ("a.txt", "", ErrorKind.FORMAT),
        ("a.op4", f"{3:8d}{3:8d}{6:8d}{2:8d}KAAX    1P,3E23.16\n", ErrorKind.FORMAT),
        ("a.bdf", "DMIG,KAAX,0,6,2,0\nDMIG,KAAX,x,1,,1,1,2.0\n", ErrorKind.FORMAT),
        ("a_STIF1.mtx", "*MATRIX, TYPE=STIFFNESS\n1.0\n", ErrorKind.FORMAT),
        ("a.mat", "no MATLAB file, but long enough to have a header " * 4, ErrorKind.FORMAT),
        ("a.npz", "no archive", ErrorKind.FORMAT),
    ],
)
def test_damaged_file_of_matrices_is_refused(
    name: str, content: str, kind: ErrorKind, tmp_path: Path
) -> None:
    (tmp_path / name).write_text(content)
    with refusal(kind, file=name):
        read_matrices(tmp_path / name)


def test_dense_and_sparse_matrices_of_matlab_are_read(tmp_path: Path) -> None:
    from scipy.io import savemat
    from scipy.sparse import csc_matrix

    content = {
        "units": {"K": "N/m"},
        "K": csc_matrix(MATRICES["KAAX"]),
        "M": np.diag([1, 2, 3]).astype(np.int16),
        "C": MATRICES["BAAX"],
        "interface": MATRICES["INTERF"],
        "names": np.array(["a", "bc"], dtype=object),
    }
    savemat(tmp_path / "a.mat", content, do_compression=True)
    assert_matrices(read_matrices(tmp_path / "a.mat"), 0.0)


# ------------------------------------------------------------------ MATLAB


@pytest.fixture(scope="module")
def curved(tmp_path_factory: pytest.TempPathFactory) -> tuple[StoredModel, Path]:
    """A nonlinear model of three coordinates with a contact, and the folder of its exports."""
    scene = beam_scene(2, ("contacts.0.at='mean'", "loads.0.at='mean'", "basis.modes=1"))
    model = random_model(3, masters=2)._replace(load_histories=load_histories(scene), damping=5.0)
    stored = StoredModel(model, scene, "rubin", ("1V", "1S", "2S"), 9, np.array([3.6]), {})
    folder = tmp_path_factory.mktemp("exchange")
    export(stored, folder / "model.mat", "mat")
    return stored, folder


def test_polynomial_in_matlab_file_is_the_elastic_force(curved: tuple[StoredModel, Path]) -> None:
    from scipy.io import loadmat

    stored, folder = curved
    arrays = model_arrays(stored.model)
    file = loadmat(folder / "model.mat")
    assert file["exponents"].shape == (20, 3)
    for q in 0.1 * np.random.default_rng(1).standard_normal((3, 3)):
        force = file["coefficients"] @ np.prod(q ** file["exponents"], axis=1)
        np.testing.assert_allclose(force, arrays.elastic_force(q), rtol=1e-12)
    np.testing.assert_array_equal(file["M"], arrays.mass)
    np.testing.assert_array_equal(file["C"], 5.0 * arrays.mass)
    assert file["units"]["stiffness"][0, 0][0] == "N/m"


in_octave = pytest.mark.skipif(
    shutil.which("octave-cli") is None,
    reason="octave is not installed; to run the test: docker/run sh -c 'apt-get update && apt-get "
    "install -y --no-install-recommends octave && python3 -m pytest -k octave tests/online'",
)


def octave(folder: Path, *lines: str) -> np.ndarray:
    """The numbers that Octave prints after it has loaded the model as m."""
    start = f"addpath('{RIGHT_SIDE.parent}'); m = load('{folder / 'model.mat'}');"
    found = subprocess.run(
        ["octave-cli", "--quiet", "--eval", start + "\n".join(lines)],
        capture_output=True,
        text=True,
        check=True,
    )
    return np.array([float(word) for word in found.stdout.split()])


@in_octave
def test_right_side_in_octave_is_that_of_the_model(curved: tuple[StoredModel, Path]) -> None:
    stored, folder = curved
    arrays = model_arrays(stored.model)
    q, v, load = np.array([0.1, -0.2, 0.05]), np.array([1.0, 0.5, -1.0]), 7.0
    contact = np.array([2.0, -1.0])
    force = load * arrays.loads[:, 0] - arrays.damping @ v - arrays.elastic_force(q)
    for more, push in (("", 0.0), (", [2; -1]", arrays.contact_rows.T @ contact)):
        state = ";".join(map(str, [*q, *v]))
        rate = octave(folder, f"printf('%.17g ', right_side([{state}], m, {load}{more}))")
        wanted = [*v, *np.linalg.solve(arrays.mass, force - push)]
        np.testing.assert_allclose(rate, wanted, rtol=1e-10)


@in_octave
def test_motion_in_octave_is_the_limit_of_that_of_the_program(tmp_path: Path) -> None:
    """Reference: motion of an exported nonlinear model | GNU Octave 9.4, `lsode` | its motion |
    agrees; order 2 | 1e-6
    """
    load = {"group": "load", "direction": [0.0, 1.0], "force": 4.0, "frequency": 0.5, "phase": 0.2}
    material = {**STEEL, "mass_damping": 0.3}
    body: dict[str, Any] = {"material": material, "contacts": None, "loads": [load]}
    ends = []
    for steps in (200, 400):
        time = {"periods": 3, "steps_per_period": steps, "steady": "march"}
        scene = beam_scene(2, **body, time=time, probe={"group": "tip"})
        model = random_model(3)._replace(load_histories=load_histories(scene), damping=0.3)
        stored = StoredModel(model, scene, "rubin", ("1V", "2V", "3V"), 9, np.array([3.6]), {})
        ends.append(simulate(stored, scene).displacement[-1, 0])
    export(stored, tmp_path / "model.mat", "mat")
    theirs = octave(
        tmp_path,
        "lsode_options('relative tolerance', 1e-11); lsode_options('absolute tolerance', 1e-12);",
        "rate = @(y, t) right_side(y, m, 4 * sin(2 * pi * 0.5 * t + 0.2));",
        "y = lsode(rate, zeros(6, 1), [0 6]); printf('%.17g ', m.probe_rows * y(end, 1:3)');",
    )
    coarse, fine = (np.linalg.norm(end - theirs) / np.linalg.norm(theirs) for end in ends)
    assert fine < 1e-3
    assert coarse / fine == pytest.approx(4.0, abs=0.1)  # the scheme is of second order
    limit = (4.0 * ends[1] - ends[0]) / 3.0
    np.testing.assert_allclose(limit, theirs, rtol=0, atol=1e-6 * np.linalg.norm(theirs))


def test_stored_linear_model_moves_in_exudyn_as_here(tmp_path: Path) -> None:
    """Reference: motion of the arrays of a stored linear model | exudyn 1.13.6, trapezoidal rule |
    its motion | agrees | 1e-9
    """
    exudyn = pytest.importorskip("exudyn", reason="exudyn is not installed; .ci/wheel installs it")
    from exudyn.itemInterface import NodeGenericODE2, ObjectGenericODE2

    time = {"scheme": "average-acceleration", "periods": 2, "steps_per_period": 50}
    material, load = {**STEEL, "mass_damping": 0.7}, {"group": "load", "direction": [0.0, 1.0]}
    scene = beam_scene(
        2,
        ("geometrically_nonlinear=false",),
        material=material,
        contacts=None,
        loads=[{**load, "force": 4.0, "frequency": 3.2}],
        probe={"group": "tip"},
        time={**time, "steady": "march"},
    )
    stiffness, loads = [[500.0, 90.0, 0], [90.0, 900.0, 0], [0, 0, 4e3]], [[1.0], [0.3], [0.2]]
    histories, turn = load_histories(scene), np.array([[0, 2.0, 0], [-2.0, 0.1, 1.0], [0, -1.0, 0]])
    model = linear_model(
        np.diag([1.0, 2.0, 3.0]), stiffness, damping=0.7, loads=loads, load_histories=histories
    )
    model = model._replace(velocity_matrix=turn)
    stored = StoredModel(model, scene, "rubin", ("1V", "2V", "3V"), 9, np.array([3.0]), {})
    save_model(tmp_path / "model.npz", stored)
    read = load_model(tmp_path / "model.npz")
    motion, arrays, n = read.simulate(), model_arrays(read), read.size

    system = exudyn.SystemContainer().AddSystem()
    node = NodeGenericODE2(
        referenceCoordinates=[0.0] * n,
        initialCoordinates=[0.0] * n,
        initialCoordinates_t=[0.0] * n,
        numberOfODE2Coordinates=n,
    )
    body = ObjectGenericODE2(
        nodeNumbers=[system.AddNode(node)],
        massMatrix=arrays.mass,
        stiffnessMatrix=arrays.stiffness,
        dampingMatrix=arrays.damping + arrays.gyroscopic,
        forceVector=[0.0] * n,
        forceUserFunction=lambda system, t, number, q, v: list(
            arrays.loads[:, 0] * 4.0 * np.sin(2.0 * np.pi * 3.2 * t)
        ),
    )
    system.AddObject(body)
    system.Assemble()
    settings = exudyn.SimulationSettings()
    settings.timeIntegration.endTime = motion.time[-1]
    settings.timeIntegration.numberOfSteps = motion.time.size - 1
    settings.solution.file.write = False
    system.SolveDynamic(settings, solverType=exudyn.DynamicSolverType.TrapezoidalIndex2)
    theirs = arrays.probe_rows @ system.systemData.GetODE2Coordinates()
    ours = motion.displacement[-1, 0]
    np.testing.assert_allclose(ours, theirs, rtol=0, atol=1e-9 * np.linalg.norm(theirs))


def test_commands_export_and_import_a_model(
    beam: StoredModel, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    save_model(tmp_path / "model.npz", beam)
    words = ["export", str(tmp_path / "model.npz"), "--format"]
    for form, suffix in SUFFIXES.items():
        path = tmp_path / f"beam{suffix}"
        assert main([*words, form, "--output", str(path)]) == 0 and path.is_file()
    scene = ["--scene", str(tmp_path / "beam.toml")]
    assert main(["import", str(tmp_path / "beam.bdf"), *scene, "--output", str(path)]) == 0
    assert "18 coordinates, 1 contact point\n" in capsys.readouterr().out
    assert main(["export", str(tmp_path / "none.npz"), "--format", "mat"]) == 2
    assert main(["import", str(tmp_path / "none.op4"), *scene]) == 2
    assert main(["import", str(tmp_path / "beam.op4"), "--scene", "none.toml"]) == 2
    assert "Traceback" not in capsys.readouterr().err


def test_linear_formats_say_that_they_hold_the_linear_part(
    curved: tuple[StoredModel, Path], tmp_path: Path
) -> None:
    stored, _ = curved
    for form in ("op4", "dmig"):
        assert export(stored, tmp_path / f"a{SUFFIXES[form]}", form).notes
    found = read_op4(tmp_path / "a.op4")
    np.testing.assert_allclose(found.stiffness, stored.model.elastic.stiffness, rtol=1e-14)

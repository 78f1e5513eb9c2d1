"""The stages on the mesh give the same on two ranks as on one."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from support import arrays_of_one_and_two_ranks, needs_mpirun, on_ranks

pytestmark = pytest.mark.slow

pytest.importorskip("dolfinx")

CHAIN = """
import sys
import numpy as np
from mpi4py import MPI
from support import beam_scene, enriched, make_solid
from fenicsrom.fem.full.full import FullModel
from fenicsrom.reduction.basis import project
from fenicsrom.reduction.stages import choose

comm = MPI.COMM_WORLD
method, target = sys.argv[1:]
push = {"group": "tip", "direction": [0.2, 0.5, 1.0], "traction": 1e5}
press = {"group": "tip", "pressure": 1e4}
SPIN = {"speed_rpm": 600.0, "axis": [0.6, 0.0, 0.8], "point": [-0.2, 0.1, 0.05], "coriolis": True}
base = {"direction": [0.0, 0.0, 1.0], "acceleration": 50.0, "frequency": 3.2}
shake = {"group": "load", "direction": [0.0, 1.0, 0.0], "force": 20.0, "frequency": 3.2}
scene = beam_scene(
    3, ("geometry.parameters.elements_along=8", "geometry.parameters.load_at=0.5",
        "geometry.parameters.width=0.03", f"basis.method='{method}'", "basis.modes=2",
        "time.periods=3"),
    loads=[shake, push, press, base], rotation=SPIN,
)
solid = make_solid(scene)
modes, theta, basis = enriched(solid, method, 2)
model = project(solid, basis)
full = FullModel(solid)
kept = choose(solid, scene, modes)
force, energy = full.elastic_at(1e-2 * basis.vectors[:, 0])


def gathered(block):
    '''On rank 0 a block (local, k) as a table (all, 3 + 1 + k) by position and component.'''
    d = 3
    x = solid.space.tabulate_dof_coordinates()[: solid.local // d]
    rows = np.column_stack([np.repeat(x, d, axis=0).round(9), np.tile(np.arange(d), len(x)), block])
    parts = comm.gather(rows)
    if parts is None:
        return None
    rows = np.concatenate(parts)
    return rows[np.lexsort(rows[:, 3::-1].T)]


everything = [
    modes.normal, modes.static, theta, basis.vectors, solid.contact_rows.T.toarray(),
    solid.equilibrium, force
]
table = gathered(np.column_stack(everything))
rest = [(1.0, np.zeros(solid.local), np.zeros(0))]
directions = np.arange(solid.contact_rows.shape[0])
y, unit, response = full.solve_effective(1e3, 0.0, rest, force, directions)
compliance = response.delassus
known = [
    modes.omega, energy, compliance, model.mass, model.loads, model.contact_offset, *model.elastic,
    model.velocity_matrix,
]
for other in comm.allgather(known):  # each rank knows the same
    assert all(np.array_equal(a, b) for a, b in zip(other, known, strict=True))
if comm.rank == 0:
    np.savez(
        target, ranks=comm.size, table=table, omega=modes.omega, energy=energy,
        compliance=compliance, mass=model.mass, labels=basis.labels, loads=model.loads,
        offset=model.contact_offset, condition=modes.flexibility_condition, kept=kept.derivatives,
        weights=list(kept.weights.values()), gyroscopic=model.velocity_matrix,
        **model.elastic._asdict(),
    )
"""


SCENE = str(Path(__file__).parents[2] / "demos" / "slip_liftoff_2d.toml")
SMALL = ["geometry.parameters.elements_along=10", "time.periods=2"]


@needs_mpirun
def test_two_ranks_compare_the_same(tmp_path: Path) -> None:
    """Errors and indicators of `fenicsrom compare`; each number of ranks computes its own full
    model."""
    lists = [
        "compare.modes=[1]",
        "compare.derivatives=['none', 'mmi-nls']",
        "compare.methods=['rubin']",
    ]
    cheap = ["time.steps_per_period=100", "output.pictures=false"]
    overrides = [part for item in (*SMALL, *cheap, *lists) for part in ("--set", item)]
    found = []
    for ranks in (1, 2):
        folder = tmp_path / str(ranks)
        command = ["-m", "fenicsrom", "compare", SCENE, "--output", str(folder), *overrides]
        done = on_ranks(ranks, *command)
        assert (
            done.stdout.count("files:") == 1
            and done.stderr.count("integrating the full model") == 1
        )
        found.append(json.loads((folder / "comparison.json").read_text()))
    one, two = found
    assert (one["full"]["ranks"], two["full"]["ranks"]) == (1, 2) and not two["full"]["cached"]
    ours, theirs = (found["full"]["response"]["amplitude_m"]["tangential"] for found in (one, two))
    assert theirs == pytest.approx(ours, rel=1e-7)
    for a, b in zip(one["combinations"], two["combinations"], strict=True):
        assert a["labels"] == b["labels"] and not a["failure"] and not b["failure"]
        assert b["indicator"] == pytest.approx(a["indicator"], rel=1e-4)
        for name, error in a["error_percent"].items():
            assert b["error_percent"][name] == pytest.approx(error, rel=1e-2, abs=1e-4), name
    assert one["combinations"][0]["error_percent"]["amplitude_tangential"] > 50.0
    assert one["combinations"][1]["error_percent"]["amplitude_tangential"] < 0.1


@pytest.mark.long
@needs_mpirun
def test_two_ranks_find_the_same_motion_of_the_full_model(tmp_path: Path) -> None:
    overrides = [
        "geometry.parameters.elements_along=6",
        "time.steps_per_period=100",
        "output.pictures=false",
        "response={first=3.15, last=3.25, full=[3.2]}",
    ]
    found = []
    for ranks in (1, 2):
        folder = tmp_path / str(ranks)
        command = ["-m", "fenicsrom", "response", SCENE, "--output", str(folder)]
        command += [part for item in overrides for part in ("--set", item)]
        done = on_ranks(ranks, *command)
        assert done.stdout.count("files:") == 1
        (curve,) = json.loads((folder / "response.json").read_text())["curves"]
        found.append(curve["full_model"][0])
    one, two = found
    assert one["full_periods_with_derivatives"] > 0
    for name, value in one.items():
        if name.endswith("_m"):
            assert two[name] == pytest.approx(value, rel=1e-6), name


ALONE = """
import sys
from mpi4py import MPI
from fenicsrom.cli import main, ranks, starting
from fenicsrom.errors import SceneError

wrong = [int(rank) for rank in sys.argv[4:]]
if len(wrong) == 1:
    ranks.PATIENCE = 1.0  # the other rank never says anything
read = starting.read_scene
def read_scene(*given, **options):
    if MPI.COMM_WORLD.rank in wrong:
        raise SceneError(sys.argv[2].format(rank=MPI.COMM_WORLD.rank))
    return read(*given, **options)
starting.read_scene = read_scene
sys.exit(main(["run", sys.argv[1], "--output", sys.argv[3]]))
"""


@needs_mpirun
def test_error_of_two_ranks_is_printed_once(tmp_path: Path) -> None:
    bad = tmp_path / "bad.toml"
    bad.write_text("[geometry]\nmesh = 'x.geo'\n")
    said = on_ranks(2, "-m", "fenicsrom", "run", str(bad), code=2).stderr
    assert said.count("fenicsrom: ") == said.count("geometry.dimension is missing") == 1
    said = on_ranks(
        2, "-m", "fenicsrom", "run", SCENE, "--set", "geometry.parameters.height=-1", code=2
    ).stderr
    assert said.count("fenicsrom: ") == said.count("height") == 1


@needs_mpirun
@pytest.mark.parametrize(
    ("sentence", "ranks", "expected"),
    [
        ("it is wrong", "1", ["it is wrong"]),
        ("wrong on {rank}", "0 1", ["wrong on 0", "wrong on 1"]),
    ],
)
def test_error_of_one_rank_is_printed_and_stops_the_other(
    sentence: str, ranks: str, expected: list[str], tmp_path: Path
) -> None:
    """The other rank is stopped, because it would wait forever."""
    done = on_ranks(
        2, "-c", ALONE, SCENE, sentence, str(tmp_path), *ranks.split(), code=2, timeout=100
    )
    assert (
        sorted(line[11:] for line in done.stderr.splitlines() if line.startswith("fenicsrom: "))
        == expected
    )


CRASH = """
import sys
from mpi4py import MPI
from fenicsrom.cli import main, starting

read = starting.read_scene
def read_scene(*given, **options):
    if MPI.COMM_WORLD.rank == 1:
        raise ZeroDivisionError("a defect of the program")
    return read(*given, **options)
starting.read_scene = read_scene
sys.exit(main(["run", sys.argv[1], "--output", sys.argv[2]]))
"""


@needs_mpirun
def test_unexpected_exception_of_one_rank_ends_all(tmp_path: Path) -> None:
    done = on_ranks(2, "-c", CRASH, SCENE, str(tmp_path), code=1, timeout=60)
    assert "ZeroDivisionError: a defect of the program" in done.stderr
    assert not (tmp_path / "summary.json").exists()


@pytest.mark.long
@needs_mpirun
def test_more_ranks_than_cells_run(tmp_path: Path) -> None:
    """Some ranks have no cell and no unknown."""
    cells = ["geometry.parameters.elements_along=2", "geometry.parameters.load_at=0.5"]
    wanted = [
        *cells,
        "time.periods=2",
        "time.steps_per_period=50",
        "output.pictures=false",
        "output.paraview=false",
    ]
    wanted += ["reference.beam=false", "loads=[{group='load',direction=[0,1],force=9,frequency=3}]"]
    overrides = [part for item in wanted for part in ("--set", item)]
    found = []
    for ranks in (1, 3):
        folder = tmp_path / str(ranks)
        on_ranks(ranks, "-m", "fenicsrom", "run", SCENE, "--output", str(folder), *overrides)
        summary = json.loads((folder / "summary.json").read_text())
        found.append(summary["response"]["reduced"]["amplitude_m"]["tangential"])
    assert found[1] == pytest.approx(found[0], rel=1e-6)


@needs_mpirun
def test_two_ranks_write_motion_files_once(tmp_path: Path) -> None:
    """Each rank writes its piece of the grids; the contact points, the animation and the pictures
    are written once. The contact points equal those of one rank."""
    pyvista = pytest.importorskip("pyvista")
    wanted = [
        "output.motion=true",
        "output.animation=true",
        "reference.full=false",
    ]
    overrides = [part for item in (*SMALL, *wanted) for part in ("--set", item)]
    frames = []
    for ranks in (1, 2):
        folder = tmp_path / str(ranks)
        on_ranks(ranks, "-m", "fenicsrom", "run", SCENE, "--output", str(folder), *overrides)
        reader = pyvista.get_reader(folder / "contact_points" / "contact_points.pvd")
        reader.set_active_time_value(reader.time_values[20])
        frames.append(reader.read()[0])
        assert len(list((folder / "motion").glob("*_p1.vtu"))) == (30 if ranks == 2 else 0)
        assert (folder / "motion.gif").read_bytes().startswith(b"GIF89a")
        assert (folder / "shapes.png").exists()
    for name in frames[0].point_data:
        np.testing.assert_allclose(frames[1][name], frames[0][name], rtol=1e-6, atol=1e-8)


@needs_mpirun
@pytest.mark.parametrize("method", ["rubin", "craig-bampton"])
def test_two_ranks_give_the_same_reduced_model(method: str, tmp_path: Path) -> None:
    one, two = arrays_of_one_and_two_ranks(CHAIN, tmp_path, method)
    np.testing.assert_allclose(two["omega"], one["omega"], rtol=1e-6)
    assert list(one["labels"]) == list(two["labels"])
    assert list(one["kept"]) == list(two["kept"])
    np.testing.assert_allclose(two["weights"], one["weights"], rtol=1e-4, atol=1e-6)
    np.testing.assert_allclose(two["energy"], one["energy"], rtol=1e-7)
    np.testing.assert_allclose(two["offset"], one["offset"], rtol=1e-7, atol=1e-9)
    np.testing.assert_allclose(two["condition"], one["condition"], rtol=1e-4)
    close = 1e-7 * np.abs(one["compliance"]).max()
    np.testing.assert_allclose(two["compliance"], one["compliance"], rtol=0, atol=close)
    # node by node: modes, static modes, derivatives, basis, rows of the contact, equilibrium, force
    # of the full model
    a, b = one["table"], two["table"]
    np.testing.assert_array_equal(a[:, :4], b[:, :4])
    a, b = a[:, 4:], b[:, 4:]
    signs = np.where(np.sum(a * b, axis=0) < 0, -1.0, 1.0)
    error = np.abs(a - signs * b).max(axis=0) / np.abs(a).max(axis=0)
    assert error.max() < 1e-5, error
    # the polynomial, in the signs of the basis
    n = one["mass"].shape[0]
    vectors = slice(a.shape[1] - n - 5, a.shape[1] - 5)
    s = signs[vectors]
    i, j = np.triu_indices(n)
    pair = s[i] * s[j]
    flips = {
        "force": s,
        "stiffness": np.outer(s, s),
        "mass": np.outer(s, s),
        "gyroscopic": np.outer(s, s),
        "quadratic": np.outer(pair, s),
        "cubic": np.outer(pair, pair),
        "loads": s[:, None],
    }
    for name, flip in flips.items():
        assert one[name].shape == two[name].shape
        close = 1e-5 * np.abs(one[name]).max()
        np.testing.assert_allclose(flip * two[name], one[name], rtol=0, atol=close, err_msg=name)


RECOVERY = """
import sys
import numpy as np
from mpi4py import MPI
from support import STOCKY, beam_scene, make_solid
from fenicsrom.fem.solid.reaction_rows import reaction_table
from fenicsrom.fem.body.stress_points import local_part, stress_table
push = {"group": "tip", "direction": [0.3, 1.0], "force": 1e5}
# twelve elements: only one rank has cells at the root
scene = beam_scene(
    2, (*STOCKY, "geometry.parameters.elements_along=12"), loads=[push], contacts=None
)
solid = make_solid(scene)
x = solid.space.tabulate_dof_coordinates()[: solid.local // 2, :2]
vectors = np.stack([x**2, np.sin(x)], axis=-1).reshape(-1, 2)
vectors[solid.clamped] = 0.0
table = stress_table(solid, scene, solid.equilibrium, vectors)
reactions = reaction_table(solid, scene, vectors)
q = np.array([1e-3, 2e-3])
stress = table.stress(q)
order = np.lexsort(np.round(table.vertex_position, 9).T)
part = local_part(solid)
at_nodes = part.at_nodes(table, table.at_vertices(stress))[np.unique(part.nodes)]
largest = max(solid.comm.allgather(np.abs(at_nodes).max(axis=0).tolist()))
sums = solid.comm.allreduce(np.abs(stress[: table.position.shape[0]]).sum() / solid.comm.size)
one = np.ones((1, 1))
values, total = reactions.evaluate(table.law, q[None], q[None], q[None], one)
if MPI.COMM_WORLD.rank == 0:
    np.savez(
        sys.argv[1], ranks=solid.comm.size, sums=sums, vertices=table.at_vertices(stress)[order],
        moved=table.displacement(q)[order], values=values, total=total,
        largest=largest,
    )
"""


@needs_mpirun
def test_two_ranks_give_the_same_stresses_and_reactions(tmp_path: Path) -> None:
    one, two = arrays_of_one_and_two_ranks(RECOVERY, tmp_path)
    for name in ("sums", "vertices", "moved", "values", "total", "largest"):
        size = np.abs(one[name]).max()
        np.testing.assert_allclose(two[name], one[name], rtol=0, atol=1e-8 * size)


JOINTS = """
import sys
from pathlib import Path
import numpy as np
from mpi4py import MPI
import fenicsrom as fr
from fenicsrom.fem.full.full import full_model
from fenicsrom.fem.mesh.mesh import build_mesh
from fenicsrom.fem.solid.solid import solid_of
from fenicsrom.online.run.simulate import simulate
from tests.boxes import stacked
from tests.fem.test_pairs import COARSE, lap, struck
from tests.fem.test_ties import scene_of

comm = MPI.COMM_WORLD
spring = {"group": "head1", "to": {"group": "tip"}, "stiffness": 2e4, "damping": 3.0}
blow = struck(100.0, time={"duration": 4e-3, "step": 2e-4}, attachments=[spring])
stored = fr.build_model(blow, comm=comm, fresh=True)
solid = solid_of(blow, build_mesh(blow.geometry, comm))
models = {"reduced": stored.model, "full": full_model(solid)}
motions = {
    f"{name} {what}": getattr(motion, what)
    for name, motion in ((name, simulate(model, blow)) for name, model in models.items())
    for what in ("probe", "force", "friction_dissipation")
}
lift = {"group": "tip", "direction": [0, 1], "force": 60.0}
still = {"time": {"duration": 1.0, "step": 0.1}}
lifted = lap(geometry=COARSE, loads=[lift], probe={"group": "tip"}, **still)
path = fr.statics(lifted, comm).points[-1]
mesh = stacked(Path(sys.argv[1]).with_name(f"{comm.size}{comm.rank}.vtu"), 3, 2, 3)
pair = {"group": "1 low y", "against": "0 high y"}
both = {"supports": [{"group": "0 low y"}], "loads": [
    {"group": "1 high y", "direction": [0, -1, 0], "force": 1e4}]}
stiff = {"normal_stiffness": 1e13, "tangential_stiffness": 1e13, "friction": 0.3}
tied, touching = (
    solid_of(scene, build_mesh(scene.geometry, comm))
    for scene in (scene_of(mesh, 3, ties=[pair], **both), scene_of(mesh, 3, contacts=[pair | stiff],
        **still, **both))
)
for body in (solid, tied, touching):
    linked = body.couplings.nnz + abs(body.contact_rows).sum()
    assert min(comm.allgather(float(linked))) > 0.0, "each rank has a part of the joint"
squares = [body.eigenmodes(body.factor, 3)[0] for body in (tied, touching)]
moved = comm.allreduce(tied.probe_rows @ tied.equilibrium)
pressed = touching.contact_displacement(touching.equilibrium)
if comm.rank == 0:
    assert path.slipping and motions["full friction_dissipation"][-1] > 0.0
    np.savez(
        sys.argv[1], ranks=comm.size, path=path.probe,
        lost=path.dissipated, squares=squares, moved=moved, pressed=pressed, **motions,
    )
"""


@pytest.mark.slow
@needs_mpirun
def test_two_ranks_give_the_same_motion_of_bodies_that_touch(tmp_path: Path) -> None:
    """With a spring between places, ties and paths of equilibria with friction."""
    one, two = arrays_of_one_and_two_ranks(JOINTS, tmp_path)
    for name, expected in one.items():
        size = np.abs(expected).max()
        np.testing.assert_allclose(two[name], expected, rtol=0, atol=1e-9 * size, err_msg=name)

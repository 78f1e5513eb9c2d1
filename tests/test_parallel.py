"""The stages on the mesh give the same on two ranks as on one."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("dolfinx")

import fenicsrom

CHAIN = """
import sys
import numpy as np
from mpi4py import MPI
from support import beam_scene, enriched, make_solid
from fenicsrom.full import FullModel
from fenicsrom.reduced import project
from fenicsrom.study import choose

comm = MPI.COMM_WORLD
method, target = sys.argv[1:]
push = {"group": "tip", "direction": [0.2, 0.5, 1.0], "force": 40.0}
shake = {"group": "load", "direction": [0.0, 1.0, 0.0], "force": 20.0, "frequency": 3.2}
scene = beam_scene(
    3, ("geometry.parameters.elements_along=8", "geometry.parameters.load_at=0.5", "geometry.parameters.width=0.03",
        f"basis.method='{method}'", "basis.modes=2", "time.periods=3"),
    loads=[shake, push],
)
solid = make_solid(scene)
modes, theta, basis = enriched(solid, method, 2)
model = project(solid, basis)
full = FullModel(solid)
kept = choose(solid, modes)
force, energy = full.elastic_at(1e-2 * basis.vectors[:, 0])


def gathered(block):
    '''A block (local, k) as a table sorted by position and component: (all, 3 + 1 + k), on rank 0.'''
    d = 3
    x = solid.space.tabulate_dof_coordinates()[: solid.local // d]
    rows = np.column_stack([np.repeat(x, d, axis=0).round(9), np.tile(np.arange(d), len(x)), block])
    parts = comm.gather(rows)
    if parts is None:
        return None
    rows = np.concatenate(parts)
    return rows[np.lexsort(rows[:, 3::-1].T)]


everything = [modes.normal, modes.static, theta, basis.vectors, solid.contact_rows.T, solid.equilibrium, force]
table = gathered(np.column_stack(everything))
y, unit, compliance = full.responses(1e3, [(1.0, np.zeros(solid.local))], force)
if comm.rank == 0:
    np.savez(
        target, ranks=comm.size, table=table, omega=modes.omega, energy=energy, compliance=compliance, mass=model.mass,
        labels=basis.labels, loads=model.loads, offset=model.contact_offset, condition=modes.flexibility_condition,
        kept=kept.derivatives, weights=list(kept.weights.values()), **model.elastic._asdict(),
    )
"""


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("mpirun") is None, reason="no mpirun")
@pytest.mark.parametrize("method", ["rubin", "craig-bampton"])
def test_two_ranks_give_the_same_reduced_model(method: str, tmp_path: Path) -> None:
    results = []
    environment = {k: v for k, v in os.environ.items() if not k.startswith(("OMPI_COMM", "PMIX", "PRTE"))}
    paths = [str(Path(fenicsrom.__file__).parents[1]), str(Path(__file__).parent), os.environ.get("PYTHONPATH", "")]
    environment["PYTHONPATH"] = os.pathsep.join(filter(None, paths))
    for ranks in (1, 2):
        target = tmp_path / f"{ranks}.npz"
        start = ["mpirun", "--oversubscribe", "-n", str(ranks)] if ranks > 1 else []
        command = [*start, sys.executable, "-c", CHAIN, method, str(target)]
        done = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=300)
        assert done.returncode == 0, done.stderr
        with np.load(target) as file:
            results.append(dict(file))
    one, two = results
    assert (one["ranks"], two["ranks"]) == (1, 2)
    np.testing.assert_allclose(two["omega"], one["omega"], rtol=1e-6)
    assert list(one["labels"]) == list(two["labels"])
    assert list(one["kept"]) == list(two["kept"])
    np.testing.assert_allclose(two["weights"], one["weights"], rtol=1e-4, atol=1e-6)
    np.testing.assert_allclose(two["energy"], one["energy"], rtol=1e-7)
    np.testing.assert_allclose(two["offset"], one["offset"], rtol=1e-7, atol=1e-9)
    np.testing.assert_allclose(two["condition"], one["condition"], rtol=1e-4)
    close = 1e-7 * np.abs(one["compliance"]).max()
    np.testing.assert_allclose(two["compliance"], one["compliance"], rtol=0, atol=close)
    # node by node: modes, static modes, derivatives, basis, rows of the contact, equilibrium, force of the full model
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
    flips = {"force": s, "stiffness": np.outer(s, s), "mass": np.outer(s, s), "quadratic": np.outer(pair, s),
             "cubic": np.outer(pair, pair), "loads": s[:, None]}  # fmt: skip
    for name, flip in flips.items():
        assert one[name].shape == two[name].shape
        close = 1e-5 * np.abs(one[name]).max()
        np.testing.assert_allclose(flip * two[name], one[name], rtol=0, atol=close, err_msg=name)

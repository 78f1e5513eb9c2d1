"""Time the offline stages of blade_rub beside the bare computations that they need.

    python3 tests/evidence/benchmark.py --offline ALONG ACROSS THROUGH
    python3 tests/evidence/benchmark.py --offline ALONG ACROSS THROUGH --points 17 100 500 1000

The numbers are elements along the span, across the chord and through the thickness. With --points
the stages run for several numbers of contact points on one mesh instead: the nodes of the hollow
side that are nearest to the casing. The times are CPU times on one thread, because wall time means
little on a machine that others use. A floor is the same computation by the library alone: one
factorisation by MUMPS, the eigenmodes by SLEPc with this factor, one block of solves for the
derivatives, and the products of the strains by BLAS.
"""

from __future__ import annotations

import resource
from collections.abc import Callable, Sequence
from pathlib import Path
from time import process_time
from typing import Any

import basix
import numpy as np
from mpi4py import MPI
from petsc4py import PETSc
from slepc4py import SLEPc

from fenicsrom.arrays import Array
from fenicsrom.fem.mesh.mesh import build_mesh
from fenicsrom.fem.solid.solid import Solid, solid_of
from fenicsrom.online.contact.points import ContactPoints
from fenicsrom.reduction.basis import ReducedBasis
from fenicsrom.reduction.derivatives import Selection
from fenicsrom.reduction.modes import EXTRA_MODES, ComponentModes, component_modes
from fenicsrom.reduction.snapshots import Snapshots
from fenicsrom.reduction.stages import choose, differentiate, enrich, reduce
from fenicsrom.scene import Scene, read_scene

SCENE = Path(__file__).parents[2] / "demos" / "blade_rub.toml"
STRAIN_ROWS = 7  # Mandel's six components and the trace


class Table:
    """The rows of the table: stages, their CPU times and their floors in seconds."""

    def __init__(self, comm: MPI.Comm):
        """Start without rows."""
        self.comm, self.sum, self.floors = comm, 0.0, 0.0

    def measure(self, work: Callable[[], Any]) -> tuple[Any, float]:
        """Do some work; give its result, and its CPU time on the slowest rank."""
        start = process_time()
        found = work()
        return found, self.comm.allreduce(process_time() - start, op=MPI.MAX)

    def row(self, name: str, work: Callable[[], Any]) -> Any:
        """Run a stage and print its CPU time; returns its result."""
        found, seconds = self.measure(work)
        self.sum += seconds
        self.write(f"{name:24} {seconds:9.2f}")
        return found

    def floor(self, name: str, work: Callable[[], Any]) -> Any:
        """Run a bare computation and print its CPU time; returns its result."""
        found, seconds = self.measure(work)
        self.floors += seconds
        self.write(f"  bare {name:17} {'':9} {seconds:9.2f}")
        return found

    def write(self, line: str) -> None:
        """Print a line once."""
        if self.comm.rank == 0:
            print(line, flush=True)


def bare_eigensolver(solid: Solid, count: int) -> SLEPc.EPS:
    """Set up SLEPc for the lowest modes; its factorisation is the floor of all factorisations."""
    eps = SLEPc.EPS().create(solid.comm)
    eps.setOperators(solid.stiffness, solid.mass)
    eps.setProblemType(SLEPc.EPS.ProblemType.GHEP)
    eps.setWhichEigenpairs(SLEPc.EPS.Which.TARGET_MAGNITUDE)
    eps.setTarget(0.0)
    eps.setDimensions(count)
    st = eps.getST()
    st.setType(SLEPc.ST.Type.SINVERT)
    ksp = st.getKSP()
    ksp.setType(PETSc.KSP.Type.PREONLY)
    ksp.getPC().setType(PETSc.PC.Type.CHOLESKY)
    ksp.getPC().setFactorSolverType("mumps")
    eps.setUp()
    return eps


def bare_products(solid: Solid, size: int) -> Array:
    """Form the products of all strains, from strains that are there already."""
    cell = solid.mesh.domain.basix_cell()
    points = basix.make_quadrature(cell, solid.quadrature_degree)[1].size
    topology = solid.mesh.domain.topology
    rows = STRAIN_ROWS * points * topology.index_map(topology.dim).size_local
    strains = np.ones((min(rows, 10_000), size))
    total = np.zeros((size, size))
    for first in range(0, rows, strains.shape[0]):
        part = strains[: rows - first]
        total += part.T @ part
    return total


def scene_of(elements: Sequence[int], *overrides: str) -> Scene:
    """The scene with these elements along the span, across the chord and through the thickness."""
    names = ("along", "across", "through")
    sizes = [
        f"geometry.parameters.elements_{name}={count}"
        for name, count in zip(names, elements, strict=True)
    ]
    return read_scene(SCENE, [*sizes, *overrides])


def largest_memory(comm: MPI.Comm) -> float:
    """The largest memory of a rank so far, GB."""
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024**2
    return float(comm.allreduce(peak, op=MPI.MAX))


def measure(*elements: int) -> None:
    """Run all offline stages of blade_rub and print the table."""
    scene, comm = scene_of(elements), MPI.COMM_WORLD
    table = Table(comm)
    table.write(f"{'CPU seconds':24} {'stage':>9} {'floor':>9}")
    mesh = table.row("mesh", lambda: build_mesh(scene.geometry, comm))
    solid = table.row("solid, equilibrium", lambda: solid_of(scene, mesh))
    modes, selection, basis = run_stages(solid, scene, table.row)
    n, peak = basis.size, largest_memory(comm)

    count = modes.omega.size + EXTRA_MODES
    eps = table.floor("factorisation", lambda: bare_eigensolver(solid, count))
    table.floor("eigenmodes", eps.solve)
    eps.destroy()
    principal = selection.principal
    solved = selection.derivatives if principal is None else tuple(principal.weights())
    right = np.random.default_rng(0).standard_normal((solid.local, len(solved)))
    table.floor("derivative solves", lambda: solid.factor.solve(right))
    table.floor("polynomial", lambda: bare_products(solid, 1 + n + n * (n + 1) // 2))
    table.write(f"{'sum':24} {table.sum:9.2f} {table.floors:9.2f}")
    table.write(
        f"{solid.free} unknowns, {len(solid.points.contact)} contact points, {n} coordinates, "
        f"{comm.size} ranks: {table.sum / table.floors:.2f} times the floor, "
        f"peak {peak:.2f} GB per rank"
    )
    table.write("derivatives: " + " ".join(solved))


ON_SIDE = (
    "contacts.0.group='pressure'",
    "contacts.0.normal_stiffness=1e10",
    "contacts.0.tangential_stiffness=1e10",
)
"""Contacts on the hollow side, with stiffnesses per area."""


def measure_points(elements: Sequence[int], counts: Sequence[int]) -> None:
    """Run the stages after the equilibrium for several numbers of contact points.

    Args:
        elements: numbers of elements, as `scene_of`.
        counts: numbers of contact points.
    """
    scene, comm = scene_of(elements, *ON_SIDE), MPI.COMM_WORLD
    table = Table(comm)
    solid = solid_of(scene, build_mesh(scene.geometry, comm))
    surface = scene.contacts[0].surface
    assert surface is not None
    arms = solid.points.position - np.array(surface.point)
    nearest = np.argsort(-np.hypot(arms[:, 0], arms[:, 2]))
    all_points, all_rows, d = solid.points, solid.contact_rows, solid.dimension
    if max(counts) > nearest.size:
        raise SystemExit(f"--points: must be at most {nearest.size}, the nodes of the side")
    for number, count in enumerate(counts):
        chosen = np.sort(nearest[:count])
        solid.points = ContactPoints(*(values[chosen] for values in all_points))
        solid.contact_rows = all_rows[(d * chosen[:, None] + np.arange(d)).ravel()]
        seconds: dict[str, float] = {}

        def timed(name: str, work: Callable[[], Any], seconds: dict[str, float] = seconds) -> Any:
            found, seconds[name] = table.measure(work)
            return found

        run_stages(solid, scene, timed)
        if number == 0:
            table.write("CPU seconds; points, " + ", ".join(seconds) + ", sum")
        row = [*seconds.values(), sum(seconds.values())]
        table.write(f"{count:6d} " + " ".join(f"{value:8.2f}" for value in row))
    table.write(f"{solid.free} unknowns, {comm.size} ranks, peak {largest_memory(comm):.2f} GB")


def run_stages(
    solid: Solid, scene: Scene, timed: Callable[[str, Callable[[], Any]], Any]
) -> tuple[ComponentModes, Selection, ReducedBasis]:
    """Run the stages from the modes to the reduced model, each through `timed`."""
    modes = timed("modes", lambda: component_modes(solid, scene.basis))
    snapshots = Snapshots(solid, scene, modes)
    timed("linear transient", lambda: snapshots.linear)
    timed("nonlinear statics", lambda: snapshots.static)
    selection = timed("selection", lambda: choose(solid, scene, modes, snapshots))
    derivatives = timed("derivatives", lambda: differentiate(solid, scene.basis, modes, selection))
    basis = timed("basis", lambda: enrich(solid, modes, selection, derivatives))
    timed("reduction", lambda: reduce(solid, scene.basis, basis))
    return modes, selection, basis

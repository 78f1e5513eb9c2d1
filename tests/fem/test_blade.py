"""A spinning blade that rubs its casing: contact at many points in whole scenes, reduced against
full."""

from __future__ import annotations

import contextlib
import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy.linalg
from numpy.typing import NDArray
from support import (
    STOCKY,
    arrays_of_one_and_two_ranks,
    beam_scene,
    dense,
    free_unknowns,
    make_solid,
    needs_mpirun,
    scene_of,
    touching,
)

pytest.importorskip("dolfinx")

import ufl
from dolfinx import fem
from mpi4py import MPI
from scipy.spatial.transform import Rotation

from fenicsrom.fem.full.full import FullModel
from fenicsrom.fem.mesh.mesh import build_mesh
from fenicsrom.fem.solid.solid import solid_of
from fenicsrom.online.model.model import Problem
from fenicsrom.online.motion.measures import amplitude, peak_normal_force, peak_total_normal_force
from fenicsrom.online.motion.motion import Motion
from fenicsrom.online.run.simulate import simulate
from fenicsrom.online.step.statics import _Statics
from fenicsrom.online.store.archive import StoredModel, load_model, save_model
from fenicsrom.online.store.scene_changes import changed_key
from fenicsrom.records import Study
from fenicsrom.reduction.basis import ReducedBasis
from fenicsrom.reduction.modes import component_modes
from fenicsrom.reduction.stages import Reduction
from fenicsrom.scene import Basis, Scene, read_scene
from fenicsrom.study import run

pytestmark = pytest.mark.slow

Array = NDArray[np.float64]

DEMO = Path(__file__).parents[2] / "demos" / "blade_rub.toml"
TINY = ("geometry.parameters.elements_along=4", "geometry.parameters.elements_across=2")
# pressed from the start: the centrifugal force takes up more than the gap
SHORT = (
    *TINY,
    "contacts.0.gap=0.9e-3",
    "time.steps_per_period=40",
    "time.periods=1",
    "time.steady_tolerance=0.0",
)


def blade(*overrides: str) -> Scene:
    """The scene of the demo with overrides."""
    return read_scene(DEMO, overrides)


def reduced(solid: Any) -> tuple[Any, ReducedBasis]:
    """The reduced model of a solid by the settings of its scene, and its basis."""
    found = Reduction(solid, scene_of(solid), lambda stage: contextlib.nullcontext())
    return found.model, found.basis


# ------------------------------------------------------------------ reduced against full


def assert_close(motion: Motion, full: Motion) -> None:
    """Tip amplitude (all points and directions) within 0.5 %, peak normal forces within 2 %."""
    ours, theirs = amplitude(motion), amplitude(full)
    assert np.linalg.norm(ours - theirs) < 5e-3 * np.linalg.norm(theirs)
    assert peak_normal_force(motion) == pytest.approx(peak_normal_force(full), rel=0.02)
    assert peak_total_normal_force(motion) == pytest.approx(peak_total_normal_force(full), rel=0.02)


def test_reduced_blade_matches_full_blade() -> None:
    """1 200 unknowns, two revolutions: the tip rubs at several nodes, slips, and lifts off."""
    solid = make_solid(
        blade(
            "geometry.parameters.elements_along=6",
            "geometry.parameters.elements_across=5",
            "time.steps_per_period=80",
            "time.periods=2",
            "time.steady_tolerance=0.0",
        )
    )
    assert solid.free > 1100
    model, basis = reduced(solid)
    assert basis.masters == 10 and basis.size < 30
    motion, full = simulate(model, scene_of(solid)), simulate(FullModel(solid), scene_of(solid))
    part = full.last_period()
    touching = np.any(full.force[part, :, 0] > 0.0, axis=1)
    assert 0.3 < touching.mean() < 0.9 and np.sum(np.any(full.force[part, :, 0] > 0.0, axis=0)) > 3
    assert peak_normal_force(full) > 50.0 and np.linalg.norm(amplitude(full)) > 1e-3
    assert_close(motion, full)
    assert motion.relative_imbalance < 1e-9 and full.relative_imbalance < 1e-9


def test_blade_elsewhere_around_its_axis_gives_the_same_motion() -> None:
    """The angle of the casing's waves starts at the middle of the tip, so it turns with the
    blade."""
    scene = blade(*SHORT)
    surface = replace(scene.contacts[0].surface, angle_from=None)
    scene = replace(scene, contacts=(replace(scene.contacts[0], surface=surface),))
    forces = []
    for angle in (0.0, 130.0):
        mesh = build_mesh(scene.geometry, MPI.COMM_WORLD)
        x, hub = mesh.domain.geometry.x, np.array(scene.rotation.point)
        x[:] = hub + Rotation.from_euler("y", angle, degrees=True).apply(x - hub)
        solid = solid_of(scene, mesh)
        found = Reduction(solid, scene, lambda stage: contextlib.nullcontext())
        forces.append(simulate(found.model, scene).force)
    assert forces[0].max() > 50.0
    np.testing.assert_allclose(forces[1], forces[0], rtol=0, atol=1e-6 * forces[0].max())


def test_reduced_blade_with_coriolis_force_matches_full_blade() -> None:
    """Gyroscopic forces change the motion, do no work, and are equal in both models."""
    motions = {}
    for coriolis in ("true", "false"):
        solid = make_solid(
            blade(
                *TINY,
                f"rotation.coriolis={coriolis}",
                "time.steps_per_period=60",
                "time.periods=2",
                "time.steady_tolerance=0.0",
                "contacts.0.gap=1.3e-3",
            )
        )
        model, _ = reduced(solid)
        motions[coriolis] = (
            simulate(model, scene_of(solid)),
            simulate(FullModel(solid), scene_of(solid)),
        )
    motion, full = motions["true"]
    assert_close(motion, full)
    for one in (motion, full):
        assert one.relative_imbalance < 1e-9 and one.friction_dissipation[-1] > 1.0
    # what it does is more than the reduced model is wrong by
    without = motions["false"][1]
    assert np.linalg.norm(amplitude(without) - amplitude(full)) > 0.01 * np.linalg.norm(
        amplitude(full)
    )


# ------------------------------------------------------------------ momentum


def balance(solid: Any, motion: Motion, q: Array, v: Array) -> tuple[Array, Array, Array]:
    """Rate of momentum, forces, and reaction, in each step of a motion by the discrete gradient,
    all (steps, 3), N.

    The support's force on the body is what the equations of the clamped unknowns, which no model
    solves, lack: with it the momentum obeys Newton's law if and only if the equations of the free
    unknowns are fulfilled. Everything is assembled anew, without supports.

    Args:
        solid: the body.
        motion: its motion.
        q: (ns, local) displacements from the equilibrium.
        v: (ns, local) velocities.
    """
    scene, h = scene_of(solid), np.diff(motion.time)[0]
    rotation, density = scene.rotation, scene.material.density
    u, w, test = fem.Function(solid.space), fem.Function(solid.space), ufl.TestFunction(solid.space)
    axis, point = ufl.as_vector(rotation.axis), ufl.as_vector(rotation.point)
    dx = solid.dx

    def out_of_axis(x: Any) -> Any:
        return x - ufl.dot(axis, x) * axis

    inertia = fem.form(density * ufl.dot(w, test) * dx)
    place = ufl.SpatialCoordinate(solid.mesh.domain) + u - point
    centrifugal = fem.form(density * rotation.omega**2 * ufl.dot(out_of_axis(place), test) * dx)
    coriolis = fem.form(-2.0 * rotation.omega * density * ufl.dot(ufl.cross(axis, w), test) * dx)

    def vector(
        form: Any, displacement: Array | None = None, velocity: Array | None = None
    ) -> Array:
        for function, values in ((u, displacement), (w, velocity)):
            if values is not None:
                solid.set_field(function, values)
        return np.asarray(solid.assembled(form))

    def internal(displacement: Array) -> Array:
        solid.set_field(solid._u, displacement)
        return np.asarray(solid.assembled(solid._force_form))

    clamped = np.setdiff1d(np.arange(solid.local), free_unknowns(solid))
    loads = solid.load_vector(scene.loads[0], "loads[0]") * scene.loads[0].size
    factor = np.sin(2.0 * 2.0 * np.pi * motion.time / scene.period)  # of the second engine order
    rates, forces, reactions = [], [], []
    for k in range(len(q) - 1):
        middle = solid.equilibrium + 0.5 * (q[k] + q[k + 1])
        half = (q[k + 1] - q[k]) / (2.0 * np.sqrt(3.0))
        elastic = 0.5 * (internal(middle - half) + internal(middle + half))
        rate = vector(inertia, velocity=(v[k + 1] - v[k]) / h)
        body = vector(centrifugal, middle) + 0.5 * (factor[k] + factor[k + 1]) * loads
        body -= scene.material.mass_damping * vector(inertia, velocity=0.5 * (v[k] + v[k + 1]))
        if rotation.coriolis:
            body += vector(coriolis, velocity=0.5 * (v[k] + v[k + 1]))
        contact = -np.einsum("pk,pkx->x", motion.mean_force[k + 1], solid.points.frame)
        support = np.zeros(solid.local)
        support[clamped] = (rate + elastic - body)[clamped]
        rates.append(rate.reshape(-1, 3).sum(axis=0))
        forces.append(body.reshape(-1, 3).sum(axis=0) + contact)
        reactions.append(support.reshape(-1, 3).sum(axis=0))
        assert (
            np.abs(elastic.reshape(-1, 3).sum(axis=0)).max() < 1e-9 * np.abs(elastic).sum()
        )  # nothing pulls itself
    return np.array(rates), np.array(forces), np.array(reactions)


def test_contact_and_support_forces_balance_rate_of_momentum() -> None:
    """The full model balances to rounding in every step.

    The reaction of the reduced model follows from its momentum; the stresses at its root, from
    a dozen shapes, miss a fifth of the contact forces on this mesh.

    Reference: forces of contact and support on a rubbing blade | rate of momentum | balance |
    agree | 1e-8
    """
    solid = make_solid(blade(*SHORT, "rotation.coriolis=true", "basis.modes=6"))
    full = simulate(FullModel(solid), scene_of(solid), keep_coordinates=True)
    assert full.coordinates is not None and full.velocity is not None
    rate, force, reaction = balance(solid, full, full.coordinates, full.velocity)
    pressed = full.force[:, :, 0].sum(axis=1).max()
    assert pressed > 100.0 and np.abs(rate).max() > 0.3 * pressed
    assert np.abs(rate - force - reaction).max() < 1e-8 * np.abs(reaction).max()

    model, basis = reduced(solid)
    motion = simulate(model, scene_of(solid), keep_coordinates=True)
    q, v = (coordinates @ basis.vectors.T for coordinates in (motion.coordinates, motion.velocity))
    ours, acting, _ = balance(solid, motion, q, v)
    error = np.linalg.norm(ours - acting - reaction, axis=1)
    assert np.sqrt(np.mean(error**2)) < 0.03 * pressed


# ------------------------------------------------------------------ points


def test_two_contacts_of_half_stiffness_equal_one_contact() -> None:
    """The displacements of both contacts are equal; the basis has each of them once."""

    def contact(share: float) -> dict[str, Any]:
        return touching(
            normal=[1.0, 0.0, 0.0],
            preload=share * 10.0,
            normal_stiffness=share * 1e7,
            tangential_stiffness=share * 1e7,
        )

    load = {"group": "load", "direction": [0.3, 1.0, 0.3], "force": 4e4, "frequency": 20.0}
    options = (
        *STOCKY,
        "geometry.parameters.width=0.1",
        "basis.masters='all'",
        "basis.derivatives=['1V1V']",
        "basis.modes=2",
        "time.periods=2",
        "time.steady_tolerance=0.0",
        "time.steps_per_period=100",
    )
    motions = []
    for contacts in ([contact(1.0)], [contact(0.4), contact(0.6)]):
        solid = make_solid(beam_scene(3, options, contacts=contacts, loads=[load]))
        model, basis = reduced(solid)
        assert basis.masters == 3
        motions.append(simulate(model, scene_of(solid)))
    one, two = motions
    assert {-1, 0} <= set(one.state[:, 0]), "it does not lift off and slip"
    size = np.abs(one.displacement).max()
    for point, share in ((0, 0.4), (1, 0.6)):
        np.testing.assert_allclose(
            two.displacement[:, point], one.displacement[:, 0], rtol=0, atol=1e-8 * size
        )
        np.testing.assert_allclose(
            two.force[:, point], share * one.force[:, 0], rtol=0, atol=1e-6 * one.force.max()
        )
        np.testing.assert_array_equal(two.state[:, point], one.state[:, 0])


@pytest.mark.parametrize("method", ["rubin", "craig-bampton"])
def test_slender_body_with_many_masters_keeps_its_basis(method: str) -> None:
    """Nine nodes of a tip face are 1e8 times stiffer against each other than the beam; residual
    flexibility and fixed-interface modes stay accurate."""
    contacts = [
        touching(at="nodes", normal=[1.0, 0.0, 0.0], normal_stiffness=1e8, tangential_stiffness=1e8)
    ]
    options = (f"basis.method='{method}'", "basis.masters='all'", "basis.derivatives=['1V1V']")
    solid = make_solid(beam_scene(3, options, contacts=contacts))
    _, basis = reduced(solid)
    assert (
        basis.masters == 27
        and np.abs(solid.contact_rows @ basis.vectors - np.eye(27, basis.size)).max() < 1e-12
    )
    found = component_modes(solid, Basis(method=method, modes=3, masters="all"))
    keep = free_unknowns(solid)
    k, m, b = (
        dense(solid.stiffness, keep),
        dense(solid.mass, keep),
        solid.contact_rows.toarray()[:, keep],
    )
    held = np.setdiff1d(np.arange(keep.size), np.argmax(b, axis=1))
    exact = np.zeros((keep.size, 27))
    exact[np.argmax(b, axis=1)] = np.eye(27)
    exact[held] = -np.linalg.solve(k[np.ix_(held, held)], k[held] @ exact)
    assert np.abs(found.masters[keep] - exact).max() < 1e-6 * np.abs(exact).max()
    error = found.masters[keep] - exact
    assert np.trace(error.T @ k @ error) < 1e-10 * np.trace(exact.T @ k @ exact)
    if method == "craig-bampton":
        squares = scipy.linalg.eigh(
            k[np.ix_(held, held)], m[np.ix_(held, held)], eigvals_only=True, subset_by_index=[0, 2]
        )
        np.testing.assert_allclose(found.omega**2, squares, rtol=1e-5)


def test_tributary_areas_add_up_to_area_or_length() -> None:
    """Corner nodes of quadratic tetrahedra have no tributary area and are no contact points; the
    other nodes keep the order along an edge."""
    contacts = [
        touching(
            at="nodes",
            normal=[1.0, 0.0, 0.0],
            preload=100.0,
            normal_stiffness=1e6,
            tangential_stiffness=1e6,
        )
    ]
    for cells, points in (("structured", 9), ("simplex", 5)):
        solid = make_solid(
            beam_scene(
                3,
                (*STOCKY, "geometry.parameters.width=0.1", f"geometry.cells='{cells}'"),
                contacts=contacts,
            )
        )
        assert len(
            solid.points.tributary_area
        ) == points and solid.points.tributary_area.sum() == pytest.approx(0.2 * 0.1, rel=1e-12)
        assert np.all(solid.points.tributary_area > 0.0)
    solid = make_solid(blade(*TINY))
    steps = np.linalg.norm(np.diff(solid.points.position, axis=0), axis=1)
    assert (
        solid.points.tributary_area.sum() == pytest.approx(steps.sum(), rel=1e-3)
        and steps.max() < 1.5 * steps.min()
    )
    radius = np.linalg.norm(solid.points.position[:, ::2] - [-0.3, 0.0], axis=1)
    np.testing.assert_allclose(radius, 1.0, atol=2e-5)  # the tip is ground to the casing


POINTS = """
import contextlib
import sys
import numpy as np
from fenicsrom.reduction.stages import Reduction
from test_blade import TINY, blade
from support import make_solid, scene_of
solid = make_solid(blade(*TINY, "basis.derivatives=['1V1V', '1V1S']"))
found = Reduction(solid, scene_of(solid), lambda stage: contextlib.nullcontext())
model, basis = found.model, found.basis
if solid.comm.rank == 0:
    np.savez(
        sys.argv[1], ranks=solid.comm.size, position=solid.points.position,
        share=solid.points.tributary_area, frame=solid.points.frame, mass=model.mass,
        omega=found.modes.omega, offset=model.contact_offset, rows=model.contact_rows,
        **model.elastic._asdict(),
    )
"""


@needs_mpirun
def test_two_ranks_find_same_points_in_same_order(tmp_path: Path) -> None:
    one, two = arrays_of_one_and_two_ranks(POINTS, tmp_path)
    assert (
        np.abs(two.pop("force")).max() < 1e-3 and np.abs(one.pop("force")).max() < 1e-3
    )  # of the equilibrium: rounding
    for name, ours in one.items():
        np.testing.assert_allclose(
            two[name], ours, rtol=0, atol=1e-6 * np.abs(ours).max(), err_msg=name
        )
    np.testing.assert_allclose(two["position"], one["position"], rtol=0, atol=1e-12)


# ------------------------------------------------------------------ casings in scenes


@pytest.mark.parametrize("dimension", [2, 3])
def test_force_of_closing_casing_matches_springs_in_series(dimension: int) -> None:
    """A casing slowly approaches a beam along its radius: the approach beyond the gap is N (1/k +
    1/K).

    Reference: casing that closes in on a beam: force | springs in series | closed form | agrees
    | 0.2 %
    """
    surface: dict[str, Any] = {"kind": "cylinder", "point": [-1.0, 0.0, 0.0][:dimension]}
    if dimension == 3:
        surface["axis"] = [0.0, 0.0, 1.0]
    gap, come, stiffness = 1e-4, 3e-4, 2e9
    contact = touching(
        surface=surface,
        gap=gap,
        approach=[[0.0, 0.0], [0.05, come], [0.06, come]],
        normal_stiffness=stiffness,
        tangential_stiffness=stiffness,
        friction=0.0,
    )
    overrides = (
        *STOCKY,
        *(("geometry.parameters.width=0.1",) * (dimension == 3)),
        "material.mass_damping=500.0",
    )
    solid = make_solid(
        beam_scene(
            dimension,
            overrides,
            contacts=[contact],
            loads=None,
            time={"duration": 0.06, "step": 2e-4},
            basis={"modes": 2, "derivatives": "none"},
        )
    )
    model, _ = reduced(solid)
    motion = simulate(model, scene_of(solid))
    rows = solid.contact_rows[:1].toarray()
    yielding = (rows @ solid.factor.solve(rows.T.copy())).item()
    expected = (come - gap) / (1.0 / stiffness + yielding)
    assert 0.1 < stiffness * yielding < 10.0  # both springs count
    assert motion.force[-1, 0, 0] == pytest.approx(expected, rel=2e-3)
    before = motion.time < 0.05 * gap / come
    assert not np.any(motion.force[before]) and motion.gap[0, 0] == pytest.approx(gap, rel=1e-9)
    np.testing.assert_allclose(
        motion.gap[before, 0], gap - come * motion.time[before] / 0.05, rtol=0, atol=1e-12
    )
    assert motion.gap[-1, 0] == pytest.approx(-expected / stiffness, rel=2e-3)


def test_number_of_masters_follows_from_the_contacts() -> None:
    contact = touching(normal=[1.0, 0.0, 0.0])
    contacts = [{**contact, "gap": 1e-3 * number} for number in range(9)]
    masters = [beam_scene(3, contacts=contacts[:count]).basis.masters for count in (4, 5, 8, 9)]
    assert masters == ["all", 15, 24, 10]
    paired = beam_scene(3, ('basis.derivatives="mmi"',), contacts=contacts[:5])
    assert paired.basis.masters == 10


# ------------------------------------------------------------------ the stored model


@pytest.fixture(scope="module")
def stored(tmp_path_factory: pytest.TempPathFactory) -> tuple[Any, StoredModel, Path]:
    """A small blade, its reduced model, and the file of this model."""
    solid = make_solid(blade(*SHORT, "basis.derivatives=['1V1V', '1V1S']"))
    found = Reduction(solid, scene_of(solid), lambda stage: contextlib.nullcontext())
    study = Study(
        scene_of(solid),
        solid,
        found.modes,
        found.selection,
        found.derivatives,
        found.basis,
        found.model,
    )
    path = tmp_path_factory.mktemp("stored") / "reduced_model.npz"
    save_model(path, study.stored)
    return solid, study.stored, path


def test_equilibrium_in_overlapping_casing_is_found_by_load_steps(
    stored: tuple[Any, StoredModel, Path],
) -> None:
    """At speed the blade grows into its casing; the equilibrium is found by load steps from zero
    pressure to the full one."""
    solid, made, _ = stored
    problem = _Statics(Problem.of(made.model, scene_of(solid)))
    q = np.zeros(made.model.size)
    assert problem.touches(q) and problem.pressed.sum() > 100.0
    found = []
    for part in (0.0, 0.5, 1.0):
        moved = problem.newton(q, part, 0.0)
        assert moved is not None
        found.append(np.linalg.norm(moved))
    assert found[0] <= 1e-9 * found[2] and 0.3 < found[1] / found[2] < 0.7


def test_stored_model_with_another_casing_equals_new_model(
    stored: tuple[Any, StoredModel, Path],
) -> None:
    """The stored model gives the same motion bit for bit; with another casing it equals the model
    that was made for this casing."""
    solid, made, path = stored
    read = load_model(path)
    before = simulate(read.model, read.scene)
    np.testing.assert_array_equal(before.force, simulate(made.model, scene_of(solid)).force)
    assert before.force[:, :, 0].max() > 50.0
    changes = [
        "contacts.0.gap=1.0e-3",
        "contacts.0.friction=0.1",
        "contacts.0.approach=[[0.0, 0.0], [0.01, 2e-4]]",
        "contacts.0.surface.spin=-200.0",
        "contacts.0.surface.waves=[[3, 1e-4, 0.5]]",
    ]
    after = read.with_overrides(changes).simulate()
    fresh = make_solid(blade(*SHORT, "basis.derivatives=['1V1V', '1V1S']", *changes))
    np.testing.assert_allclose(
        after.force,
        simulate(reduced(fresh)[0], scene_of(fresh)).force,
        rtol=0,
        atol=1e-6 * after.force.max(),
    )
    assert np.abs(after.force - before.force).max() > 0.1 * before.force.max()


def test_surface_with_other_normals_is_refused_by_stored_model() -> None:
    """A change that turns the normals at the contact points needs the mesh; everything else about a
    surface may change."""
    made = blade()
    for change in (
        "surface.point=[-0.2, 0.0, 0.0]",
        "surface.axis=[0.0, 1.0, 0.1]",
        "surface.inside=false",
    ):
        name = change.split("=")[0]
        assert (
            changed_key(made, blade(f"contacts.0.{change}", "contacts.0.gap=0.0"))
            == f"contacts[0].{name}"
        )
    sphere = "contacts.0.surface={kind='sphere', point=[-0.3, 0.0, 0.0]}"
    assert changed_key(made, blade(sphere)) == "contacts[0].surface.kind"
    for change in (
        "gap=1e-3",
        "approach=[]",
        "friction=0.3",
        "normal_stiffness=1e7",
        "surface.spin=0.0",
        "surface.waves=[]",
        "surface.angle_from=[1.0, 0.0, 0.0]",
    ):
        assert changed_key(made, blade(f"contacts.0.{change}")) is None
    for change in ("preload=1.0", "surface.radius=1.002"):
        assert changed_key(made, blade("contacts.0.gap=0.0", f"contacts.0.{change}")) is None


@pytest.mark.long
def test_demo_rubs_to_a_steady_state() -> None:
    """As the head of the demo says: two rubs per revolution with slip and lift-off, steady after
    about forty revolutions."""
    from mpi4py import MPI

    found = run(blade(), MPI.COMM_WORLD)
    assert found.unfinished is None and found.motions["reduced"].steady
    assert found.model is not None
    motion = simulate(found.model, blade("time.steady='march'"))
    assert motion.steady and 30 < motion.periods < 60
    assert found.errors["time step"].amplitude < 0.02 and found.errors["basis"].amplitude < 0.01
    pressed = motion.force[motion.last_period(), :, 0].sum(axis=1)
    starts = np.sum((pressed[1:] > 0.0) & (pressed[:-1] == 0.0))
    assert (
        starts == 2
        and 0.5 < np.mean(pressed > 0.0) < 0.8
        and 1 not in motion.state[motion.last_period()]
    )
    assert peak_normal_force(motion) == pytest.approx(304.5, rel=0.01)
    # friction at the speed of the tip: mu N v
    speed = 2.0 * np.pi * 50.0 * 1.0  # m/s
    per_step = np.diff(motion.time[motion.last_period()])
    work = 0.2 * speed * np.sum(0.5 * (pressed[1:] + pressed[:-1]) * per_step)
    assert motion.friction_dissipation[-1] - motion.friction_dissipation[motion.last_period()][
        0
    ] == pytest.approx(work, rel=0.02)
    assert any(
        note.key == "contacts[0]" and "of 17 points never touched" in note
        for note in found.left_out
    )


def test_scene_of_demo_survives_stored_model() -> None:
    """The stored model keeps the scene; the casing is at rest, so it turns in the frame of the
    blade."""
    from fenicsrom.scene import parse_scene, scene_table
    from fenicsrom.scene.keys.contacts import surface_spin

    scene = blade()
    again = parse_scene(json.loads(json.dumps(scene_table(scene))), scene.source, None)
    assert again == scene
    turn = 2.0 * np.pi * 50.0
    for changes, spin in (
        (["friction=0.3"], -turn),
        (["surface.axis=[0, 0, 1]", "surface.angle_from=[1, 0, 0]"], 0.0),
        (["surface.spin=3.0"], 3.0),
        (["surface.axis=[0, -1, 0]"], turn),
    ):
        other = blade(*(f"contacts.0.{change}" for change in changes))
        surface = other.contacts[0].surface
        assert surface is not None
        assert surface_spin(surface, other.rotation) == pytest.approx(spin, rel=1e-12)

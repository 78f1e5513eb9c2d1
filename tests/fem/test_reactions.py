"""Reactions of the supports against the balance of forces, moments and momentum."""

from __future__ import annotations

from contextlib import nullcontext
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from support import STOCKY, beam_scene, make_solid, random_field, scene_of

pytest.importorskip("dolfinx")


from fenicsrom.fem.solid.reaction_rows import reaction_table
from fenicsrom.online.motion.motion import Motion
from fenicsrom.online.run.simulate import simulate
from fenicsrom.online.stress.reactions import Reactions, equilibrium_reactions, motion_reactions
from fenicsrom.online.stress.stress import StressLaw
from fenicsrom.reduction.stages import Reduction

Array = NDArray[np.float64]


def at_rest(solid: Any) -> Reactions:
    """The reactions of the equilibrium of a solid."""
    scene = scene_of(solid)
    table = reaction_table(solid, scene, np.zeros((solid.local, 0)))
    return equilibrium_reactions(table, scene)


@pytest.mark.parametrize("bent", ["bent2d", "bent3d"])
def test_reaction_of_large_deflection_balances_load(
    bent: str, request: pytest.FixtureRequest
) -> None:
    """The force is minus the load, and the moment is that of the load at the deformed place.

    Reference: reactions of a large deflection | balance of forces and moments | closed form |
    agree | 1e-9
    """
    solid = request.getfixturevalue(bent)
    d, load = solid.dimension, scene_of(solid).loads[1]
    found = at_rest(solid)
    force = load.size * np.array(load.direction)
    size = np.linalg.norm(force)
    np.testing.assert_allclose(found.values[0, 0, :d], -force, rtol=0, atol=1e-9 * size)
    np.testing.assert_allclose(found.by_momentum[0], -force, rtol=0, atol=1e-9 * size)
    assert found.mismatch < 1e-9 and found.supports == ("root",)
    rows, place = solid.place(load.place, "loads[1]")
    arm = place[:d] + rows @ solid.equilibrium
    arm = arm - np.array([0.0, *_middle(solid)[1:]])
    moment = np.cross(np.pad(arm, (0, 3 - d)), np.pad(force, (0, 3 - d)))
    expected = -moment if d == 3 else -moment[2:]
    np.testing.assert_allclose(
        found.values[0, 0, d:], expected, rtol=0, atol=1e-9 * np.abs(moment).max()
    )


def _middle(solid: Any) -> Array:
    low, high = solid.mesh.bounds()
    return np.asarray((low + high)[: solid.dimension] / 2.0)


def test_reaction_of_spinning_bar_is_centrifugal_force() -> None:
    """m Ω² r of the centre of mass of the deformed bar, by the tangent at speed too."""
    solid = make_solid(
        beam_scene(
            2,
            (*STOCKY, "material.poisson=0.0"),
            contacts=None,
            rotation={"speed_rpm": 3000.0, "point": [0.0, 0.1]},
        )
    )
    found = at_rest(solid)
    omega, mass = 100.0 * np.pi, 7801.0 * 1.0 * 0.2 * 0.0254
    ramp = solid.translations()
    moved = solid.inner(ramp, _mass_times(solid, solid.equilibrium)[:, None])[0, 0]
    assert found.values[0, 0, 0] == pytest.approx(-(omega**2) * (0.5 * mass + moved), rel=1e-9)
    assert found.mismatch < 1e-9


def test_tip_mass_that_turns_pulls_at_its_radius() -> None:
    """m Ω² (L + u) of the mass at the tip of a bar without mass."""
    solid = make_solid(
        beam_scene(
            3,
            (*STOCKY, "material.poisson=0.0", "material.density=1e-6"),
            contacts=None,
            attachments=[{"group": "tip", "mass": 5.0}],
            rotation={"speed_rpm": 3000.0, "axis": [0.0, 0.0, 1.0], "point": [-0.5, 0.0, 0.0]},
        )
    )
    found = at_rest(solid)
    tip = solid.inner(solid.point_masses[:, None] / 5.0, solid.equilibrium[:, None])[0, 0]
    assert found.values[0, 0, 0] == pytest.approx(-5.0 * (100.0 * np.pi) ** 2 * (1.5 + tip))
    assert found.mismatch < 1e-9


def _mass_times(solid: Any, u: Array) -> Array:
    """M u with the rows of the clamped unknowns."""
    import ufl
    from dolfinx import fem

    density = solid.material.density * solid.thickness
    test = ufl.TestFunction(solid.space)
    form = fem.form(density * ufl.dot(solid.field(u), test) * solid.dx)
    return np.asarray(solid.assembled(form))


@pytest.mark.parametrize("dimension", [2, 3])
def test_loads_at_the_clamped_nodes_enter_the_reaction(dimension: int) -> None:
    """An acceleration of a hanging body: its weight, the part at the clamped nodes included."""
    width = ("geometry.parameters.width=0.15",) if dimension == 3 else ()
    down = [0.0, -1.0, 0.0][:dimension]
    solid = make_solid(
        beam_scene(
            dimension,
            (*STOCKY, *width),
            loads=[{"acceleration": 9.81, "direction": down}],
            contacts=None,
            probe={"group": "tip"},
        )
    )
    found = at_rest(solid)
    weight = 9.81 * 7801.0 * 1.0 * 0.2 * (0.15 if dimension == 3 else 0.0254)
    expected = np.zeros(dimension)
    expected[1] = weight
    np.testing.assert_allclose(found.values[0, 0, :dimension], expected, atol=1e-8 * weight)
    assert found.values[0, 0, -1] == pytest.approx(0.5 * weight, rel=1e-4)  # about z


MOVING = """
    geometry.parameters.length=1.0 geometry.parameters.height=0.05
    geometry.parameters.elements_along=6 time.periods=2 time.steady_tolerance=0.0
    loads.0.force=2000.0 loads.0.frequency=30.0 basis.modes=3 basis.derivatives='all'
""".split()


def moving(*overrides: str, **tables: Any) -> tuple[Any, Any, Any, Motion]:
    """A solid, its scene, its reduced model with the table of its reactions, and its motion."""
    solid = make_solid(beam_scene(2, (*MOVING, *overrides), **tables))
    scene = scene_of(solid)
    found = Reduction(solid, scene, lambda stage: nullcontext())
    model = found.model
    table = reaction_table(solid, scene, found.basis.vectors)
    return solid, model, table, simulate(model, scene, keep_coordinates=True)


@pytest.mark.slow
@pytest.mark.parametrize("scheme", ["discrete-gradient", "average-acceleration"])
def test_reaction_of_motion_balances_momentum(scheme: str) -> None:
    """The change of momentum over a period against the impulse of reactions, loads, contact."""
    solid, model, table, motion = moving(f"time.scheme='{scheme}'")
    scene = scene_of(solid)
    found = motion_reactions(table, scene, model, motion)
    assert motion.coordinate_time is not None and motion.velocity is not None
    time = motion.coordinate_time
    assert found.values.shape == (time.size - 1, 1, 3)
    momentum = motion.velocity @ table.mass[-1, :2].T
    rate = np.diff(momentum, axis=0) / np.diff(time)[:, None]
    damping = scene.material.mass_damping * 0.5 * (momentum[1:] + momentum[:-1])
    load = np.outer(2000.0 * np.sin(2.0 * np.pi * 30.0 * time), [0.0, 1.0])
    contact = -motion.mean_force[1 - time.size :, 0]  # the frame of the wall is that of the axes
    expected = rate + damping - 0.5 * (load[1:] + load[:-1]) - contact
    np.testing.assert_allclose(found.by_momentum, expected, atol=1e-9 * np.abs(expected).max())
    # from the stresses, the reduced model misses what its basis cannot resolve at the root
    assert 0.0 < found.mismatch < 0.03


def test_reaction_equals_residual_of_full_equations_at_the_clamped_unknowns() -> None:
    """Every term is assembled anew on the full model: stresses, inertia, Coriolis, centrifugal."""
    import ufl
    from dolfinx import fem

    solid = make_solid(
        beam_scene(
            3,
            (*STOCKY, "geometry.parameters.width=0.15", "geometry.parameters.elements_along=2"),
            contacts=None,
            rotation={
                "speed_rpm": 3000.0,
                "point": [0.1, -0.2, 0.05],
                "axis": [0.2, 1.0, 0.3],
                "coriolis": True,
            },
        )
    )
    scene = scene_of(solid)
    vectors = np.array([random_field(solid, 0.01, seed) for seed in range(3)]).T
    q, v, a = np.array([[0.3, -0.4, 0.5], [20.0, 10.0, -30.0], [3e4, 1e4, -2e4]])
    table = reaction_table(solid, scene, vectors)
    law, factor = StressLaw.of(scene), np.array([[1.5]])
    found, total = table.evaluate(law, q[None], v[None], a[None], factor)

    test, density, dx = ufl.TestFunction(solid.space), scene.material.density, solid.dx
    axis, point = ufl.as_vector(scene.rotation.axis), ufl.as_vector(scene.rotation.point)
    omega = scene.rotation.omega
    u = solid.field(solid.equilibrium + vectors @ q)
    velocity, inertia = solid.field(vectors @ v), solid.field(vectors @ a)
    arm = ufl.SpatialCoordinate(solid.mesh.domain) + u - point
    integrand = density * ufl.dot(inertia, test)
    integrand += 2.0 * density * omega * ufl.dot(ufl.cross(axis, velocity), test)
    integrand -= density * omega**2 * ufl.dot(arm - ufl.dot(axis, arm) * axis, test)
    smooth = solid.assembled(fem.form(integrand * dx)) - 1.5 * solid.load_vectors[:, 0]
    solid.set_field(solid._u, solid.equilibrium + vectors @ q)
    nodal = (smooth + solid.assembled(solid._force_form)).reshape(-1, 3)
    np.testing.assert_allclose(
        total[0], smooth.reshape(-1, 3).sum(axis=0), rtol=0, atol=1e-9 * np.abs(smooth).sum()
    )
    clamped = np.unique(solid.clamped // 3)
    x = solid.space.tabulate_dof_coordinates()[clamped]
    force = nodal[clamped].sum(axis=0)
    moment = np.cross(x - x.mean(axis=0), nodal[clamped]).sum(axis=0)
    expected = np.concatenate([force, moment])
    np.testing.assert_allclose(
        found[0, 0], expected, rtol=0, atol=1e-10 * np.abs(nodal[clamped]).sum()
    )


def test_viscous_forces_and_attachments_enter_the_reaction() -> None:
    """Every term is assembled anew: springs, masses, dashpots, and (β K + modal damping) u̇."""
    import ufl
    from dolfinx import fem

    beta, ratio = 2e-4, 0.03
    solid = make_solid(
        beam_scene(
            2,
            (*STOCKY, "geometry.parameters.elements_along=2"),
            contacts=None,
            loads=[{"group": "tip", "direction": [0.6, 0.8], "force": 3e6}],
            attachments=[
                {"group": "tip", "mass": 7.0, "stiffness": 2e7, "damping": 3e3},
                {"group": "root", "mass": 2.0, "stiffness": 1e6, "damping": 1e2},
            ],
            supports=[{"group": "root", "components": ["x"]}, {"node": [0.0, 0.1]}],
            damping={"stiffness": beta, "ratios": [0.0, ratio]},
        )
    )
    scene = scene_of(solid)
    assert np.abs(solid.equilibrium).max() > 1e-3
    vectors = np.array([random_field(solid, 0.01, seed) for seed in range(3)]).T
    q, v, a = np.array([[0.3, -0.4, 0.5], [20.0, 10.0, -30.0], [3e4, 1e4, -2e4]])
    table = reaction_table(solid, scene, vectors)
    found, total = table.evaluate(StressLaw.of(scene), q[None], v[None], a[None], np.ones((1, 1)))

    def elastic_force(u: Array) -> Array:
        solid.set_field(solid._u, u)
        return np.asarray(solid.assembled(solid._force_form))

    move, test = vectors @ v, ufl.TestFunction(solid.space)
    squares, modes = solid.eigenmodes(solid.factor, 2)
    u = solid.equilibrium + vectors @ q
    f = ufl.Identity(2) + ufl.grad(solid.field(solid.equilibrium))
    rate_of_stress = solid.materials.stress()(ufl.sym(f.T * ufl.grad(solid.field(move))))
    strained = ufl.inner(f * rate_of_stress, ufl.grad(test)) * solid.dx
    damped = solid.assembled(fem.form(strained))

    def momentum(field: Array) -> Array:
        form = solid.density * ufl.dot(solid.field(field), test) * solid.dx
        return np.asarray(solid.assembled(fem.form(form))) + solid.point_masses * field

    rate = 2.0 * ratio * np.sqrt(squares[1]) * (modes[:, 1] @ momentum(move))
    smooth = momentum(vectors @ a) + rate * momentum(modes[:, 1]) + solid.dashpots @ move
    smooth += solid.springs * (u + beta * move) - solid.load_vectors[:, 0]
    assert solid.springs.sum() > 0.0 and solid.dashpots.sum() > 0.0
    nodal = (smooth + beta * damped + elastic_force(u)).reshape(-1, 2)
    size = np.abs(nodal).sum()
    np.testing.assert_allclose(total[0], smooth.reshape(-1, 2).sum(axis=0), atol=1e-9 * size)
    pinned = np.intersect1d(solid.clamped[solid.clamped % 2 == 1] // 2, solid.clamped // 2)
    guided = np.unique(solid.clamped[solid.clamped % 2 == 0] // 2)
    assert pinned.size == 1 and guided.size > 1
    np.testing.assert_allclose(found[0, 0, 0], nodal[guided, 0].sum(), atol=1e-10 * size)
    np.testing.assert_allclose(found[0, 1, :2], [0.0, nodal[pinned[0], 1]], atol=1e-10 * size)


def test_two_supports_share_the_load() -> None:
    """A beam clamped at both ends: each carries half, the clamping moments are P L / 8.

    Reference: reactions of a beam clamped at both ends | closed form | P/2; PL/8 | agree | 0.5 %
    """
    load = {"group": "load", "at": "centre", "direction": [0.0, 1.0], "force": 100.0}
    sizes = ("length=1.0", "height=0.02", "elements_along=10", "load_at=0.5")
    solid = make_solid(
        beam_scene(
            2,
            tuple(f"geometry.parameters.{size}" for size in sizes),
            loads=[load],
            contacts=None,
            supports=[{"group": "root"}, {"group": "tip"}],
        )
    )
    found = at_rest(solid)
    assert found.supports == ("root", "tip")
    np.testing.assert_allclose(found.values[0, :, 1], [-50.0, -50.0], rtol=1e-8)
    np.testing.assert_allclose(found.values[0, :, 2], [-12.5, 12.5], rtol=5e-3)
    assert found.mismatch < 1e-9

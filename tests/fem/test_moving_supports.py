"""Moving supports of a solid, relative to them, against an explicit solution at rest in space."""

from __future__ import annotations

from contextlib import nullcontext
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from support import STOCKY, beam_scene, dense, make_solid, scene_of, slope

pytest.importorskip("dolfinx")

import ufl
from dolfinx import fem

from fenicsrom.fem.full.full import full_model
from fenicsrom.fem.solid.reaction_rows import reaction_table
from fenicsrom.online.model.loads import support_displacement
from fenicsrom.online.motion.measures import absolute_displacement
from fenicsrom.online.run.simulate import simulate
from fenicsrom.online.stress.reactions import motion_reactions
from fenicsrom.reduction.stages import Reduction

Array = NDArray[np.float64]

FREQUENCY, SIZE, ALONG = 40.0, 0.1, np.array([0.28, 0.96])

RUN = ("time.periods=1", "time.steady_tolerance=0.0")


def shaken(*overrides: str, **load: Any) -> Any:
    """A stocky cantilever of 4 elements whose supports move by 0.1 m on a slanted line."""
    given = {"support_displacement": SIZE, "frequency": FREQUENCY} | load
    given = {key: value for key, value in given.items() if value is not None}
    return make_solid(
        beam_scene(
            2,
            (*STOCKY, "material.young=2e10", *RUN, *overrides),
            loads=[{"direction": list(ALONG), **given}],
            contacts=None,
            probe={"group": "tip"},
        )
    )


@pytest.mark.parametrize("dimension", [2, 3])
def test_motion_of_the_supports_is_minus_an_acceleration_of_the_body(dimension: int) -> None:
    """With a concentrated mass; at the clamped nodes too."""
    width = ("geometry.parameters.width=0.15",) if dimension == 3 else ()
    direction = [0.6, -0.8, 0.0][:dimension]
    solid = make_solid(
        beam_scene(
            dimension,
            (*STOCKY, *width, "geometry.parameters.elements_along=2"),
            loads=[
                {"acceleration": 1.0, "direction": direction},
                {"support_acceleration": 1.0, "frequency": 5.0, "direction": direction},
            ],
            attachments=[{"group": "tip", "mass": 3.0}],
            contacts=None,
            probe={"group": "tip"},
        )
    )
    np.testing.assert_array_equal(solid.load_vectors[:, 1], -solid.load_vectors[:, 0])
    scene = scene_of(solid)
    vectors = [solid.load_vector(load, "loads") for load in scene.loads]
    np.testing.assert_array_equal(vectors[1], -vectors[0])
    along = np.tile(direction, solid.local // dimension)
    mass = 7801.0 * 0.2 * (0.15 if dimension == 3 else 0.0254) + 3.0
    assert along @ vectors[1] == pytest.approx(-mass, rel=1e-10)


def mass_form(solid: Any) -> Any:
    """The form of the mass matrix of all components."""
    trial, test = ufl.TrialFunction(solid.space), ufl.TestFunction(solid.space)
    return fem.form(solid.density * ufl.inner(trial, test) * solid.dx)


def unclamped(solid: Any, form: Any) -> Array:
    """A bilinear form as an array, with the rows of the clamped unknowns."""
    matrix = fem.petsc.create_matrix(form)
    fem.petsc.assemble_matrix(matrix, form)
    matrix.assemble()
    return dense(matrix, np.arange(solid.local))


def absolute_march(solid: Any, steps: int, duration: float) -> Array:
    """Absolute displacement (2,) of the probe after a time, by central differences.

    The nodes of the support follow their displacement in time. The elastic force is that of the
    absolute displacement of all nodes, the clamped ones included.
    """
    count = solid.local
    mass = unclamped(solid, mass_form(solid))
    free = np.setdiff1d(np.arange(count), solid.clamped)
    inverse = np.linalg.inv(mass[np.ix_(free, free)])
    omega, translation = 2.0 * np.pi * FREQUENCY, np.tile(ALONG, count // 2)
    held = mass[np.ix_(free, solid.clamped)] @ translation[solid.clamped]

    def acceleration(u: Array, time: float) -> Array:
        solid._u.x.array[:] = u  # in serial: there are no ghosts
        force = solid.assembled(solid._force_form)[free]
        return np.asarray(-inverse @ (force - held * SIZE * omega**2 * np.sin(omega * time)))

    h, u = duration / steps, np.zeros(count)
    v = SIZE * omega * translation[free]  # at rest relative to the supports
    v = v + 0.5 * h * acceleration(u, 0.0)
    for step in range(1, steps + 1):
        u[free] += h * v
        u[solid.clamped] = SIZE * np.sin(omega * step * h) * translation[solid.clamped]
        v = v + h * acceleration(u, step * h)
    weights = np.abs(solid.probe_rows[0]).reshape(-1, 2)[:, 0]
    return np.asarray(weights @ u.reshape(-1, 2))


@pytest.mark.slow
def test_full_model_converges_to_the_motion_in_space() -> None:
    """Large displacements: the tip moves by a quarter of its length in space.

    Reference: tip of a shaken cantilever in large displacements | central differences, fixed
    frame | 4000 steps | 0.05 %; order 2 | 1 %
    """
    duration, found = 0.75 / FREQUENCY, []
    solid = shaken("material.mass_damping=0.0")
    exact = absolute_march(solid, 4000, duration)
    assert np.linalg.norm(absolute_march(solid, 2000, duration) - exact) < 1e-5
    steps = (40, 80, 160)
    for number in steps:
        solid = shaken("material.mass_damping=0.0", f"time.steps_per_period={number}")
        scene = scene_of(solid)
        motion = simulate(full_model(solid), scene)
        found.append(absolute_displacement(scene, solid.points, motion)[3 * number // 4, 0])
    errors = np.linalg.norm(np.array(found) - exact, axis=1)
    assert errors[-1] < 0.01 * np.linalg.norm(exact)
    assert slope(steps, errors) == pytest.approx(-2.0, abs=0.3)


@pytest.mark.slow
def test_reduced_model_and_reactions_of_moving_supports() -> None:
    """Against the full model, and against the rate of the absolute momentum of all nodes.

    Reference: reactions of a shaken cantilever | rate of momentum | balance | agree | 0.2 %
    """
    solid = shaken("time.steps_per_period=80", "basis.modes=4", "basis.derivatives='all'")
    scene = scene_of(solid)
    made = Reduction(solid, scene, lambda name: nullcontext())
    model, basis = made.model, made.basis
    motion = simulate(model, scene, keep_coordinates=True)
    full = simulate(full_model(solid), scene)
    apart = np.abs(motion.displacement - full.displacement).max()
    assert apart < 1e-3 * np.abs(full.displacement).max()

    table = reaction_table(solid, scene, basis.vectors)
    found = motion_reactions(table, scene, model, motion)
    time, v = motion.coordinate_time, motion.velocity
    assert time is not None and v is not None
    ones, density = solid.translations(), 7801.0 * 0.0254
    import ufl

    test = ufl.TestFunction(solid.space)
    moved = [
        solid.assembled(fem.form(density * ufl.dot(solid.field(column), test) * solid.dx))
        for column in basis.vectors.T
    ]
    relative = v @ (ones.T @ np.array(moved).T).T
    omega, h = 2.0 * np.pi * FREQUENCY, np.diff(time)[:, None]
    support = np.outer(SIZE * omega * np.cos(omega * time), ALONG)
    momentum = relative + density * 0.2 * support
    expected = np.diff(momentum, axis=0) / h
    expected += scene.material.mass_damping * 0.5 * (relative[1:] + relative[:-1])
    np.testing.assert_allclose(found.by_momentum, expected, atol=2e-3 * np.abs(expected).max())
    assert found.mismatch < 0.1


def test_slow_shaking_moves_the_body_with_its_supports() -> None:
    """Reactions carry the whole mass, that of the clamped nodes included."""
    solid = shaken(
        "time.steps_per_period=40",
        "basis.modes=2",
        "material.mass_damping=0.0",
        support_displacement=None,
        support_acceleration=10.0,
        frequency=1.0,
    )
    scene = scene_of(solid)
    made = Reduction(solid, scene, lambda name: nullcontext())
    motion = simulate(made.model, scene, keep_coordinates=True)
    table = reaction_table(solid, scene, made.basis.vectors)
    found = motion_reactions(table, scene, made.model, motion)
    wave = 10.0 * np.sin(2.0 * np.pi * motion.coordinate_time)
    mass = 7801.0 * 0.2 * 0.0254
    expected = mass * np.outer(0.5 * (wave[1:] + wave[:-1]), ALONG)
    np.testing.assert_allclose(found.by_momentum, expected, atol=1e-2 * mass * 10.0)
    moved = support_displacement(scene.loads, motion.time, 2)
    absolute = absolute_displacement(scene, solid.points, motion)[:, 0]
    np.testing.assert_allclose(absolute, moved, atol=1e-3 * np.abs(moved).max())


def test_stiff_spring_moves_one_of_two_supports() -> None:
    """The end on a spring of 1e15 N/m³ is pulled by 1 mm; the exact motion has it prescribed.

    Reference: beam of which one support moves | complex dynamic stiffness | same mesh | agrees |
    0.2 %
    """
    spring, size, damping = 1e15, 1e-3, 200.0
    frequency = 250.0
    sizes = (
        *STOCKY,
        f"material.mass_damping={damping}",
        "time.steps_per_period=200",
        "time.periods=60",
        "basis.modes=4",
    )
    pull = {"group": "tip", "direction": list(ALONG), "traction": spring * size}
    tables = {"geometrically_nonlinear": False, "contacts": None, "probe": {"group": "load"}}
    solid = make_solid(
        beam_scene(
            2,
            sizes,
            attachments=[{"group": "tip", "stiffness_per_area": spring}],
            loads=[pull | {"frequency": frequency}],
            **tables,
        )
    )
    scene = scene_of(solid)
    motion = simulate(Reduction(solid, scene, lambda name: nullcontext()).model, scene)
    assert motion.steady
    both = make_solid(
        beam_scene(
            2,
            sizes,
            supports=[{"group": "root"}, {"group": "tip"}],
            loads=[{"acceleration": 1.0, "direction": [1.0, 0.0], "frequency": frequency}],
            **tables,
        )
    )
    omega = 2.0 * np.pi * frequency
    both._u.x.array[:] = 0.0
    stiffness, mass = unclamped(both, both._tangent_form), unclamped(both, mass_form(both))
    dynamic = stiffness + (1j * omega * damping - omega**2) * mass
    free = np.setdiff1d(np.arange(both.local), both.clamped)
    moved = np.setdiff1d(both.clamped, solid.clamped)
    held = dynamic[np.ix_(free, moved)] @ np.tile(size * ALONG, moved.size // 2)
    answer = both.probe_rows[:, free] @ np.linalg.solve(dynamic[np.ix_(free, free)], -held)
    found = np.ptp(motion.displacement[motion.last_period(), 0], axis=0) / 2.0
    np.testing.assert_allclose(found, np.abs(answer), rtol=2e-3)

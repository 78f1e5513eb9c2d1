"""Time the steps of reduced models beside the bare computations that they need.

    python3 tests/evidence/benchmark.py --floors

The floor of a step is the sum of the products of the elastic polynomial by BLAS and of the linear
solutions by LAPACK: in each Newton iteration the products at both Gauss points and one solution
with one right-hand side, and the product at the end of the step, which gives the elastic energy.
The models are random ones in two dimensions, with contact points along an edge that is shaken
against a plane. One point is pressed on the plane, slips and sticks; of many points some touch at a
time. All times are CPU times, the best of alternating repetitions in one process.
"""

from __future__ import annotations

from collections.abc import Callable
from time import process_time

import numpy as np
from numba import njit
from support import harmonic

from fenicsrom.arrays import Array
from fenicsrom.online.contact.points import ContactPoints
from fenicsrom.online.contact.state import OPEN
from fenicsrom.online.contact.surfaces import planes
from fenicsrom.online.model.model import Problem, ReducedModel, reduced_model
from fenicsrom.online.model.polynomial import elastic_polynomial
from fenicsrom.online.motion.motion import Motion
from fenicsrom.online.run.march import integrate
from fenicsrom.reduction.basis import strain_products
from fenicsrom.scene import Time

CASES = (1, 6), (1, 12), (1, 24), (1, 48), (17, 22), (101, 22), (505, 22)  # points, coordinates
REPETITIONS = 5


@njit(error_model="numpy")
def bare_steps(
    cubic: Array,
    columns: Array,
    pairs: Array,
    states: Array,
    matrix: Array,
    right: Array,
    iterations: int,
    steps: int,
) -> float:
    """Repeat the bare products and solutions of so many steps and iterations."""
    b, a, total = np.empty_like(pairs), np.empty((2, columns.shape[1])), 0.0
    for _ in range(iterations):
        np.dot(states, columns, a)
        np.dot(pairs, cubic, b)
        total += np.linalg.solve(matrix, right)[0]
    for _ in range(steps):
        np.dot(states[:1], columns, a[:1])
        np.dot(pairs[:1], cubic, b[:1])
    return total + a[0, 0] + b[0, 0]


def floor_of(model: ReducedModel, motion: Motion) -> float:
    """CPU time of the bare products and solutions of the steps of a motion, s per step."""
    n, p = model.size, model.elastic.cubic.shape[0]
    rng = np.random.default_rng(0)
    given = (
        model.elastic.cubic,
        np.ascontiguousarray(model.elastic.quadratic.T),
        rng.standard_normal((2, p)),
        rng.standard_normal((2, n)),
        model.mass + np.eye(n),
        rng.standard_normal(n),
    )
    bare_steps(*given, 1, 1)
    start = process_time()
    bare_steps(*given, motion.newton_iterations, motion.steps)
    return (process_time() - start) / motion.steps


def random_run(n: int, points: int) -> tuple[ReducedModel, Callable[[], Motion]]:
    """A random model of n coordinates with an edge of contact points, and a run of it."""
    rng = np.random.default_rng(n)
    gradients = rng.standard_normal((60, 1 + n, 2, 2))
    gradients[:, 0] = 0.0
    weights = rng.uniform(0.5, 1.5, 60) / 60
    along = np.linspace(0.0, np.pi, points)
    rows = np.zeros((points, 2, n))
    rows[:, 0, 0] = rows[:, 1, 1] = 1.0
    for i in range(2, n):
        rows[:, i % 2, i] = np.cos(i // 2 * along) / i if points > 1 else 0.0
    frames = np.tile(np.eye(2), (points, 1, 1))
    tensor = np.array([[2.6, 1.0, 0.0], [1.0, 2.6, 0.0], [0.0, 0.0, 1.6]])
    model = reduced_model(
        np.eye(n),
        0.05,
        elastic_polynomial(strain_products([(weights, gradients)], tensor, n), n),
        rng.uniform(0.5, 1.0, (n, 1)),
        harmonic(np.array([0.3]), np.array([1.0]), np.zeros(1)),
        ContactPoints(np.arange(points), np.ones(points), np.zeros((points, 2)), frames),
        rows.reshape(2 * points, n),
        np.zeros(2 * points),
        np.eye(2, n),
        np.zeros(2),
    )
    preload, farthest = (0.05, 0.0) if points == 1 else (0.0, 0.2)
    gap = farthest * np.arange(points) / max(points - 1, 1)
    share = np.full(points, 1.0 / points)
    contacts = planes(preload * share, gap, 5.0 * share, 5.0 * share, 0.4 + 0.0 * share, 2)
    periods = 10_000 // n**2  # runs of about equal CPU times
    settings = Time().changed(steps_per_period=300, periods=periods, steady_tolerance=0.0)

    def run() -> Motion:
        return integrate(Problem(model, contacts, settings, 2.0 * np.pi))

    return model, run


def measure() -> None:
    """Run all models and print the table."""
    print(f"{'points':>6} {'touch':>6} {'n':>3} {'iterations':>10} {'us':>8} {'floor':>8} ratio")
    for points, n in CASES:
        model, run = random_run(n, points)
        motion = run()
        best, floor = np.inf, np.inf
        for _ in range(REPETITIONS):
            start = process_time()
            run()
            best = min(best, (process_time() - start) / motion.steps)
            floor = min(floor, floor_of(model, motion))
        touching = float(np.mean(np.sum(motion.state != OPEN, axis=1)))
        print(
            f"{points:6} {touching:6.1f} {n:3} {motion.newton_iterations / motion.steps:10.2f} "
            f"{1e6 * best:8.1f} {1e6 * floor:8.1f} {best / floor:5.2f}",
            flush=True,
        )

"""Rank of the quartic elastic energy of stored models, and whether a form of low rank saves time.

    docker/run python3 tests/evidence/cubic_rank.py out/blade_rub/reduced_model.npz ..

In the products s_ij = q_i q_j (i <= j) the quartic part of the energy is s . C s / 24. Each
coordinate is scaled by its largest value in a motion, so that a relative error of C is one of the
energy. With the eigenvalues of the scaled C, its rank at a tolerance counts those above the
tolerance times the largest. A form of rank r reads r p numbers for a force; the program reads
p^2 / 2 of the p^2. The columns give the ranks, the largest error of the force of the truncated
form along the motion, relative to the largest elastic force of each coordinate, the rank that
this error needs to be below the tolerance, and the time of both forms.

Thirteen models of n = 10 to 77 (beam, blades, joint) need 9 to 59 %, 16 to 79 % and 32 to 100 % of
p at 1e-4, 1e-6 and 1e-9. A low rank saves only below 50 %: a few larger models would at 1e-9, by at
most a third, and only for motions as small as the one by which they were scaled. So the program
keeps all coefficients.
"""

import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

import fenicsrom as fr
from fenicsrom.arrays import Array
from fenicsrom.online.model.model import ReducedModel
from fenicsrom.online.model.polynomial import add_symmetric, pair_numbers, pairs
from fenicsrom.scene.reading.reading import with_time

TOLERANCES = (1e-4, 1e-6, 1e-9)


def motions(stored: fr.StoredModel) -> list[tuple[ReducedModel, Array]]:
    """The models of a file, from the smallest on, each with coordinates (k, n) of a motion."""
    scene = stored.scene
    if scene.period is not None:
        scene = with_time(scene, steady="march", periods=3)
    found = []
    for model in filter(None, (stored.model, stored.candidates)):
        moved = fr.simulate(model, scene, keep_coordinates=True).coordinates
        found.append((model, moved))
    if stored.whole is not None and not stored.model.turning.history.size:
        omega = scene.rotation.omega
        q0, vectors = stored.whole.vectors(omega, isinstance(scene.basis.masters, int), True)
        known = np.column_stack([vectors[label] for label in (*stored.labels, *stored.further)])
        found.append((stored.whole.model, q0 + found[-1][1] @ known.T))
    return found


def seconds_of(work: Callable[[], object], repeat: int = 200) -> float:
    """The shortest of some CPU times of a call, s."""
    times = []
    for _ in range(repeat):
        begin = time.process_time()
        work()
        times.append(time.process_time() - begin)
    return min(times)


def row(name: str, model: ReducedModel, moved: Array) -> str:
    """The ranks of a model, their errors along a motion, and the times, as a line of a table."""
    n, cubic = model.size, model.elastic.cubic
    first, second = pairs(n)
    own = first == second
    weight = np.where(own, 1.0, np.sqrt(2.0))  # |s| = |q|^2
    size = np.max(np.abs(moved), axis=0)
    scale = weight * size[first] * size[second]
    values, axes = np.linalg.eigh(scale[:, None] * (cubic / np.where(own, 0.5, 1.0)) * scale)
    order = np.argsort(-np.abs(values))
    values, axes = values[order], axes[:, order]
    s = (moved[:, first] * moved[:, second] * weight**2 / scale).T
    a = (model.elastic.quadratic @ moved.T)[pair_numbers(n)]  # (n, n, k)
    elastic = moved @ model.elastic.stiffness + 0.5 * np.einsum("ijk,kj->ki", a, moved)
    exact = _force(axes @ (values[:, None] * (axes.T @ s)) / scale[:, None], moved)
    largest = np.max(np.abs(elastic + exact), axis=0)
    texts = []
    for tolerance in TOLERANCES:
        rank = int(np.sum(np.abs(values) > tolerance * abs(values[0])))
        error = _error(axes, values, rank, s, scale, moved, exact, largest)
        ranks = range(0, values.size, max(1, values.size // 100))
        errors = (_error(axes, values, r, s, scale, moved, exact, largest) for r in ranks)
        enough = (r for r, error in zip(ranks, errors, strict=True) if error <= tolerance)
        needed = next(enough, values.size)
        texts.append(f"{rank} ({error:.0e}) {needed}")
    p = first.size
    t, b, half = np.zeros((1, p)), np.zeros((1, p)), np.random.default_rng(0).random((1, p))
    unique = seconds_of(lambda: add_symmetric(n, half, t, cubic, b))
    low = np.ascontiguousarray(axes[:, :needed])
    form = seconds_of(lambda: low @ (values[:needed] * (half[0] @ low)))
    return f"{name} {n} {p} | " + " | ".join(texts) + f" | {1e6 * unique:.1f} {1e6 * form:.1f}"


def _force(b: Array, q: Array) -> Array:
    """The cubic force, the sums over j of b_ij q_j / 6 (k, n), of 2 b (p, k) at points q (k, n)."""
    n = q.shape[1]
    first, second = pairs(n)
    full = np.zeros((q.shape[0], n, n))
    full[:, first, second] = full[:, second, first] = b.T
    return np.einsum("kij,kj->ki", full, q) / 6.0


def _error(
    axes: Array,
    values: Array,
    rank: int,
    s: Array,
    scale: Array,
    q: Array,
    exact: Array,
    largest: Array,
) -> float:
    """The largest error of a truncated form, relative to the largest elastic forces (n,)."""
    b = axes[:, :rank] @ (values[:rank, None] * (axes[:, :rank].T @ s))
    found = _force(b / scale[:, None], q)
    return float(np.max(np.abs(found - exact) / np.where(largest > 0.0, largest, 1.0)))


def main() -> None:
    """Print a line for each model of the files."""
    print(
        "model, n, p | rank (error of the force), rank for this error, at 1e-4 | 1e-6 | 1e-9 | us"
    )
    for name in sys.argv[1:]:
        for model, moved in motions(fr.load_model(name)):
            print(
                row(Path(name).parent.name, model, moved[:: max(1, len(moved) // 100)]), flush=True
            )


if __name__ == "__main__":
    main()

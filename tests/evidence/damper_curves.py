"""Curves of a beam with friction damper: points, marched periods, CPU time, and errors.

    python3 tests/evidence/damper_curves.py

A cantilever of 0.5 m with four contact points, clamped by friction. Under 4 N its response curve
has dozens of corners, where slip phases of the contact points appear and vanish. Scene (a) has
mass-proportional damping, scene (b) a ratio for each mode. The reference amplitudes are those of an
independent computation: an exact modal propagation of 1000 periods with 2000 samples each for (a),
harmonic balance with 21 harmonics for (b).
"""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np
from random_curves import MESHES, Followed, follow_curve

from fenicsrom.online.store.archive import StoredModel
from fenicsrom.scene import parse_scene
from fenicsrom.study import backbone, build_model

POINTS = [([0.15, 0.0, z], [0.0, 0.0, np.sign(z)]) for z in (0.01, -0.01)]
POINTS += [([0.25, 0.0, z], [0.0, 0.0, np.sign(z)]) for z in (0.01, -0.01)]
SCENE: dict[str, Any] = {
    "title": "friction damper on a beam",
    "geometrically_nonlinear": False,
    "geometry": {
        "mesh": "beam3d.geo",
        "dimension": 3,
        "parameters": {
            "length": 0.5,
            "height": 0.01,
            "width": 0.02,
            "elements_along": 20,
            "load_at": 0.8,
        },
    },
    "material": {"young": 2.1e11, "poisson": 0.3, "density": 7850.0},
    "supports": [{"group": "root"}],
    "loads": [
        {"nearest": [0.5, 0.0, 0.0], "direction": [0.0, 1.0, 0.0], "force": 1.0, "frequency": 36.0}
    ],
    "contacts": [
        {
            "nearest": place,
            "normal": normal,
            "preload": 20.0,
            "normal_stiffness": 1e6,
            "tangential_stiffness": 2e5,
            "friction": 0.3,
        }
        for place, normal in POINTS
    ],
    "probe": {"nearest": [0.5, 0.0, 0.0]},
    "basis": {"accuracy": 1.0},
    "response": {"first": 30.0, "last": 60.0},
    "backbone": {"mode": 1, "first": 1e-5, "last": 1e-2, "load_factors": [1.0]},
}
SCENES = {
    "a": SCENE | {"material": SCENE["material"] | {"mass_damping": 1.0}},
    "b": SCENE | {"damping": {"ratios": [0.003, 0.003, *[0.01] * 4], "stiffness": 5e-6}},
}
REFERENCES = {  # amplitude of the third contact point along y, mm, by frequency in Hz
    ("a", 0.2): {60.0: 0.005049},
    ("a", 4.0): {37.0: 0.031247, 39.3: 0.042737, 42.0: 0.056410, 46.0: 0.140943, 55.0: 0.141830},
    ("b", 0.3): {66.0: 0.025683, 70.0: 0.031325},
    ("b", 1.5): {
        50.0: 0.018089,
        55.0: 0.024248,
        62.0: 0.054807,
        66.0: 0.051960,
        70.0: 0.046432,
        75.0: 0.038114,
    },
    ("b", 5.0): {45.0: 0.227841, 50.0: 0.191009, 60.0: 0.134335, 70.0: 0.089667},
}
CURVES = [("a", force, 30.0, 60.0) for force in (0.2, 1.0, 2.0, 3.0, 4.0, 8.0, 16.0, 64.0)]
CURVES += [("a", 4.0, 60.0, 30.0)] + [("b", force, 40.0, 80.0) for force in (0.3, 1.5, 5.0, 20.0)]


def errors(followed: Followed, reference: dict[float, float]) -> str:
    """Relative errors of the amplitude at some frequencies, in percent."""
    said = []
    for frequency, exact in reference.items():
        a, b = next(
            pair
            for pair in pairwise(followed.curve.points)
            if (pair[0].parameter - frequency) * (pair[1].parameter - frequency) <= 0.0
        )
        share = (frequency - a.parameter) / (b.parameter - a.parameter)
        guesses = (a.s + share * (b.s - a.s), a.s, b.s)
        found = (followed.path.at_parameter(guess, frequency) for guess in guesses)
        point = next(point for point in found if point is not None)
        own = 1e3 * float(point.amplitude[2, 1])
        said.append(f"{frequency:g} Hz {100.0 * (own / exact - 1.0):+.2f}")
    return ", ".join(said)


def row(name: str, stored: StoredModel, force: float, first: float, last: float) -> str:
    """A line of the table: one curve."""
    stored = stored.with_overrides(
        [f"loads.0.force={force}", f"response={{first={first},last={last}}}"]
    )
    found = follow_curve(stored)
    points = found.curve.points
    top = max(points, key=lambda point: float(point.amplitude[2, 1]))
    marches = np.sum([point.marches for point in points + found.curve.special], axis=0)
    return (
        f"| ({name}) {force:g} N, {first:g} to {last:g} Hz "
        f"| {found.curve.reason} | {len(points)} | "
        f"{marches[1]} / {marches[0] - marches[1]} | {found.seconds:.1f} | "
        f"{1e3 * top.amplitude[2, 1]:.5f} at {top.parameter:.2f} | "
        f"{errors(found, REFERENCES.get((name, force), {}))} |"
    )


def main() -> None:
    """Print the table of the response curves, then that of the nonlinear mode."""
    models = {name: build_model(parse_scene(table, name, MESHES)) for name, table in SCENES.items()}
    columns = ("curve", "ends", "points", "periods with / without derivative", "CPU s")
    print("| " + " | ".join((*columns, "peak, mm", "errors, %")) + " |")
    print("|---|---|---|---|---|---|---|")
    for name, force, first, last in CURVES:
        print(row(name, models[name], force, first, last), flush=True)
    for name, stored in models.items():
        found = backbone(stored)
        top = max(found.points, key=lambda point: point.damping_ratio)
        peaks = ", ".join(
            f"{1e3 * peak.amplitude:.4g} mm at {peak.frequency:.2f} Hz" for peak in found.peaks
        )
        print(
            f"({name}) nonlinear mode: {found.reason}, {len(found.points)} points, "
            f"{found.seconds:.1f} s, largest damping ratio {top.damping_ratio:.4f} at "
            f"{top.frequency:.2f} Hz; peaks {peaks}; {' '.join(found.warnings)}"
        )


if __name__ == "__main__":
    main()

"""Motions known in closed form, for tests of measures and figures."""

from typing import Any

import numpy as np

from fenicsrom.online.curves.curve import CurvePoint, Extremes
from fenicsrom.online.motion.motion import Motion

PERIOD = 0.25
FRICTION, NORMAL_STIFFNESS, STIFFNESS = 0.5, 1e4, 2e4

# the documented keys of a response in summary.json
RESPONSE_KEYS = """
    amplitude_m fraction peak_normal_force_N peak_total_normal_force_N
    friction_dissipation_per_period_J energy_imbalance steady periods steps newton_iterations
""".split()


def curve_point(parameter: float, **fields: Any) -> CurvePoint:
    """A motion of one contact point on a curve of one variable.

    Args:
        parameter: of the curve.
        **fields: what matters in a test.
    """
    one = np.ones(1)
    usual: dict[str, Any] = {
        "z": np.zeros(1),
        "s": np.zeros(1),
        "tangent": np.array([0.0, 1.0]),
        "amplitude": np.ones((1, 2)),
        "peak_force": one,
        "friction_dissipation": 0.0,
        "multipliers": np.zeros(1, dtype=np.complex128),
        "verdict": "stable",
        "free_sliders": 0,
        "states": np.ones(1, dtype=np.int64),
        "residual": 0.0,
        "marches": (1, 1),
        "extremes": Extremes(one, one, one),
    }
    return CurvePoint(parameter, **usual | fields)


def jenkins(
    dimension=2,
    preload=30.0,
    normal=1e-3,
    tangential=8e-3,
    periods=4,
    steps=400,
    uneven=True,
    phase=0.0,
):
    """A point on a prescribed path: u_n = -normal cos 2wt, u_t = tangential sin wt; the contact law
    is applied step by step."""
    parts = np.linspace(0, 1, steps + 1)[:-1]
    if uneven:
        parts = parts + 0.12 * np.sin(2 * np.pi * parts) / (2 * np.pi)
    time = PERIOD * np.append((np.arange(periods)[:, None] + parts).ravel(), periods)
    angle = 2 * np.pi * time / PERIOD
    shift = np.zeros((len(time), 1, dimension))
    shift[:, 0, 0] = -normal * np.cos(2 * angle)
    shift[:, 0, 1] = tangential * np.sin(angle)
    if dimension == 3:
        shift[:, 0, 2] = 0.5 * tangential * np.sin(angle + phase)
    force, state, friction_dissipation = (
        np.zeros_like(shift),
        np.zeros((len(time), 1), dtype=np.int8),
        np.zeros(len(time)),
    )
    slider = shift[0, 0, 1:].copy()
    for i, u in enumerate(shift[:, 0]):
        pressure = max(0.0, preload + NORMAL_STIFFNESS * u[0])
        pull = STIFFNESS * (u[1:] - slider)
        size = np.linalg.norm(pull)
        state[i] = -1 if pressure == 0 else 1 if size <= FRICTION * pressure else 0
        if state[i] < 1:
            pull = pull * FRICTION * pressure / size if pressure else 0 * pull
            moved = u[1:] - pull / STIFFNESS - slider
            slider = slider + moved
            friction_dissipation[i] = (pull + force[i - 1, 0, 1:]) / 2 @ moved if i else 0.0
        force[i, 0] = [pressure, *pull]
    return motion(time, shift, force, state, friction_dissipation=np.cumsum(friction_dissipation))


def motion(
    time,
    displacement,
    force=None,
    state=None,
    friction_dissipation=None,
    period=PERIOD,
    point_friction_dissipation=None,
):
    """A motion whose energy ledger balances except for 1e-3 J at the end."""
    ns, _, d = displacement.shape
    friction_dissipation = np.zeros(ns) if friction_dissipation is None else friction_dissipation
    points = 0 if force is None else force.shape[1]
    return Motion(
        time=time,
        period=period,
        displacement=displacement,
        force=np.zeros((ns, 0, d)) if force is None else force,
        mean_force=np.zeros((ns, points, d)),
        gap=np.zeros((ns, points)),
        state=np.zeros((ns, 0), dtype=np.int8) if state is None else state,
        kinetic=2.0 * np.sin(2 * np.pi * time / PERIOD) ** 2,
        elastic=2.0 * np.cos(2 * np.pi * time / PERIOD) ** 2,
        contact_energy=np.zeros(ns),
        work=friction_dissipation + time,
        damping_dissipation=time - 1e-3 * (time / time[-1]),
        friction_dissipation=friction_dissipation,
        point_friction_dissipation=np.tile(friction_dissipation[:, None] / max(points, 1), points)
        if point_friction_dissipation is None
        else point_friction_dissipation,
        steady=True,
        periods=round(time[-1] / PERIOD),
        steps=ns - 1,
        rejected=2,
        newton_iterations=3 * ns,
        seconds=0.1,
    )


def side_by_side(*cases):
    """Motions of one contact point each as the points of one motion."""
    joined = [
        np.concatenate([getattr(case, name) for case in cases], axis=1)
        for name in ("displacement", "force", "state")
    ]
    friction_dissipation = np.array([case.friction_dissipation for case in cases])
    return motion(
        cases[0].time,
        *joined,
        friction_dissipation=friction_dissipation.sum(axis=0),
        point_friction_dissipation=friction_dissipation.T,
    )

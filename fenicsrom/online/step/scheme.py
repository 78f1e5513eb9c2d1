"""The weights of the one-step schemes."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from fenicsrom.arrays import Array


class Scheme(NamedTuple):
    """The weights of a one-step scheme, as in `fenicsrom.online.run.march`.

    Attributes:
        alpha_m: weight am of the old acceleration.
        alpha_f: weight af of the old velocity, load and friction.
        beta: Newmark's beta.
        gamma: Newmark's gamma.
        discrete_gradient: elastic and contact forces are means along the step.
        start_weight: weight of the elastic force at the start of the step.
        points: (g,) points in [0, 1] along the step at which the elastic force is evaluated.
        weights: (g,) their weights.
        damping: alpha of the model, 1/s.
        linear: one iteration solves the step: the force is linear and Newton's method exact.
        velocity_forces: the model has forces D v.
        quadratic: Newton's method is exact and converges quadratically; otherwise the model keeps
            a factor for several iterations, which converge linearly.
        all_points: every step solves for all contact points, whose solutions the model keeps with
            its factor; otherwise only for those that may touch.
    """

    alpha_m: float
    alpha_f: float
    beta: float
    gamma: float
    discrete_gradient: bool
    start_weight: float
    points: Array
    weights: Array
    damping: float
    linear: bool
    velocity_forces: bool
    quadratic: bool
    all_points: bool


def scheme(name: str, model: Any, spectral_radius: float = 0.8) -> Scheme:
    """The scheme of this name for a model.

    Args:
        name: "average-acceleration", "generalised-alpha" or "discrete-gradient".
        model: gives the damping, whether it is linear, and the number of Gauss points that
            integrate its force exactly.
        spectral_radius: spectral radius of generalised-alpha at infinite frequency, in [0, 1].
    """
    model_is = (
        float(model.damping),
        bool(model.linear and model.exact_newton),
        bool(model.velocity_forces),
        bool(model.exact_newton),
        not model.exact_newton,
    )
    end = np.ones(1)
    if name == "average-acceleration":
        return Scheme(0.0, 0.0, 0.25, 0.5, False, 0.0, end, end, *model_is)
    if name == "generalised-alpha":
        am = (2.0 * spectral_radius - 1.0) / (spectral_radius + 1.0)
        af = spectral_radius / (spectral_radius + 1.0)
        beta, gamma = 0.25 * (1.0 - am + af) ** 2, 0.5 - am + af
        return Scheme(am, af, beta, gamma, False, af, end, np.array([1.0 - af]), *model_is)
    if name == "discrete-gradient":
        points, weights = np.polynomial.legendre.leggauss(model.gauss_points)
        return Scheme(0.5, 0.5, 0.25, 0.5, True, 0.0, 0.5 + 0.5 * points, 0.5 * weights, *model_is)
    raise ValueError(
        f"scheme {name!r}: must be average-acceleration, generalised-alpha or discrete-gradient"
    )


class Control(NamedTuple):
    """How the step is chosen.

    Attributes:
        grid: the run stops on multiples of this time after `origin`, s; the step never exceeds it.
        tolerance: for adaptive steps: the local error of a step is at most
            `online.step.loop.STEP_SHARE` of it, relative to the size of the motion; 0 for a
            fixed step.
        size: lower bound of the size of the motion in relative errors, in the mass norm.
        times: (k,) ascending times in place of the grid, s; none where the grid is equidistant.
    """

    grid: float
    tolerance: float
    size: float
    times: Array = np.zeros(0)

"""The axes along which `fenicsrom stability` drives a scene to its extremes.

The values of an axis have no unit: they multiply a value of the scene, or a scale of its reduced
model (`Scales`). A scene that is written in other units therefore has the same axes. An axis is
left out, with the reason, if the scene lacks the feature that it varies.
"""

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.linalg

from fenicsrom.arrays import Array
from fenicsrom.assess.errors.plausibility import closed_stiffness
from fenicsrom.online.contact.points import shares
from fenicsrom.online.model.model import ReducedModel
from fenicsrom.online.model.polynomial import elastic_force
from fenicsrom.scene import Scene, scene_table
from fenicsrom.scene.checks.checks import LEAST_MODES

# a smaller inverse buckling factor, relative to the largest, is rounding
LEAST_INVERSE_FACTOR = 1e-9


@dataclass(frozen=True)
class Scales:
    """The scales of a scene, in its units.

    Attributes:
        normal_stiffness: for each contact, the `normal_stiffness` at which the contact is as stiff
            as the body under it.
        tangential_stiffness: for each contact, the `tangential_stiffness` at which the contact is
            as stiff as the body in its most flexible tangential direction.
        preload: for each contact, the `preload` that buckles the body; None if nothing presses on
            the body, or if no preload buckles it.
        omega: first natural frequency of the reduced model about its equilibrium, rad/s.
        whose: whose stiffness those of the contacts are. Bodies that contacts hold have none of
            their own, so with contacts between bodies it is that of the scene's contacts.
    """

    normal_stiffness: tuple[float, ...]
    tangential_stiffness: tuple[float, ...]
    preload: tuple[float, ...] | None
    omega: float
    whose: str = "the body's"


def scales_of(model: ReducedModel, scene: Scene) -> Scales:
    """Compute the scales of a scene from its reduced model."""
    if scene.joined:
        pairs = [(one.normal_stiffness, one.tangential_stiffness) for one in scene.contacts]
        squares = scipy.linalg.eigh(closed_stiffness(model, scene), model.mass, eigvals_only=True)
        along, across = zip(*pairs, strict=True)
        return Scales(along, across, None, float(np.sqrt(max(squares[0], 0.0))), "the scene's")
    share = shares(scene, model.points)
    stiffness = [_body_stiffness(model, share, k) for k in range(len(scene.contacts))]
    squares = scipy.linalg.eigh(_symmetric_stiffness(model), model.mass, eigvals_only=True)
    first, rest = (tuple(pair[i] for pair in stiffness) for i in range(2))
    omega = float(np.sqrt(max(squares[0], 0.0)))
    return Scales(first, rest, buckling_preload(model, scene), omega)


def _symmetric_stiffness(model: ReducedModel) -> Array:
    """The symmetric part (n, n) of the tangent at q = 0; all of it without follower pressures."""
    stiffness = model.rest_stiffness()
    return np.asarray(0.5 * (stiffness + stiffness.T)) if model.pressure.numbers.size else stiffness


def _body_stiffness(model: ReducedModel, share: Array, contact: int) -> tuple[float, float]:
    """Stiffness of the body at a contact along the normal and the softest tangent.

    With the flexibility C = B^T K^-1 B at the contact points and a unit force spread by their
    shares a_p (P,), f_p = a_p / sum a, the body has the stiffness 1 / (f^T C f). Springs of
    stiffness k per share together have the stiffness k sum a.
    """
    areas = np.where(model.points.contact == contact, share, 0.0)
    dimension = model.points.position.shape[1]
    flexibility = []
    for direction in range(dimension):
        force = np.zeros((areas.size, dimension))
        force[:, direction] = areas / areas.sum()
        load = model.contact_rows.T @ force.reshape(-1)
        flexibility.append(float(load @ np.linalg.solve(model.rest_stiffness(), load)))
    softest = flexibility[0], max(flexibility[1:])
    normal, tangential = (float(1.0 / (c * areas.sum())) for c in softest)
    return normal, tangential


def buckling_preload(model: ReducedModel, scene: Scene) -> tuple[float, ...] | None:
    """The preload of each contact that buckles the body, or None.

    Linear buckling: the preload N displaces the body by q1 = -K^-1 B^T N. This changes the tangent
    by K_g = A q1. The buckling factor is the least positive factor with det(K + factor K_g) = 0.
    The contact springs and the curvature of the surface are left out.

    Args:
        model: the reduced model.
        scene: its scene. One factor scales all its preloads. If it has neither preloads nor gaps,
            all contacts get equal preloads.
    """
    pattern = np.array([contact.preload for contact in scene.contacts])
    if not pattern.any() and not any(contact.gap for contact in scene.contacts):
        pattern = np.ones(len(scene.contacts))
    if model.linear or not pattern.any():
        return None
    force = np.zeros((model.points.contact.size, scene.geometry.dimension))
    force[:, 0] = pattern[model.points.contact] * shares(scene, model.points)
    stiffness = _symmetric_stiffness(model)
    q: Array = np.asarray(
        -np.linalg.solve(stiffness, model.contact_rows.T @ force.reshape(-1)), dtype=np.float64
    )
    # the tangent is a polynomial of second degree: this difference is exact
    geometric = 0.5 * (_tangent(model, q) - _tangent(model, -q))
    inverse_factors = scipy.linalg.eigh(-geometric, stiffness, eigvals_only=True)
    largest = float(inverse_factors[-1])
    if not largest > LEAST_INVERSE_FACTOR * float(np.max(np.abs(inverse_factors))):
        return None
    return tuple(float(preload) / largest for preload in pattern)


def _tangent(model: Any, q: Array) -> Array:
    """The tangent stiffness (n, n) at q (n,)."""
    force, tangent = np.empty_like(q), np.empty((q.size, q.size))
    elastic_force(model.elastic, np.ascontiguousarray(q), force, tangent)
    return tangent


Overrides = tuple[str, ...]
Values = dict[str, Overrides]

SCHEMES = ("discrete-gradient", "average-acceleration", "generalised-alpha")


@dataclass(frozen=True)
class Case:
    """One run of the stability matrix.

    Attributes:
        axis: name of the axis that is varied.
        value: the value on this axis, in a few words.
        overrides: the overrides of the scene.
        model: "reduced", "full" or "beam".
        richer: overrides of a richer basis to compare with; empty for no comparison.
        scale: length in m of the unit of the scene. If it is not 1, the run must agree with the run
            in metres.
        full: compare with the full model at the same time steps.
    """

    axis: str
    value: str
    overrides: Overrides
    model: str = "reduced"
    richer: Overrides = ()
    scale: float = 1.0
    full: bool = False


class LeftOut(Exception):
    """The scene lacks the feature that an axis varies; the message names it."""


def cases_of(
    scene: Scene, scales: Scales, axes: Iterable[str] = ()
) -> tuple[list[Case], list[str]]:
    """All runs of a scene, and a sentence for each axis that is left out.

    Args:
        scene: the scene.
        scales: its scales.
        axes: names of the axes to run; by default all.
    """
    chosen = set(axes) or set(AXES)
    cases, left_out = [], []
    rich = (f"basis.modes={_mode_count(scene) + 2}", "basis.derivatives='all'")
    for axis, values in AXES.items():
        if axis not in chosen:
            continue
        try:
            made = values(scene, scales)
        except LeftOut as reason:
            left_out.append(f"axis {axis}: left out: {reason}")
            continue
        richer = rich if axis in RICHER and scene.geometrically_nonlinear else ()
        cases += [Case(axis, value, changes, richer=richer) for value, changes in made.items()]
        if axis == "scene":
            wanted = {"full": scene.reference.full, "beam": scene.reference.beam}
            cases += [Case(axis, "as it is", (), model) for model, runs in wanted.items() if runs]
    return cases, left_out


# ---------------------------------------------------------------------- overrides


def contacts_with(scene: Scene, **values: Sequence[float]) -> Overrides:
    """Set some keys of every contact; each key has one value for each contact.

    Raises:
        LeftOut: the scene has no contact.
    """
    if not scene.contacts:
        raise LeftOut("the scene has no contact")
    pairs = [(key, k, entry) for key, entries in values.items() for k, entry in enumerate(entries)]
    return tuple(f"contacts.{k}.{key}={entry!r}" for key, k, entry in pairs)


def loads_times(scene: Scene, factor: float, static: bool = False) -> Overrides:
    """Multiply all loads that vary in time, or all static loads.

    Raises:
        LeftOut: there is no such load.
    """
    chosen = [(k, load) for k, load in enumerate(scene.loads) if load.static == static]
    if not chosen:
        raise LeftOut("the scene has no static load" if static else "no load varies in time")
    return tuple(f"loads.{k}.{load.kind}={factor * load.size!r}" for k, load in chosen)


def contact_stiffness(scene: Scene, scales: Scales, normal: float, tangential: float) -> Overrides:
    """Contact stiffnesses as multiples of the stiffness of the body at the contact."""
    along, across = scales.normal_stiffness, scales.tangential_stiffness
    values = {
        "normal_stiffness": [normal * stiffness for stiffness in along],
        "tangential_stiffness": [tangential * stiffness for stiffness in across],
    }
    return contacts_with(scene, **values)


def preload(scene: Scene, scales: Scales, factor: float) -> Overrides:
    """Multiples of the buckling preload; without one, multiples of the preload of the scene."""
    if scales.preload is not None:
        return contacts_with(scene, preload=[factor * size for size in scales.preload])
    if scene.contacts and not any(contact.preload for contact in scene.contacts):
        raise LeftOut("the contacts have no preload")
    return contacts_with(scene, preload=[factor * contact.preload for contact in scene.contacts])


# ---------------------------------------------------------------------- the axes


def _scene(scene: Scene, scales: Scales) -> Values:
    return {"as it is": ()}


def _contact_stiffness(scene: Scene, scales: Scales) -> Values:
    factors = (1e-4, 1e-2, 1.0, 1e2, 1e4)
    return {f"{x:g} times {scales.whose}": contact_stiffness(scene, scales, x, x) for x in factors}


def _stiffness_apart(scene: Scene, scales: Scales) -> Values:
    whose = scales.whose
    return {
        f"normal {n:g}, tangential {t:g} times {whose}": contact_stiffness(scene, scales, n, t)
        for n, t in ((1e-3, 1e3), (1e3, 1e-3), (1e4, 1.0), (1.0, 1e6))
    }


def _friction(scene: Scene, scales: Scales) -> Values:
    values, count = (0.0, 0.01, 1.0, 3.0, 10.0), len(scene.contacts)
    return {f"{mu:g}": contacts_with(scene, friction=count * [mu]) for mu in values}


def _preload(scene: Scene, scales: Scales) -> Values:
    if scales.preload is not None:
        unit = "the buckling load"
        factors: tuple[float, ...] = (0.0, 0.1, 0.5, 0.9, 0.99, 1.01, 1.1, 2.0)
    else:
        unit, factors = "the preload", (0.0, 0.1, 3.0, 10.0, 30.0)
    return {f"{x:g} times {unit}": preload(scene, scales, x) for x in factors}


def _gap(scene: Scene, scales: Scales) -> Values:
    if scene.contacts and not any(contact.gap for contact in scene.contacts):
        raise LeftOut("no contact has a gap")
    gaps, factors = [contact.gap or 0.0 for contact in scene.contacts], (0.5, 0.9, 1.1, 2.0)
    return {f"{x:g} times": contacts_with(scene, gap=[x * g for g in gaps]) for x in factors}


def _approach(scene: Scene, scales: Scales) -> Values:
    moving = [(k, contact) for k, contact in enumerate(scene.contacts) if contact.approach]
    if not moving:
        raise LeftOut("no contact has an approach")

    def times(factor: float) -> Overrides:
        steps = {k: [[t, factor * way] for t, way in contact.approach] for k, contact in moving}
        return tuple(f"contacts.{k}.approach={approach}" for k, approach in steps.items())

    return {f"{x:g} times": times(x) for x in (0.0, 0.5, 2.0, 5.0)}


def _load(scene: Scene, scales: Scales) -> Values:
    factors = (1e-6, 1e-3, 0.1, 2.0, 5.0, 10.0, 30.0)
    return {f"{x:g} times": loads_times(scene, x) for x in factors}


def _static_load(scene: Scene, scales: Scales) -> Values:
    return {f"{x:g} times": loads_times(scene, x, static=True) for x in (-1.0, 0.1, 2.0, 5.0)}


def _frequency(scene: Scene, scales: Scales) -> Values:
    tables = scene_table(scene)["loads"]
    own = [k for k, load in enumerate(tables) if "frequency" in load and "engine_order" not in load]
    given = {k: float(tables[k]["frequency"]) for k in own}
    if not given or any("sweep" in table for table in tables):
        raise LeftOut("no load has a constant frequency of its own")
    first, lowest = scales.omega / (2.0 * math.pi), min(given.values())

    def lowest_at(x: float) -> Overrides:
        changed = {k: x * first * value / lowest for k, value in given.items()}
        return tuple(f"loads.{k}.frequency={value!r}" for k, value in changed.items())

    factors = (0.1, 0.5, 0.9, 1.0, 1.1, 2.0)
    return {f"{x:g} times the first natural frequency": lowest_at(x) for x in factors}


def _damping(scene: Scene, scales: Scales) -> Values:
    """Damping ratios of the first mode: alpha = 2 ratio omega_1."""
    alpha = {ratio: 2.0 * ratio * scales.omega for ratio in (0.0, 1e-3, 1e-2, 0.1, 1.0, 100.0)}
    return {f"ratio {x:g}": (f"material.mass_damping={alpha[x]!r}",) for x in alpha}


def _steps(scene: Scene, scales: Scales) -> Values:
    if scene.period is not None:
        counts = (10, 20, 50, 100, 500, 2000)
        return {f"{n} a period": (f"time.steps_per_period={n}",) for n in counts}
    if scene.time.step is None:
        raise LeftOut("the step of the scene follows from its tolerance")
    steps = {x: x * scene.time.step for x in (10.0, 4.0, 2.0, 0.5, 0.1)}
    return {f"{x:g} times as long": (f"time.step={step!r}",) for x, step in steps.items()}


def _tolerance(scene: Scene, scales: Scales) -> Values:
    if scene.joined:
        raise LeftOut("bodies that touch need a fixed step")
    return {f"{t:g}": (f"time.tolerance={t!r}",) for t in (1e-1, 1e-2, 1e-3, 1e-5)}


def _scheme(scene: Scene, scales: Scales) -> Values:
    return {name: (f"time.scheme='{name}'",) for name in SCHEMES if name != scene.time.scheme}


def _poisson(scene: Scene, scales: Scales) -> Values:
    if not scene.material.is_isotropic:
        raise LeftOut("the material is not isotropic")
    ratios = {f"{nu:g}": (f"material.poisson={nu!r}",) for nu in (0.0, 0.45, 0.499)}
    if scene.geometry.dimension == 3:
        return dict(ratios)
    return {
        f"{ratio}, plane {name}": (*change, f"geometry.plane='{name}'")
        for ratio, change in ratios.items()
        for name in ("stress", "strain")
    }


def _mode_count(scene: Scene) -> int:
    """The number of normal modes of a scene; the least number if the structure decides."""
    return LEAST_MODES if isinstance(scene.basis.modes, str) else scene.basis.modes


def _modes(scene: Scene, scales: Scales) -> Values:
    return {f"{count}": (f"basis.modes={count}",) for count in (1, 2, 5, 10, 20)}


def _derivatives(scene: Scene, scales: Scales) -> Values:
    if not scene.geometrically_nonlinear:
        raise LeftOut("the scene is geometrically linear")
    other = "craig-bampton" if scene.basis.method == "rubin" else "rubin"
    more = f"basis.modes={_mode_count(scene) + 1}"
    found: Values = {
        "none": ("basis.derivatives='none'",),
        "all": ("basis.derivatives='all'",),
        "all of one mode more": ("basis.derivatives='all'", more),
    }
    if scene.joined:
        return found
    return found | {f"all, {other}": (f"basis.method='{other}'", "basis.derivatives='all'")}


def _speed(scene: Scene, scales: Scales) -> Values:
    if scene.rotation is None or not scene.rotation.speed_rpm:
        raise LeftOut("the body does not rotate")
    speed, other = scene.rotation.speed_rpm, not scene.rotation.coriolis
    found: Values = {
        f"{x:g} times": (f"rotation.speed_rpm={x * speed!r}",) for x in (0.01, 0.1, 0.5, 0.9, 1.1)
    }
    word = "with" if other else "without"
    return found | {f"{word} Coriolis force": (f"rotation.coriolis={str(other).lower()}",)}


def _long_run(scene: Scene, scales: Scales) -> Values:
    if scene.period is None:
        raise LeftOut("the loads have no period")
    assert scene.time.periods is not None
    count = 10 * scene.time.periods
    return {f"{count} periods": (f"time.periods={count}", "time.steady_tolerance=0")}


def _pairs(scene: Scene, scales: Scales) -> Values:
    """The worst values of two axes together; a pair is left out if the scene lacks an axis."""

    def coarse() -> Overrides:
        return _steps(scene, scales)["10 a period" if scene.period else "10 times as long"]

    def stiff() -> Overrides:
        return contact_stiffness(scene, scales, 1e3, 1e3)

    undamped = ("material.mass_damping=0",)
    wanted: dict[str, Callable[[], Overrides]] = {
        "long steps, stiff contact": lambda: coarse() + stiff(),
        "long steps, 3 times the load": lambda: coarse() + loads_times(scene, 3.0),
        "friction 10, stiff contact": lambda: (
            contacts_with(scene, friction=len(scene.contacts) * [10.0]) + stiff()
        ),
        "10 times the load, stiff contact": lambda: loads_times(scene, 10.0) + stiff(),
        "undamped, stiff contact": lambda: undamped + stiff(),
        "undamped, 10 times the load": lambda: undamped + loads_times(scene, 10.0),
        "largest preload, 10 times the load": lambda: (
            preload(scene, scales, 2.0 if scales.preload else 10.0) + loads_times(scene, 10.0)
        ),
        "20 modes, stiff contact": lambda: ("basis.modes=20", *stiff()),
    }
    found: Values = {}
    for name, make in wanted.items():
        try:
            found[name] = make()
        except LeftOut:
            continue
    if not found:
        raise LeftOut("the scene has no contact and no varying load")
    return found


AXES: dict[str, Callable[[Scene, Scales], Values]] = {
    "scene": _scene,
    "contact stiffness": _contact_stiffness,
    "normal and tangential stiffness": _stiffness_apart,
    "friction": _friction,
    "preload": _preload,
    "gap": _gap,
    "approach": _approach,
    "load": _load,
    "static load": _static_load,
    "frequency": _frequency,
    "damping": _damping,
    "steps": _steps,
    "tolerance": _tolerance,
    "scheme": _scheme,
    "Poisson's ratio": _poisson,
    "modes": _modes,
    "derivatives": _derivatives,
    "speed": _speed,
    "long run": _long_run,
    "worst pairs": _pairs,
}
# axes on which the basis may become too small for the motion
RICHER = ("load", "preload", "modes", "derivatives")

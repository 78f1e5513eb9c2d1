"""Integrate a model as its scene says."""

from dataclasses import MISSING
from typing import Any

import numpy as np

from fenicsrom.arrays import Array
from fenicsrom.errors import ErrorKind, refuse
from fenicsrom.online.contact.points import ContactPoints
from fenicsrom.online.contact.surfaces import Contacts, history_of
from fenicsrom.online.model.loads import LoadHistories, histories_of
from fenicsrom.online.model.model import Problem
from fenicsrom.online.motion.motion import Motion
from fenicsrom.online.run.march import end_of, integrate
from fenicsrom.scene import Scene
from fenicsrom.scene.base.rules import Where
from fenicsrom.scene.checks.contact_checks import require_repeating

TOUCH = 1e-9
"""Smaller distances of a round surface, relative to its radius, are rounding errors."""


def load_histories(scene: Scene) -> LoadHistories:
    """The time factors of a scene's loads."""
    return histories_of(scene.loads, history_of(scene.rotation))


def simulate(
    model: Any, scene: Scene, *, start: Motion | tuple[Array, ...] | None = None, **options: Any
) -> Motion:
    """Integrate a model (stored, reduced, full or beam) under a scene.

    A stored model runs under the loads, damping, contacts and time integration of the scene, as
    `online.store.archive.StoredModel.simulate` does. Any other model must have the loads, the
    damping and the number of contacts of the scene; the parameters of the contacts and the table
    [time] are those of the scene.

    Args:
        model: the model.
        scene: the scene.
        start: a motion whose end is the state at t = 0, or this state as displacement and velocity
            (n,) and sliders (P, d); by default the run starts at rest in the equilibrium.
        options: `near`, `resume`, `keep_coordinates`, `progress`, `checkpoint` and `look` of
            `fenicsrom.online.run.march.integrate`.

    Raises:
        SceneError: the model does not belong to the scene; all loads are static, and there is no
            duration; or a round surface of a given radius has a preload and a distance from the
            undeformed body.
        ConvergenceError: the smallest step did not converge.
        AccuracyError: the energy balance is off.

    Example:
        `look` sees each step of the march, of a full model too:

        >>> import fenicsrom as fr
        >>> stored = fr.load_model("out/beam.npz").with_overrides("time.steady='march'")
        >>> seen = []
        >>> motion = fr.simulate(stored, stored.scene, look=seen.append)
        >>> len(seen) == motion.steps and bool(seen[-1].time == motion.time[-1])
        True
        >>> seen[-1].coordinates.shape, seen[-1].displacement.shape
        ((9,), (1, 2))
    """
    if hasattr(model, "with_scene"):  # a stored model holds no loads and no damping of its own
        model = model.with_scene(scene).model
    start = end_of(start) if isinstance(start, Motion) else start
    return integrate(checked_problem(model, scene), start=start, **options)


def checked_problem(model: Any, scene: Scene) -> Problem:
    """The problem of a model that can move under a scene.

    Raises:
        SceneError: as `simulate`.
    """
    _require_fit(model, scene)
    if scene.static_only:
        where = Where(scene.source, "time.duration")
        raise where.refuse(MISSING, "all loads are static, so nothing moves")
    if scene.time.steady_tolerance:
        require_repeating(scene)
    problem = Problem.of(model, scene)
    _require_touch(problem.contacts, model.points, scene)
    return problem


def _require_fit(model: Any, scene: Scene) -> None:
    """Check that a model has the loads, the damping and the number of contacts of a scene.

    Raises:
        SceneError: the model has other loads, damping or contacts; the error names the first key
            that differs.
    """
    pairs = zip(model.load_histories, load_histories(scene), strict=True)
    agreements = {
        "loads": all(np.array_equal(mine, wanted) for mine, wanted in pairs),
        "material.mass_damping": model.damping == scene.material.mass_damping,
        "contacts": np.array_equal(np.unique(model.points.contact), np.arange(len(scene.contacts))),
    }
    for key, agrees in agreements.items():
        if not agrees:
            reason = "not that of the model; build the model from this scene, or run a StoredModel"
            raise refuse(scene.source, reason, ErrorKind.MISMATCH, key)


def _require_touch(contacts: Contacts, points: ContactPoints, scene: Scene) -> None:
    """Check that round surfaces with a preload touch the undeformed body.

    A preload is the force at the undeformed position. Keys that give a gap are checked with the
    scene; the distance from a surface of a given radius is known only with the mesh.

    Raises:
        SceneError: a surface with a preload does not touch; the error names its radius.
    """
    for k, contact in enumerate(scene.contacts):
        if contact.surface is None or not contact.preload:
            continue
        gaps = []
        for p in np.flatnonzero(points.contact == k):
            across = contacts.axes[p, : contacts.kind[p]] @ contacts.centre[p]
            gaps.append(contacts.side[p] * (contacts.radius[p] - float(np.linalg.norm(across))))
        if min(gaps) > TOUCH * contacts.radius[points.contact == k][0]:
            reason = (
                "not allowed with a preload, which is the force at the undeformed position: the "
                f"surface is {min(gaps):.3g} m from the nearest contact point"
            )
            where = Where(scene.source, f"contacts[{k}].surface.radius")
            raise where.refuse(contact.surface.radius, reason, ErrorKind.CONFLICT)

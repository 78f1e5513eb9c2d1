"""Integrate a model as its scene says."""

from __future__ import annotations

from typing import Any

from fenicsrom.arrays import Array
from fenicsrom.online.contact_points import contacts_of
from fenicsrom.online.load_histories import LoadHistories, of_loads
from fenicsrom.online.march import end_of, integrate
from fenicsrom.online.motion import Motion
from fenicsrom.scene import Scene


def load_histories(scene: Scene) -> LoadHistories:
    """The time factors of a scene's loads."""
    return of_loads(scene.loads)


def simulate(
    model: Any,
    scene: Scene,
    *,
    start: Motion | tuple[Array, ...] | None = None,
    **options: Any,
) -> Motion:
    """Integrate a model (reduced, full or beam) under its scene.

    The contacts and the [time] table are those of the scene. The load histories and the damping are
    those of the model: to change them, use `fenicsrom.online.archive.StoredModel.simulate`, which
    first puts the load histories and the damping of the scene into the model.

    Args:
        model: the model.
        scene: the scene the model belongs to.
        start: a motion whose end is the state at t = 0, or this state as displacement and velocity
            (n,) and sliders (P, d); by default the run starts at rest in the equilibrium.
        options: `resume`, `keep_coordinates`, `progress` and `checkpoint` of
            `fenicsrom.online.march.integrate`.

    Raises:
        ConvergenceError: the smallest step did not converge.
        AccuracyError: the energy balance is off.
    """
    return integrate(
        model,
        contacts_of(scene, model.points),
        scene.time,
        scene.period,
        dimension=scene.geometry.dimension,
        start=end_of(start) if isinstance(start, Motion) else start,
        **options,
    )

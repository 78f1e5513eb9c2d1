"""Integrate a model as its scene says."""

from __future__ import annotations

from typing import Any

import numpy as np

from fenicsrom.arrays import Array
from fenicsrom.errors import ErrorKind, SceneError
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
    """Integrate a model (stored, reduced, full or beam) under a scene.

    A stored model runs under the loads, damping, contacts and time integration of the scene, as
    `fenicsrom.online.archive.StoredModel.simulate` does. Any other model must have the loads, the
    damping and the number of contacts of the scene; the parameters of the contacts and the table
    [time] are those of the scene.

    Args:
        model: the model.
        scene: the scene.
        start: a motion whose end is the state at t = 0, or this state as displacement and velocity
            (n,) and sliders (P, d); by default the run starts at rest in the equilibrium.
        options: `resume`, `keep_coordinates`, `progress` and `checkpoint` of
            `fenicsrom.online.march.integrate`.

    Raises:
        SceneError: the model does not belong to the scene.
        ConvergenceError: the smallest step did not converge.
        AccuracyError: the energy balance is off.
    """
    from fenicsrom.online.archive import StoredModel

    if isinstance(model, StoredModel):
        model = model.with_scene(scene).model
    _require_fit(model, scene)
    return integrate(
        model,
        contacts_of(scene, model.points),
        scene.time,
        scene.period,
        dimension=scene.geometry.dimension,
        start=end_of(start) if isinstance(start, Motion) else start,
        **options,
    )


def _require_fit(model: Any, scene: Scene) -> None:
    """Check that a model has the loads, the damping and the number of contacts of a scene.

    Raises:
        SceneError: it has others; the error names the first key that differs.
    """
    pairs = zip(model.load_histories, load_histories(scene), strict=True)
    agreements = {
        "loads": all(np.array_equal(mine, wanted) for mine, wanted in pairs),
        "material.mass_damping": model.damping == scene.material.mass_damping,
        "contacts": np.array_equal(np.unique(model.points.contact), np.arange(len(scene.contacts))),
    }
    for key, agrees in agreements.items():
        if not agrees:
            raise SceneError(
                f"{scene.source}: {key} of the scene and of the model differ; build the model from "
                "this scene, or run a StoredModel",
                kind=ErrorKind.MISMATCH,
                key=key,
                source=scene.source,
            )

"""The model for a range of speeds of rotation, made from the solid at some of these speeds."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

from fenicsrom.errors import AccuracyError, ConvergenceError, ErrorKind, SceneError, refuse
from fenicsrom.notes import packed
from fenicsrom.progress import log
from fenicsrom.study.building import trained

if TYPE_CHECKING:
    from fenicsrom.arrays import Array
    from fenicsrom.fem.mesh.mesh import Mesh
    from fenicsrom.fem.solid.solid import Solid
    from fenicsrom.online.step.speed_range import RangeModel
    from fenicsrom.online.store.archive import StoredModel
    from fenicsrom.scene import Basis, Scene


def build_range(scene: Scene, mesh: Mesh | None, comm: Any) -> StoredModel:
    """The model for the range of `rotation.speeds_rpm`, at `rotation.speed_rpm`, on one rank.

    Args:
        scene: a scene with `rotation.speeds_rpm`.
        mesh: the mesh; None makes or reads the mesh of the scene.
        comm: MPI communicator.

    Raises:
        SceneError: the scene cannot be used.
        ConvergenceError, AccuracyError: no equilibrium at a speed, or an inaccurate mode.
    """
    import numpy as np

    from fenicsrom.fem.mesh.mesh import build_mesh
    from fenicsrom.fem.solid.solid import solid_of
    from fenicsrom.online.run.simulate import load_histories
    from fenicsrom.online.store.archive import StoredModel
    from fenicsrom.online.store.store import provenance
    from fenicsrom.reduction.joined import range_model
    from fenicsrom.scene.keys.excitation import highest_frequency

    speeds = scene.speeds_rpm
    assert speeds is not None
    if comm.size > 1:
        reason = f"the model is built on one rank, not on {comm.size}"
        raise refuse(scene.source, reason, ErrorKind.CONFLICT, "rotation.speeds_rpm")
    log.info("mesh ..")
    mesh = mesh or build_mesh(scene.geometry, comm)
    log.info("solid ..")
    middle = replace(scene.at_speed(speeds[len(speeds) // 2]), loads=scene.loads)
    solid = solid_of(middle, mesh)
    solid.excitation = highest_frequency(scene.at_speed(speeds[-1]))
    assert scene.rotation is not None
    omegas, nominal = np.pi / 30.0 * np.array(speeds), scene.rotation.omega
    histories = load_histories(scene)

    def build(_: object = None) -> StoredModel:
        log.info("one model for all speeds ..")
        whole = range_model(solid, scene.basis, omegas, nominal).under(load_histories=histories)
        return StoredModel(
            model=whole.model,
            scene=scene,
            method="rubin",
            labels=(),
            dofs=solid.free,
            frequencies_hz=np.zeros(0),
            provenance=provenance(),
            whole=whole,
        ).at_speed()

    chosen = None
    if scene.basis.masters == "motion":
        start = [speed for _, speed in scene.rotation.history] or [scene.rotation.speed_rpm]
        solid.spin(np.pi / 30.0 * start[0])  # the rest of the motions
        chosen = trained(solid, scene, build)
    found = build()
    log.info("the same of finer elements ..")
    assert found.whole is not None
    options = replace(scene.basis, modes=found.whole.modes)
    finer, unjudged = _finer(middle, solid, options, omegas, nominal)
    solid.destroy()
    whole = replace(found.whole, finer=finer).under(load_histories=histories)
    notes = packed(dict.fromkeys(solid.warnings))
    return replace(found, unjudged=unjudged, whole=whole, trained=chosen, notes=notes)


def _finer(
    scene: Scene, solid: Solid, options: Basis, speeds: Array, nominal: float
) -> tuple[RangeModel | None, str]:
    """The range model of finer elements, or why there is none; arguments as `range_model`."""
    from fenicsrom.fem.solid.finer import FinerSolid, too_large
    from fenicsrom.reduction.joined import range_model

    if (reason := too_large(solid)) is not None:
        return None, reason
    try:
        finer = FinerSolid(scene, solid)
        found = range_model(finer, options, speeds, nominal)
    except (AccuracyError, ConvergenceError, SceneError) as error:
        return None, str(error)
    finer.destroy()
    return found, ""

"""Sweeps: a scene or a stored model under all combinations of values of its keys.

The runs whose scenes agree in all keys of the offline stage share one reduced model. The shared
model has the modes, derivatives and basis of the first of these runs.
"""

from __future__ import annotations

import time as clock
from collections.abc import Callable, Mapping, Sequence
from contextlib import nullcontext
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

from fenicsrom.errors import SceneError
from fenicsrom.progress import asking
from fenicsrom.scene import Scene, override_texts
from fenicsrom.scene.reading.overrides import Axis, combinations, make_axes
from fenicsrom.study.given import starts_from
from fenicsrom.study.source import scene_of
from fenicsrom.study.writing import written

if TYPE_CHECKING:
    from fenicsrom.assess.jobs import Workers
    from fenicsrom.assess.studies.sweep_runs import Sweep, SweepRun
    from fenicsrom.online.store.archive import StoredModel
    from fenicsrom.online.store.disk import StoredDisk

MODELS, RUNS = "models", "runs"  # folders of the reduced models and of the results
Row = dict[str, Any]


@starts_from("StoredModel", "StoredDisk", sectors=True)
def sweep(
    given: Scene | StoredModel | StoredDisk,
    over: Mapping[str, Sequence[Any]],
    *,
    folder: Path | None = None,
    workers: Workers = 1,
) -> Sweep:
    """Run a scene or a stored model under all combinations of values of its keys.

    Args:
        given: the scene, or the stored model of all runs.
        over: the values of each key, such as `{"loads.0.force": [50.0, 100.0]}`.
        folder: folder of the output files; None keeps no files.
        workers: largest number of processes, or an executor.

    Returns:
        The sweep: its `rows` hold the values and the results of each run.

    Raises:
        SceneError: there is no key, or no run has a scene that can be used.
        OSError: a file cannot be written.
    """
    from fenicsrom.online.store.archive import save_model
    from fenicsrom.online.store.scene_changes import changed_scene
    from fenicsrom.post.base.origin import MODEL

    scene = scene_of(given)
    axes = make_axes(override_texts({key: list(values) for key, values in over.items()}))
    with TemporaryDirectory() if folder is None else nullcontext(folder) as place:
        stored = None
        if not isinstance(given, Scene):
            stored = Path(place) / MODEL
            save_model(stored, given)
        variant = partial(changed_scene, scene)
        found = run_sweep(scene, variant, axes, Path(place), stored=stored, workers=workers)
    if folder is None:
        found.files = []
    return found


def run_sweep(
    scene: Scene,
    variant: Callable[[Sequence[str]], Scene],
    varied: tuple[Axis, ...],
    folder: Path,
    *,
    stored: Path | None = None,
    comm: Any = None,
    workers: Workers = 1,
    resume: bool = False,
    fresh: bool = False,
) -> Sweep:
    """Run a scene or a stored model under all combinations of values, and write the files.

    Args:
        scene: the scene that the runs change.
        variant: makes the scene with overrides; raises SceneError if an override is wrong.
        varied: the keys and their values.
        folder: folder of the output files, of the reduced models and of the results.
        stored: file of the reduced model of all runs; by default the models are built.
        comm: MPI communicator; with two ranks or more, rank 0 gives out the runs to the others.
        workers: largest number of processes, or an executor.
        resume: keep the results that an earlier sweep left in the folder.
        fresh: compute all offline results, also those that the cache has.

    Returns:
        The sweep; on ranks above 0 without results and files.

    Raises:
        SceneError: no run has a scene that can be used.
        OSError: a file cannot be read or written.
    """
    from fenicsrom.assess.studies.batch import Batch
    from fenicsrom.assess.studies.sweep_runs import Sweep, compute, failure

    begin = clock.perf_counter()
    rows, scenes = _rows_and_scenes(variant, varied)
    runs, models = _assign_models(scenes, folder, stored)
    build = [(s, path, fresh) for path, s in models.items() if not (resume and path.exists())]
    if build and comm is not None and comm.size > 1:
        import fenicsrom.fem.base.linalg  # noqa: F401 (PETSc and SLEPc start on all ranks together)
    makers = Batch("model", workers=workers, comm=comm)
    made = makers.each(_build, build, lambda k, _: build[k][1].stem)
    failed = {build[k][1]: failure(error) for k, error in made.items() if error is not None}
    results = {run.number: failed[run.model] for run in runs if run.model in failed}
    pending = [run for run in runs if run.model not in failed and run.model.exists()]

    def say(k: int, result: Any) -> str:
        return f"run {pending[k].number + 1}"

    batch = Batch("run", folder / RUNS, {}, resume, workers, comm)
    digests = [run.digest for run in pending]
    with asking(lambda: True) if makers.interrupted else nullcontext():
        done = batch.each(compute, pending, say, digests)
    for k, result in done.items():
        results[pending[k].number] = failure(result) if isinstance(result, Exception) else result
    rows = [row | results.get(k, {}) for k, row in enumerate(rows)]
    found = Sweep(scene, varied, rows, len(models), batch.reused, interrupted=batch.interrupted)
    found.seconds = clock.perf_counter() - begin
    return written(found, folder, comm)


def _rows_and_scenes(
    variant: Callable[[Sequence[str]], Scene], axes: tuple[Axis, ...]
) -> tuple[list[Row], dict[int, Scene]]:
    """The row of each run with its values, and the scene of the run; a wrong scene ends the row.

    Raises:
        SceneError: all scenes are wrong.
    """
    from fenicsrom.assess.studies.sweep_runs import failure

    rows: list[Row] = []
    scenes: dict[int, Scene] = {}
    refused: SceneError | None = None
    for number, positions in enumerate(combinations(axes)):
        chosen = list(zip(axes, positions, strict=True))
        values = {
            key: value
            for axis, k in chosen
            for key, value in zip(axis.keys, axis.values[k], strict=True)
        }
        rows.append({"run": number + 1, **values})
        try:
            scenes[number] = variant([text for axis, k in chosen for text in axis.overrides(k)])
        except SceneError as error:
            refused = refused or error
            rows[-1] |= failure(error)
    if not scenes:
        assert refused is not None
        raise refused
    return rows, scenes


def _assign_models(
    scenes: dict[int, Scene], folder: Path, stored: Path | None
) -> tuple[list[SweepRun], dict[Path, Scene]]:
    """The runs with the files of their models, and the scenes of the models that must be built."""
    from fenicsrom.assess.studies.sweep_runs import SweepRun, digest_of, file_digest
    from fenicsrom.online.store.scene_changes import shares_model

    folder = folder.resolve()  # workers may run in other folders
    stored = None if stored is None else stored.resolve()
    models: dict[Path, Scene] = {}
    origins = {} if stored is None else {stored: file_digest(stored)}
    runs = []
    for number, scene in scenes.items():
        path = stored or next(
            (path for path, made in models.items() if shares_model(made, scene)), None
        )
        if path is None:
            files = scene.geometry.files
            inputs = [file_digest(one) if one.is_file() else str(one) for one in files]
            origin = digest_of(scene, " ".join(inputs))
            path = folder / MODELS / f"{origin[:16]}.npz"
            models[path], origins[path] = scene, origin
        runs.append(SweepRun(number, scene, path, digest_of(scene, origins[path])))
    return runs, models


def _build(job: tuple[Scene, Path, bool]) -> None:
    """Build the reduced model or the disk of a scene, and write it; errors as `build_model`."""
    from mpi4py import MPI

    from fenicsrom.online.store.archive import save_model
    from fenicsrom.study.execution import build_disk, build_model

    scene, path, fresh = job
    if scene.cyclic is not None:
        save_model(path, build_disk(scene, comm=MPI.COMM_SELF))
    else:
        save_model(path, build_model(scene, comm=MPI.COMM_SELF, fresh=fresh))

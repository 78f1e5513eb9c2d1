"""Response curves, damped nonlinear modes and interaction maps of a scene or of a stored model."""

from __future__ import annotations

import json
import math
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any, TypeVar, cast

from fenicsrom.notes import Note, NoteKind
from fenicsrom.progress import log
from fenicsrom.scene import Scene
from fenicsrom.study.execution import all_ranks, build_disk
from fenicsrom.study.given import starts_from
from fenicsrom.study.source import Source, scene_of, source_of
from fenicsrom.study.stopwatch import Stopwatch
from fenicsrom.study.writing import written
from fenicsrom.words import counted

if TYPE_CHECKING:
    from fenicsrom.assess.curves.backbone import Backbone
    from fenicsrom.assess.curves.results import CurveRecord, Response
    from fenicsrom.assess.jobs import Workers
    from fenicsrom.assess.studies.interaction import InteractionMap
    from fenicsrom.assess.studies.ringdown import Ringdown
    from fenicsrom.online.store.archive import StoredModel
    from fenicsrom.online.store.disk import StoredDisk
    from fenicsrom.online.store.scene_changes import Trained


STATE = "response_state"  # folder of what is kept of the curves
Record = TypeVar("Record", bound="CurveRecord")
LINES = "map_lines"  # folder of the speeds that are done
COORDINATES = "coordinates.json"  # file in this folder with the labels of the coordinates


@starts_from("StoredModel", "StoredDisk", sectors=True)
def response(
    given: Scene | StoredModel | StoredDisk,
    comm: Any = None,
    *,
    folder: Path | None = None,
    resume: Path | None = None,
    workers: Workers = 1,
    fresh: bool = False,
) -> Response:
    """Compute the response curves of a scene, whose reduced model is built first, or of a model.

    Args:
        given: a scene with a table [response], or a stored model or disk under such a scene.
        comm: MPI communicator of the offline stages; by default all ranks.
        folder: folder of the output files; None writes no files.
        resume: folder of the state of an earlier run, from which the curves continue.
        workers: largest number of processes that compute curves at the same time, or an executor,
            see `fenicsrom.assess.curves.response.response`; several ranks share the curves.
        fresh: compute all offline results, also those that the cache has.

    Raises:
        SceneError: the scene or the earlier state cannot be used.
        ConvergenceError, AccuracyError: an offline stage failed.
        KeyboardInterrupt: the work was asked to stop before the curves began.
        OSError: a file cannot be written.
    """
    from fenicsrom.assess.curves.response_problem import check_response, of_curves
    from fenicsrom.assess.curves.results import check_folder, response_table
    from fenicsrom.assess.errors.comparisons import of_model
    from fenicsrom.post.curves.response_report import write

    scene = scene_of(given)
    check_response(scene)
    if resume is not None:
        check_folder(resume)
    if scene.cyclic is not None:
        return _waves(given, comm, folder, resume, workers)
    given = cast("Scene | StoredModel", given)
    source = source_of(given, comm, folder, fresh)
    table = response_table(source.stored.scene)
    source = replace(source, stored=of_curves(source.stored))
    found, source = _curves(source, folder, resume, workers)
    ends = (table.low, table.high) if table.parameter == "rotation.speed_rpm" else ()
    found.mesh_check = of_model(source.stored, *ends)
    found.warnings[:0] = _first_warnings(source, found)
    _add_beyond(found, source.stored.trained)
    if found.table.full_values and source.study is None:
        text = (
            "response.full was left out: the full model needs the mesh, which a stored model does "
            "not have; run fenicsrom response SCENE."
        )
        found.warnings.append(Note(NoteKind.LEFT_OUT, text, "response.full"))
    elif found.table.full_values and not found.interrupted:
        from fenicsrom.assess.curves.checks import add_full_points

        assert source.study is not None and source.study.basis is not None
        vectors = source.study.basis.vectors
        with Stopwatch()("full model"):
            add_full_points(found, source.stored, source.study.solid, vectors)
    if folder is not None and found.curves:
        found.files = write(found, source.stored, folder, source.study)
    return found


def _waves(
    given: Any,
    comm: Any,
    folder: Path | None,
    resume: Path | None,
    workers: Workers,
) -> Response:
    """Compute the response curves of a disk, whose sectors move in a wave; see `response`."""
    import numpy as np

    from fenicsrom.assess.curves import response as curves
    from fenicsrom.assess.curves.trust import RicherModel
    from fenicsrom.assess.rotation.disk_run import reduction_notes
    from fenicsrom.online.store.archive import save_model
    from fenicsrom.post.base.origin import MODEL
    from fenicsrom.post.curves.response_report import write

    disk = build_disk(given, comm=comm) if isinstance(given, Scene) else given
    comm = (comm or all_ranks()) if isinstance(given, Scene) else None
    first = folder if comm is None or comm.rank == 0 else None
    if first is not None and disk is not given:
        save_model(first / MODEL, disk)
    larger = RicherModel(replace(disk, sector=disk.larger), np.zeros((0, 0)))
    with Stopwatch()("response curves"):
        found = curves.response(
            disk,
            state=None if first is None else first / STATE,
            resume=resume,
            workers=workers,
            comm=comm,
            richer=larger,
        )
    found.warnings[:0] = reduction_notes(disk)
    _add_beyond(found, disk.trained)
    if first is not None and found.curves:
        found.files = write(found, disk, first)
    return found


def _add_beyond(found: Response, trained: Trained | None) -> None:
    """Note what curves ask more of the interface vectors than the motions that chose them."""
    from fenicsrom.assess.curves.response_problem import scenes_of_curves
    from fenicsrom.reduction.training import beyond

    sizes = [math.hypot(*p.probe_amplitude) for c in found.curves for p in c.points]
    for each in scenes_of_curves(found.scene):
        outside = beyond(trained, each, max(sizes, default=0.0))
        found.warnings += [note for note in outside if note not in found.warnings]


def _first_warnings(source: Source, found: CurveRecord) -> list[Note]:
    """The warnings of the model and of its mesh, each once."""
    judged = found.mesh_check.warnings(found.scene)
    return list(dict.fromkeys([*source.warnings, *judged]))


def _curves(
    source: Source,
    folder: Path | None,
    resume: Path | None,
    workers: Workers,
) -> tuple[Response, Source]:
    """Compute response curves with the coordinates that they need; arguments as `response`."""
    from fenicsrom.assess.curves import response as curves
    from fenicsrom.assess.curves.checks import cost_in_words, larger_model, model_before_curves
    from fenicsrom.assess.curves.trust import richer_model
    from fenicsrom.assess.errors.sizing import can_grow, spare_coordinates
    from fenicsrom.post.base.tables import write_text

    spare = spare_coordinates(source.stored)
    state = None if folder is None or not source.first else folder / STATE
    if resume is not None and (resume / COORDINATES).exists():
        labels = json.loads((resume / COORDINATES).read_text(encoding="utf-8"))
        if {*labels} <= {*source.stored.labels, *source.stored.further}:
            source = source.with_model(source.stored.resized(labels), folder)
    elif source.stored.scene.basis.size is not None:
        source = _sized(source, folder)
    elif resume is None and can_grow(source.stored, spare):
        with Stopwatch()("size of the model"):
            larger = model_before_curves(source.stored, spare, workers, source.comm)
        source = source if larger is None else _with_more(source, larger, folder)

    def follow(stored: StoredModel, resume: Path | None) -> Response:
        """The curves of a model."""
        if state is not None:
            write_text(state / COORDINATES, json.dumps(stored.labels))
        with Stopwatch()("response curves"):
            return curves.response(
                stored,
                state=state,
                resume=resume,
                workers=workers,
                comm=source.comm,
                richer=richer_model(stored, spare),
            )

    found = follow(source.stored, resume)
    while not found.interrupted:
        larger = larger_model(found, source.stored, spare)
        if larger is None:
            break
        log.info(
            f"  the curves need more coordinates and are followed again, which takes "
            f"{cost_in_words(found, larger)}; the curves so far stay if you interrupt this"
        )
        first, source = source, _with_more(source, larger, folder)
        again = follow(larger, None)
        if again.interrupted or (again.unfinished and not found.unfinished):
            source = first.with_model(first.stored, folder)
            _keep(found, again, larger)
            break
        found = again
    return found, source


def _sized(source: Source, folder: Path | None, grow: bool = False) -> Source:
    """The source with as many coordinates of its model as `basis.size` gives.

    Without this number, it may grow to all coordinates but those that judge it.
    """
    from fenicsrom.assess.errors.sizing import can_grow, spare_coordinates, with_size

    stored, spare = source.stored, spare_coordinates(source.stored)
    if (size := stored.scene.basis.size) is not None:
        return source.with_model(with_size(stored, None, size), folder)
    if not grow or not can_grow(stored, spare):
        return source
    return source.with_model(stored.resized(stored.size + len(stored.further) - spare), folder)


def _judged(found: Record, source: Source) -> Record:
    """A record with the estimated errors of its mesh, after the warnings of its model."""
    from fenicsrom.assess.errors.comparisons import of_model

    found.mesh_check = of_model(source.stored)
    found.warnings[:0] = _first_warnings(source, found)
    return found


def _with_more(source: Source, larger: StoredModel, folder: Path | None) -> Source:
    """The source with a model of more coordinates."""
    log.info(f"  {counted(larger.size, 'coordinate')}: {' '.join(larger.labels)}")
    return source.with_model(larger, folder)


def _keep(found: Response, again: Response, larger: StoredModel) -> None:
    """Keep curves whose repetition with a larger model did not end well, and say why."""
    found.interrupted, found.unfinished = again.interrupted, again.unfinished
    reason = "was interrupted" if again.interrupted else f"failed: {again.unfinished}"
    text = (
        f"The curves are those of {counted(found.size, 'coordinate')}, which are too few for "
        f"basis.accuracy: their repetition with {larger.size} {reason}"
    )
    found.warnings.append(Note(NoteKind.ERROR, text, "basis.accuracy"))


@starts_from("StoredModel")
def backbone(
    given: Scene | StoredModel,
    comm: Any = None,
    *,
    folder: Path | None = None,
    fresh: bool = False,
) -> Backbone:
    """Compute the nonlinear mode of a scene, whose reduced model is built first, or of a model.

    Args:
        given: a scene with a table [backbone], or a stored model under such a scene.
        comm: MPI communicator of the offline stages; by default all ranks.
        folder: folder of the output files; None writes no files.
        fresh: compute all offline results, also those that the cache has.

    Returns:
        The mode. After an interrupt it ends where it was, and `interrupted` is set; if the curve or
        a peak was not found, `unfinished` holds the error.

    Raises:
        SceneError: the scene cannot be used.
        ConvergenceError, AccuracyError: an offline stage failed, or the model has no equilibrium.
        KeyboardInterrupt: the work was asked to stop before the curve began.
        OSError: a file cannot be written.
    """
    from fenicsrom.assess.curves import backbone as modes

    modes.check_backbone(scene_of(given))
    source = _sized(source_of(given, comm, folder, fresh), folder)
    with Stopwatch()("nonlinear mode"):
        found = modes.backbone(source.stored)
    if found.labels != source.stored.labels:
        source = source.with_model(source.stored.resized(found.labels), folder)
    return written(_judged(found, source), folder if found.points else None, source.comm)


@starts_from("StoredModel")
def ringdown(
    given: Scene | StoredModel,
    comm: Any = None,
    *,
    folder: Path | None = None,
    resume: bool = False,
    fresh: bool = False,
) -> Ringdown:
    """Let a body go from its loads, held statically, and measure its free decay by periods.

    Arguments, `interrupted` and errors as `backbone`; `resume` keeps the decays in the folder.
    """
    from fenicsrom.assess.studies import ringdown as decays

    decays.check_ringdown(scene_of(given))
    source = _sized(source_of(given, comm, folder, fresh), folder, grow=True)
    kept = None if folder is None or not source.first else folder / "ringdown_decays"
    found = decays.ringdown(source.stored, kept, resume=resume)
    return written(_judged(found, source), folder if found.periods else None, source.comm)


@starts_from("StoredModel")
def interaction_map(
    given: Scene | StoredModel,
    comm: Any = None,
    *,
    folder: Path | None = None,
    resume: bool = False,
    workers: Workers = 1,
    fresh: bool = False,
) -> InteractionMap:
    """Compute the interaction map of a body that rubs its casing, over the speed of rotation.

    Args:
        given: a scene with `rotation.speeds_rpm` and a table [map], or a stored model of such a
            scene.
        comm: MPI communicator; several ranks share the speeds of a stored model.
        folder: folder of the output files; None writes no files.
        resume: keep the speeds that an earlier map left in the folder.
        workers: largest number of processes, or an executor.
        fresh: compute all offline results, also those that the cache has.

    Returns:
        The map. After an interrupt it has the speeds that are done, and `interrupted` is set.

    Raises:
        SceneError: the scene cannot be used.
        ConvergenceError, AccuracyError: an offline stage failed.
        OSError: a file cannot be written.
    """
    from fenicsrom.assess.errors.comparisons import of_model
    from fenicsrom.assess.studies import interaction
    from fenicsrom.online.store.archive import save_model
    from fenicsrom.post.base.origin import MODEL
    from fenicsrom.post.reports import report
    from fenicsrom.post.studies.interaction_report import write_hdf5

    interaction.map_speeds(scene_of(given))
    with TemporaryDirectory() if folder is None else nullcontext(folder) as place:
        source = source_of(given, comm, folder, fresh)
        model = Path(place) / f"{'' if source.stored is not given else 'stored_'}{MODEL}"
        save_model(model, source.stored)
        found = interaction.interaction_map(
            source.stored.scene,
            model,
            Path(place) / LINES,
            resume=resume,
            workers=workers,
            comm=comm,
        )
        ends = found.speeds_rpm[[0, -1]] if found.lines else ()
        judged = of_model(source.stored, *ends).warnings(found.scene)
        found.warnings[:0] = [*source.warnings, *judged]
        if folder is not None and found.lines and (comm is None or comm.rank == 0):
            arrays = write_hdf5(found, folder / "map.h5")
            found.files = [*report(found).write(folder), *arrays]
    return found

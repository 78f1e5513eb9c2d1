"""The commands: each takes the parsed options and returns the exit code.

`fenicsrom.cli.starting.start` prepares a computation from a scene file, which runs under MPI. A
stored model runs without MPI. Every command prints its results by `print_results`.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from fenicsrom import study
from fenicsrom.cli.output import opened, require_lasting
from fenicsrom.cli.printing import print_results, progress
from fenicsrom.cli.ranks import is_ranked
from fenicsrom.cli.starting import (
    changed_model,
    end,
    given_keys,
    importing,
    ranks,
    require_scene,
    start,
)
from fenicsrom.cli.termination import is_terminated
from fenicsrom.errors import ErrorKind, SceneError
from fenicsrom.scene import Scene, json_schema, read_scene
from fenicsrom.scene.rules import counted

OWN_TABLES = ("compare", "campbell", "response", "backbone", "statics")
"""Commands with a table of their own in the scene, which has their name."""


def run(options: argparse.Namespace) -> int:
    """Run a scene or a stored model."""
    if options.stored:
        return _rerun(options)
    require_scene(options)
    comm, say, scene = start(options)
    from fenicsrom.post.base.directions import direction_names
    from fenicsrom.post.run import motion_table, sentences

    resume = Path(options.resume) if options.resume else None
    with opened(options, scene, comm) as folder:
        found = study.run(
            scene,
            comm,
            say,
            folder=folder,
            resume=resume,
            stop=is_terminated,
            fresh=options.fresh,
        )
        if comm.rank == 0:
            names = direction_names(scene, found.solid.points)
            table = motion_table.response_table(found.motions, found.sizes, names, scene)
            lines = sentences.study_sentences(found)
            print_results(scene, table, found.warnings, lines, found.files)
        return end(comm, found.unfinished[1] if found.unfinished else None)


def _rerun(options: argparse.Namespace) -> int:
    """Integrate a stored model again."""
    from dataclasses import replace

    with importing():
        from fenicsrom.online.store import archive, checkpoints
        from fenicsrom.post.base.directions import direction_names
        from fenicsrom.post.run import motion_table, sentences

    stored = archive.load_model(Path(options.stored))
    resume = Path(options.resume) if options.resume else None
    if resume is not None:  # the stopped run may have used another scene than the model
        stored = replace(stored, scene=checkpoints.load_scene(resume))
    current = changed_model(options, stored)
    with opened(options, current.scene) as folder:
        found = study.rerun(
            current,
            folder,
            resume=resume,
            say=progress,
            stop=is_terminated,
            given=given_keys(options),
        )
        sizes = {"reduced": stored.size}
        names = direction_names(current.scene, current.model.points)
        table = motion_table.response_table({"reduced": found.motion}, sizes, names, current.scene)
        lines = sentences.rerun_sentences(found)
        print_results(current.scene, table, found.warnings, lines, found.files)
        return end(None, found.unfinished)


def plan(options: argparse.Namespace) -> int:
    """List the stages of `run`, and the other commands that the scene has tables for.

    The parts of a stage are indented. The picture of the set-up is drawn if it is asked for.

    Raises:
        SceneError: the scene or the file of the picture cannot be used.
    """
    scene = read_scene(options.scene, options.overrides)
    print(f"fenicsrom run {options.scene}:")
    for item in study.plan(scene):
        name = item.name if isinstance(item, study.Stage) else f"  {item.name}"
        print(f"{'runs     ' if item.needed else 'left out '} {name:26} {item.reason}")
    for command in OWN_TABLES:
        if any(key.split(".")[0] == command for key in given_keys(options)):
            print(
                f"the table [{command}] is for another command: fenicsrom {command} {options.scene}"
            )
    if options.picture is not None:
        from fenicsrom.post.run.pictures import draw_pictures

        path = Path(options.picture)
        require_lasting(path, "--picture")
        if path.suffix.lower() != ".png":
            raise SceneError(
                f"--picture {path}: must end in .png",
                kind=ErrorKind.FORMAT,
                key="--picture",
                source=str(path),
            )
        picture, warnings = study.setup_picture(scene, path.name, progress)
        files = [path for _, path in draw_pictures([picture], path.parent, warnings)]
        print_results(None, "", warnings, files=files)
    return 0


def modes(options: argparse.Namespace) -> int:
    """Compute modes and modal derivatives."""
    comm, say, scene = start(options, unloaded=True)
    from fenicsrom.post.run import sentences

    with opened(options, scene, comm) as folder:
        found = study.run(scene, comm, say, folder=folder, modes_only=True, stop=is_terminated)
        if comm.rank == 0:
            print_results(None, "", found.warnings, sentences.mode_lines(found), found.files)
    return 0


def compare(options: argparse.Namespace) -> int:
    """Compare bases with the full model."""
    comm, say, scene = start(options)
    from fenicsrom.assess.studies import compare
    from fenicsrom.post.studies import compare_report

    with opened(options, scene, comm) as folder:
        found = compare.compare(scene, comm, say)
        if comm.rank == 0:
            files = compare_report.write_comparison(found, folder)
            print_results(scene, compare_report.terminal(found), found.warnings, files=files)
    return 0


def campbell(options: argparse.Namespace) -> int:
    """Compute a Campbell diagram."""
    comm, say, scene = start(options, unloaded=True)
    from fenicsrom.assess.rotation import campbell
    from fenicsrom.post.run.body_pictures import setup_pictures
    from fenicsrom.post.studies import campbell_report

    with opened(options, scene, comm) as folder:
        found = campbell.campbell(scene, comm, say)
        setup = setup_pictures(found.body, scene)
        if comm.rank == 0:
            files = campbell_report.write(found, folder, setup)
            print_results(scene, campbell_report.terminal(found), found.warnings, files=files)
        return end(comm, found.unfinished)


def response(options: argparse.Namespace) -> int:
    """Compute the response curves of a scene or of a stored model.

    Raises:
        KeyboardInterrupt: the computation was interrupted.
        ConvergenceError, AccuracyError: a curve was not found.
    """
    from fenicsrom.assess.processes import available_cores

    settings: dict[str, Any] = {
        "resume": Path(options.resume) if options.resume else None,
        "workers": available_cores(),
        "stop": is_terminated,
    }
    if options.stored:
        from fenicsrom.online.store import archive

        current = changed_model(options, archive.load_model(Path(options.stored)))
        with opened(options, current.scene) as folder:
            found = study.response_of_model(current, progress, folder=folder, **settings)
            return _end_of_curves(found, None)
    require_scene(options)
    comm, say, scene = start(options)
    with opened(options, scene, comm) as folder:
        found = study.response(scene, comm, say, folder=folder, fresh=options.fresh, **settings)
        return _end_of_curves(found, comm)


def _end_of_curves(found: Any, comm: Any) -> int:
    """Print the response curves, and end as their computation did."""
    if found.curves and (comm is None or comm.rank == 0):
        from fenicsrom.post.curves import response_tables

        table = response_tables.terminal(found)
        varied = response_tables.varied_keys(found)
        print_results(found.scene, table, found.warnings, files=found.files, varied=varied)
    if found.interrupted:
        raise KeyboardInterrupt
    return end(comm, found.unfinished)


def backbone(options: argparse.Namespace) -> int:
    """Compute a damped nonlinear mode of a scene or of a stored model.

    Raises:
        KeyboardInterrupt: the computation was interrupted.
        ConvergenceError: the mode or a peak was not found.
    """
    if options.stored:
        from fenicsrom.online.store import archive

        current = changed_model(options, archive.load_model(Path(options.stored)))
        with opened(options, current.scene) as folder:
            return _end_of_mode(study.backbone_of_model(current, progress), None, folder)
    require_scene(options)
    comm, say, scene = start(options)
    with opened(options, scene, comm) as folder:
        found = study.backbone(
            scene, comm, say, folder=folder, stop=is_terminated, fresh=options.fresh
        )
        return _end_of_mode(found, comm, folder)


def _end_of_mode(found: Any, comm: Any, folder: Path) -> int:
    """Write and print a nonlinear mode, and end as its computation did."""
    if found.points and (comm is None or comm.rank == 0):
        from fenicsrom.post.curves import backbone_report

        files = backbone_report.write(found, folder)
        print_results(found.scene, backbone_report.terminal(found), found.warnings, files=files)
    if found.interrupted:
        raise KeyboardInterrupt
    return end(comm, found.unfinished)


def statics(options: argparse.Namespace) -> int:
    """Follow the static equilibria of a scene over a load factor.

    Raises:
        KeyboardInterrupt: the computation was interrupted.
        ConvergenceError: the path was lost.
    """
    comm, say, scene = start(options)
    from fenicsrom.assess.curves.equilibrium_path import equilibrium_path, varied_loads

    varied_loads(scene)
    with opened(options, scene, comm) as folder:
        found = equilibrium_path(scene, comm, say, is_terminated)
        if found.points:
            from fenicsrom.post.curves import equilibrium_report
            from fenicsrom.post.run.body_pictures import setup_pictures

            shapes = equilibrium_report.write_shapes(found, folder)
            setup = setup_pictures(found.body, scene)
            if comm.rank == 0:
                files = [*equilibrium_report.write(found, folder, setup), *shapes]
                table = equilibrium_report.terminal(found)
                print_results(scene, table, found.warnings, files=files)
        if found.interrupted:
            raise KeyboardInterrupt
        return end(comm, found.unfinished)


def sweep(options: argparse.Namespace) -> int:
    """Run a scene or a stored model for lists or ranges of values of its keys.

    Returns:
        0, or 1 if a run has no motion.

    Raises:
        KeyboardInterrupt: the sweep was interrupted.
    """
    from fenicsrom.assess.processes import available_cores, start_server
    from fenicsrom.scene.variations import make_axes

    axes = make_axes(options.over, options.together)
    workers = available_cores()
    if workers > 1 and not is_ranked():  # it imports the program while MPI starts
        start_server()
    comm = ranks()
    with importing():
        from fenicsrom.assess.studies.sweep_runs import FAILED
        from fenicsrom.online.store import archive
        from fenicsrom.post.studies import sweep_report

    if options.stored:
        model = archive.load_model(Path(options.stored))
        scene = changed_model(options, model).scene
        source: str | None = options.stored
    else:
        require_scene(options)
        scene, source = read_scene(options.scene, options.overrides), None

    def variant(overrides: Sequence[str]) -> Scene:
        if options.scene is not None:
            return read_scene(options.scene, [*options.overrides, *overrides])
        return archive.changed_scene(model.scene, [*options.overrides, *overrides], model.file)

    first = comm is None or comm.rank == 0
    with opened(options, scene, comm) as folder:
        found = study.sweep(
            scene,
            variant,
            axes,
            folder,
            stored=Path(source) if source else None,
            comm=comm,
            say=progress if first else lambda line: None,
            workers=workers,
            resume=options.resume,
            stop=is_terminated,
            fresh=options.fresh,
        )
        if first:
            keys = sweep_report.swept_keys(found)
            print_results(scene, sweep_report.terminal(found), [], files=found.files, varied=keys)
        if found.interrupted:
            raise KeyboardInterrupt
    return 1 if found.with_outcome(FAILED) else 0


def stability(options: argparse.Namespace) -> int:
    """Run extreme or random variants of a scene.

    Raises:
        SceneError: axes and random variants are asked for together.
    """
    from fenicsrom.assess.studies import stability
    from fenicsrom.post.studies import stability_report

    if options.random and options.axis:
        raise SceneError(
            "--random and --axis: give one of them, because random variants are not on an axis",
            kind=ErrorKind.CONFLICT,
            key="--random",
        )
    with opened(options, read_scene(options.scene, options.overrides)) as folder:
        matrix = stability.stability(
            Path(options.scene),
            options.overrides,
            progress,
            options.axis,
            variants=options.random,
            seed=options.seed,
        )
        files = stability_report.write(matrix, folder)
        lines = [*stability_report.sentences(matrix), *matrix.left_out]
        print_results(None, "", [], lines, files)
    return 1 if matrix.count(stability.Verdict.WRONG) else 0


def cache(options: argparse.Namespace) -> int:
    """Show the cache of offline results, or empty it."""
    from fenicsrom.files import CACHE_OFF, CACHE_VARIABLE
    from fenicsrom.study import result_cache

    folder = result_cache.cache_folder()
    if folder is None:
        print(f"{CACHE_VARIABLE} = {CACHE_OFF}: offline results are not kept")
        return 0
    if options.clear:
        print(f"{counted(result_cache.clear(folder), 'file')} removed from {folder}")
        return 0
    found = result_cache.entries(folder)
    size = sum(entry.size for entry in found)
    print(
        f"{folder}: {counted(len(found), 'file')}, {size / 1e6:.1f} MB of at most "
        f"{result_cache.LIMIT / 1e6:.0f} MB; the oldest are removed first"
    )
    return 0


def schema(options: argparse.Namespace) -> int:
    """Print or write the JSON schema of scene files."""
    text = json.dumps(json_schema(), indent=2, ensure_ascii=False)
    if options.output is None:
        print(text)
        return 0
    from fenicsrom.files import atomic_write

    require_lasting(Path(options.output))
    with atomic_write(options.output) as temporary:
        temporary.write_text(text + "\n", encoding="utf-8")
    return 0

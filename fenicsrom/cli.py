"""The command line: run, plan, modes, compare, campbell, response, schema and stability.

Exit codes: 0 success, 1 numerical failure, 2 wrong input, 130 interrupted, 143 terminated.

Modules that need numpy, numba or dolfinx are imported by the command that uses them.
"""

from __future__ import annotations

import argparse
import json
import signal
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from fenicsrom import __version__
from fenicsrom.errors import AccuracyError, ConvergenceError, ErrorKind, SceneError
from fenicsrom.scene import Scene, json_schema, read_scene

REFUSED = 77  # MPI tag of the messages by which ranks tell each other about an error
PATIENCE = 10.0  # s that a rank waits for such a message before it assumes that the others continue


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a command and return its exit code."""
    options = _parser().parse_args(arguments)
    try:
        with _terminable():
            return int(options.command(options))
    except SceneError as error:
        return _refuse(str(error), 2)
    except (ConvergenceError, AccuracyError) as error:
        return _refuse(str(error), 1)
    except OSError as error:
        return _refuse(f"{error.filename or 'output'}: {error.strerror or error}", 1)
    except ModuleNotFoundError as error:
        return _refuse(
            f"this command needs the Python module {error.name}, which is not installed; "
            "a stored model runs without dolfinx: fenicsrom run --from reduced_model.npz",
            1,
        )
    except KeyboardInterrupt:
        if _is_terminated():
            return _stopped("terminated", 143)
        return _stopped("interrupted", 130)


_termination = {"requested": False}


def _is_terminated() -> bool:
    """Tell whether SIGTERM arrived; the run asks between stages and after each period."""
    return _termination["requested"]


@contextmanager
def _terminable() -> Iterator[None]:
    """Note SIGTERM for `_is_terminated`, if this is the main thread.

    The handler does not raise: numba drops exceptions that are raised while it compiles. A second
    SIGTERM ends the process at once; files are complete at any moment.
    """

    def note(number: int, frame: object) -> None:
        _termination["requested"] = True
        signal.signal(signal.SIGTERM, signal.SIG_DFL)

    _termination["requested"] = False
    try:
        before = signal.signal(signal.SIGTERM, note)
    except ValueError:  # not the main thread
        yield
        return
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)


def _refuse(sentence: str, code: int) -> int:
    """Print an error once: a rank is silent if a lower rank prints the same sentence.

    Ranks without an error would wait for this one forever, so they are aborted.
    """
    comm = _ranks()
    if comm is None:
        return _say(sentence, code)
    sent = [comm.isend(sentence, rank, REFUSED) for rank in range(comm.size) if rank != comm.rank]
    last = time.monotonic() + PATIENCE
    heard = _heard(comm, range(comm.rank), last)
    if sentence not in heard:
        _say(sentence, code)
    if None in heard + _heard(comm, range(comm.rank + 1, comm.size), last):
        time.sleep(1.0)  # mpirun forwards no output after the abort
        comm.Abort(code)
    for request in sent:
        request.wait()
    return code


def _heard(comm: Any, ranks: Sequence[int], last: float) -> list[str | None]:
    """Receive the errors of these ranks; None for a rank that is silent until the last moment.

    Args:
        comm: the communicator.
        ranks: the ranks to listen to.
        last: the last moment, on the monotonic clock, s.
    """
    found = []
    for rank in ranks:
        while not (there := comm.iprobe(rank, REFUSED)) and time.monotonic() < last:
            time.sleep(0.01)
        found.append(comm.recv(source=rank, tag=REFUSED) if there else None)
    return found


def _stopped(word: str, code: int) -> int:
    """Say on the first rank that the run was stopped; return the exit code."""
    comm = _ranks()
    return _say(word, code) if comm is None or comm.rank == 0 else code


def _say(sentence: str, code: int) -> int:
    """Print a sentence to stderr; return the exit code."""
    print(f"fenicsrom: {sentence}", file=sys.stderr, flush=True)
    return code


def _ranks() -> Any:
    """Give the communicator of all ranks; None if MPI is not in use or has one rank."""
    mpi = sys.modules.get("mpi4py.MPI")
    return mpi.COMM_WORLD if mpi and mpi.COMM_WORLD.size > 1 else None


def _parser() -> argparse.ArgumentParser:
    """Make the parser of the command line."""
    parser = argparse.ArgumentParser(
        prog="fenicsrom",
        description="Reduced-order models of geometrically nonlinear structures with friction.",
    )
    parser.add_argument("--version", action="version", version=f"fenicsrom {__version__}")
    commands = parser.add_subparsers(required=True, metavar="COMMAND")

    run = commands.add_parser("run", help="run a scene, or integrate a stored reduced model again")
    run.add_argument("scene", nargs="?", help="scene file (TOML)")
    run.add_argument(
        "--from",
        dest="stored",
        metavar="MODEL",
        help="integrate the reduced_model.npz of an earlier run, without a mesh and dolfinx",
    )
    run.add_argument(
        "--resume",
        metavar="CHECKPOINT",
        help="continue the reduced model from the checkpoint.npz of an earlier run",
    )
    run.set_defaults(command=_run)

    plan = commands.add_parser(
        "plan", help="list the stages of a scene: which ones run, which ones are left out, and why"
    )
    plan.add_argument("scene", help="scene file (TOML)")
    plan.set_defaults(command=_plan)

    modes = commands.add_parser(
        "modes", help="compute only the modes and modal derivatives, for ParaView"
    )
    modes.add_argument("scene", help="scene file (TOML)")
    modes.set_defaults(command=_modes)

    compare = commands.add_parser(
        "compare", help="compare reduced bases with the full model: error and run time"
    )
    compare.add_argument("scene", help="scene file (TOML); its [compare] table lists the bases")
    compare.set_defaults(command=_compare)

    campbell = commands.add_parser(
        "campbell", help="compute a Campbell diagram: frequencies and critical speeds"
    )
    campbell.add_argument(
        "scene",
        help="scene file (TOML) with a [rotation] table; its [campbell] table gives the speeds",
    )
    campbell.set_defaults(command=_campbell)

    response = commands.add_parser(
        "response", help="follow periodic motions over a parameter: response curves and stability"
    )
    response.add_argument(
        "scene",
        nargs="?",
        help="scene file (TOML); its [response] table gives the parameter and its range",
    )
    response.add_argument(
        "--from",
        dest="stored",
        metavar="MODEL",
        help="take the reduced_model.npz of an earlier run, without a mesh and dolfinx",
    )
    response.set_defaults(command=_response)

    schema = commands.add_parser("schema", help="print the JSON schema of scene files, for editors")
    schema.add_argument("--output", metavar="FILE", help="write it to this file")
    schema.set_defaults(command=_schema)

    stability = commands.add_parser(
        "stability", help="run extreme variants of a scene, with a verdict on each"
    )
    stability.add_argument("scene", help="scene file (TOML)")
    stability.add_argument(
        "--axis",
        action="append",
        default=[],
        metavar="NAME",
        help="run this axis only, such as friction; may be repeated",
    )
    stability.set_defaults(command=_stability)

    for command in (run, plan, modes, compare, campbell, response, stability):
        command.add_argument(
            "--set",
            action="append",
            default=[],
            metavar="KEY=VALUE",
            dest="overrides",
            help="change a value of the scene, such as loads.0.force=200; put text in quotes; "
            "may be repeated",
        )
    for command in (run, modes, compare, campbell, response, stability):
        command.add_argument(
            "--output", metavar="DIR", help="output folder (default: out/NAME of the scene)"
        )
    return parser


def _folder(options: argparse.Namespace, source: str) -> Path:
    """Choose the output folder."""
    return Path(options.output) if options.output else Path("out") / Path(source).stem


def _run(options: argparse.Namespace) -> int:
    """Run a scene or a stored model."""
    if options.stored:
        return _rerun(options)
    if options.scene is None:
        if options.resume:
            sentence = "--resume also needs the scene file or --from MODEL"
        else:
            sentence = "run: give a scene file or --from MODEL"
        raise SceneError(sentence, kind=ErrorKind.MISSING, key="scene")
    comm, say, scene, folder = _start(options)
    from fenicsrom import study
    from fenicsrom.post import sentences

    found = study.run(
        scene,
        comm,
        say,
        folder=folder,
        resume=Path(options.resume) if options.resume else None,
        stop=_is_terminated,
    )
    if comm.rank == 0:
        table = sentences.response_table(found.motions, found.sizes)
        _results(scene, table, found.warnings, sentences.study_sentences(found))
        _files(found.files)
    if found.unfinished:
        comm.barrier()  # wait until the first rank has written its files
        raise found.unfinished[1]
    return 0


def _rerun(options: argparse.Namespace) -> int:
    """Integrate a stored model again."""
    from dataclasses import replace

    from fenicsrom import study
    from fenicsrom.online import archive, checkpoints
    from fenicsrom.post import sentences

    stored = archive.load_model(Path(options.stored))
    resume = Path(options.resume) if options.resume else None
    if resume is not None:  # the stopped run may have used another scene than the model
        stored = replace(stored, scene=checkpoints.load_scene(resume))
    current = _stored_model(options, stored)
    model, scene = current.model, current.scene
    folder = _folder(options, options.scene or options.stored)
    folder.mkdir(parents=True, exist_ok=True)
    found = study.rerun(
        stored,
        model,
        scene,
        folder,
        resume=resume,
        say=_progress,
        stop=_is_terminated,
    )
    table = sentences.response_table({"reduced": found.motion}, {"reduced": stored.size})
    told = sentences.resumed_sentence(found.motion), sentences.periodic_sentence(found.motion)
    _results(scene, table, found.warnings, [sentence for sentence in told if sentence])
    _files(found.files)
    if found.unfinished:
        raise found.unfinished
    return 0


def _modes(options: argparse.Namespace) -> int:
    """Compute modes and modal derivatives."""
    comm, say, scene, folder = _start(options)
    from fenicsrom import study
    from fenicsrom.post import sentences

    found = study.run(scene, comm, say, folder=folder, modes_only=True, stop=_is_terminated)
    if comm.rank == 0:
        _results(None, "", found.warnings, sentences.mode_lines(found))
        _files(found.files)
    return 0


def _compare(options: argparse.Namespace) -> int:
    """Compare bases with the full model."""
    comm, say, scene, folder = _start(options)
    from fenicsrom.assess import compare
    from fenicsrom.post import compare_report

    found = compare.compare(scene, comm, say)
    if comm.rank == 0:
        files = compare_report.write_comparison(found, folder)
        _results(scene, compare_report.terminal(found), found.warnings)
        _files(files)
    return 0


def _schema(options: argparse.Namespace) -> int:
    text = json.dumps(json_schema(), indent=2, ensure_ascii=False)
    if options.output is None:
        print(text)
        return 0
    from fenicsrom.files import atomic_write

    with atomic_write(options.output) as temporary:
        temporary.write_text(text + "\n", encoding="utf-8")
    return 0


def _campbell(options: argparse.Namespace) -> int:
    """Compute a Campbell diagram."""
    comm, say, scene, folder = _start(options)
    from fenicsrom.assess import campbell
    from fenicsrom.post import campbell_report

    found = campbell.campbell(scene, comm, say)
    if comm.rank == 0:
        files = campbell_report.write(found, folder)
        _results(scene, campbell_report.terminal(found), found.warnings)
        _files(files)
    if found.unfinished:
        comm.barrier()
        raise found.unfinished
    return 0


def _response(options: argparse.Namespace) -> int:
    """Compute the response curves of a scene or of a stored model."""
    if options.stored:
        return _stored_response(options)
    if options.scene is None:
        sentence = "fenicsrom response: give a scene file or --from MODEL"
        raise SceneError(sentence, kind=ErrorKind.MISSING, key="scene")
    comm, say, scene, folder = _start(options)
    from fenicsrom import study

    found = study.response(scene, comm, say, folder=folder, stop=_is_terminated)
    return _end_response(found, folder, comm.rank == 0)


def _stored_response(options: argparse.Namespace) -> int:
    """Compute the response curves of a stored model."""
    from fenicsrom import study
    from fenicsrom.online import archive

    current = _stored_model(options, archive.load_model(Path(options.stored)))
    folder = _folder(options, options.scene or options.stored)
    folder.mkdir(parents=True, exist_ok=True)
    return _end_response(study.response_of_model(current, _progress), folder, True)


def _stored_model(options: argparse.Namespace, stored: Any) -> Any:
    """Give a stored model under the scene file, or under its own scene with the overrides."""
    if options.scene is not None:
        return stored.with_scene(read_scene(options.scene, options.overrides))
    return stored.with_overrides(options.overrides)


def _end_response(found: Any, folder: Path, first_rank: bool) -> int:
    """Write and print response curves as far as they were found; give the exit code.

    Raises:
        KeyboardInterrupt: the computation was interrupted.
        ConvergenceError, AccuracyError: a curve was not found.
    """
    from fenicsrom.post import response_report

    if found.curves and first_rank:
        files = response_report.write(found, folder)
        _results(found.scene, response_report.terminal(found), found.warnings)
        _files(files)
    if found.interrupted:
        raise KeyboardInterrupt
    if found.unfinished:
        raise found.unfinished
    return 0


def _stability(options: argparse.Namespace) -> int:
    """Run extreme variants of a scene."""
    folder = Path(options.output) if options.output else Path("out") / "stability"
    folder.mkdir(parents=True, exist_ok=True)
    from fenicsrom.assess import stability
    from fenicsrom.post import stability_report

    matrix = stability.stability(Path(options.scene), options.overrides, _progress, options.axis)
    files = stability_report.write(matrix, folder)
    print()
    print("\n".join([*stability_report.sentences(matrix), *matrix.left_out]))
    _files(files)
    return 1 if matrix.count(stability.Verdict.WRONG) else 0


def _plan(options: argparse.Namespace) -> int:
    """List the stages of a scene; the parts of a stage are indented."""
    from fenicsrom.study import Stage, plan

    for item in plan(read_scene(options.scene, options.overrides)):
        name = item.name if isinstance(item, Stage) else f"  {item.name}"
        print(f"{'runs     ' if item.needed else 'left out '} {name:26} {item.reason}")
    return 0


def _start(options: argparse.Namespace) -> tuple[Any, Any, Scene, Path]:
    """Give the communicator, the progress callback, the scene and the output folder.

    MPI starts first, so that only one rank prints an error in the scene. The folder is made before
    the computation, so that a run is not lost because its folder cannot be made.
    """
    from mpi4py import MPI

    comm = MPI.COMM_WORLD
    scene = read_scene(options.scene, options.overrides)
    folder = _folder(options, options.scene)
    if comm.rank == 0:
        folder.mkdir(parents=True, exist_ok=True)

    def say(line: str) -> None:
        if comm.rank == 0:
            _progress(line)

    return comm, say, scene, folder


def _progress(line: str) -> None:
    """Print a line of progress to stderr; stop a serial run if SIGTERM arrived."""
    if _is_terminated() and _ranks() is None:
        raise KeyboardInterrupt
    print(line, file=sys.stderr, flush=True)


def _results(
    scene: Scene | None, table: str, warnings: Sequence[str], sentences: Sequence[str] = ()
) -> None:
    """Print the title of the scene, a table, the warnings and the sentences on the results."""
    print()
    if scene is not None and scene.title:
        print(scene.title)
    if table:
        print(table)
    for warning in warnings:
        print(f"warning: {warning}")
    for sentence in sentences:
        print(sentence)


def _files(files: Sequence[Path]) -> None:
    """List the written files."""
    print("files:")
    for path in files:
        print(f"  {path}")

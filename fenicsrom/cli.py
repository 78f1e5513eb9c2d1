"""The commands: run, plan, modes, compare, campbell and stability.

Exit codes: 0 done, 1 a numerical failure, 2 wrong input, 130 interrupted, 143 terminated.
"""

from __future__ import annotations

import argparse
import signal
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from fenicsrom.errors import AccuracyError, ConvergenceError, SceneError
from fenicsrom.scene import Scene, read_scene

REFUSED = 77  # tag of the messages in which ranks tell each other what is wrong
PATIENCE = 10.0  # s that a rank waits for such a message, before it takes it that the others go on


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
        needed = "a stored model needs no dolfinx: fenicsrom run --from reduced_model.npz"
        return _refuse(
            f"this command needs the Python module {error.name}, which is not installed ({needed})",
            1,
        )
    except Terminated:
        return _stopped("terminated", 143)
    except KeyboardInterrupt:
        return _stopped("interrupted", 130)


class Terminated(BaseException):
    """SIGTERM arrived: files half written are taken away on the way out."""


@contextmanager
def _terminable() -> Iterator[None]:
    """Turn SIGTERM into `Terminated`, where signals are this thread's to handle.

    A callback of the compiler swallows what is raised in it, with a word on stderr, and may fail
    for it later: it is raised again every half second until it comes through, what it says of it is
    kept back, and any failure after it is its.
    """
    asked = False

    def stop(number: int, frame: object) -> None:
        nonlocal asked
        asked = True
        signal.setitimer(signal.ITIMER_REAL, 0.5)
        raise Terminated

    def swallowed(found: Any) -> None:
        if not asked:
            hook(found)

    try:
        before = signal.signal(signal.SIGTERM, stop)
    except ValueError:  # not the main thread
        yield
        return
    alarm, hook = signal.signal(signal.SIGALRM, stop), sys.unraisablehook
    sys.unraisablehook = swallowed
    try:
        yield
    except Exception:
        if asked:
            raise Terminated from None
        raise
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        if not asked:  # what the compiler still takes down fails of it too
            sys.unraisablehook = hook
        signal.signal(signal.SIGALRM, alarm)
        signal.signal(signal.SIGTERM, before)


def _refuse(sentence: str, code: int) -> int:
    """Say what is wrong, once: unless a rank before this one says the same. Ranks that go on, and
    would wait, are stopped.
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
        time.sleep(1.0)  # mpirun passes on what is said, but not once it stops the ranks
        comm.Abort(code)
    for request in sent:
        request.wait()
    return code


def _heard(comm: Any, ranks: Sequence[int], last: float) -> list[str | None]:
    """What these ranks say to be wrong; None for each that has said nothing by this time of the
    monotonic clock, s.
    """
    found = []
    for rank in ranks:
        while not (there := comm.iprobe(rank, REFUSED)) and time.monotonic() < last:
            time.sleep(0.01)
        found.append(comm.recv(source=rank, tag=REFUSED) if there else None)
    return found


def _stopped(word: str, code: int) -> int:
    comm = _ranks()
    return _say(word, code) if comm is None or comm.rank == 0 else code


def _say(sentence: str, code: int) -> int:
    print(f"fenicsrom: {sentence}", file=sys.stderr, flush=True)
    return code


def _ranks() -> Any:
    """The communicator of all ranks; None where MPI is not in use, or there is one only."""
    mpi = sys.modules.get("mpi4py.MPI")
    return mpi.COMM_WORLD if mpi and mpi.COMM_WORLD.size > 1 else None


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="fenicsrom", description="Reduced-order models of structures that rub."
    )
    commands = parser.add_subparsers(required=True, metavar="COMMAND")

    run = commands.add_parser("run", help="run a scene, or integrate a stored reduced model again")
    run.add_argument("scene", nargs="?", help="scene file (TOML)")
    run.add_argument(
        "--from",
        dest="stored",
        metavar="MODEL",
        help="a reduced_model.npz to integrate again, without a mesh",
    )
    run.add_argument(
        "--resume",
        metavar="CHECKPOINT",
        help="a checkpoint.npz of the reduced model's run, to go on from",
    )
    run.set_defaults(command=_run)

    plan = commands.add_parser(
        "plan", help="say what a scene will compute, what it leaves out, and why"
    )
    plan.add_argument("scene", help="scene file (TOML)")
    plan.set_defaults(command=_plan)

    modes = commands.add_parser("modes", help="modes and derivatives only, for ParaView")
    modes.add_argument("scene", help="scene file (TOML)")
    modes.set_defaults(command=_modes)

    compare = commands.add_parser(
        "compare", help="every basis against the full model: error against run time"
    )
    compare.add_argument(
        "scene", help="scene file (TOML); its [compare] table says what to compare"
    )
    compare.set_defaults(command=_compare)

    campbell = commands.add_parser(
        "campbell", help="frequencies against speed, with engine orders and critical speeds"
    )
    campbell.add_argument(
        "scene",
        help="scene file (TOML) with a [rotation] table; its [campbell] table says what to draw",
    )
    campbell.set_defaults(command=_campbell)

    stability = commands.add_parser(
        "stability", help="extreme variants of a scene, and a verdict on each"
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

    for command in (run, plan, modes, compare, campbell, stability):
        command.add_argument(
            "--set",
            action="append",
            default=[],
            metavar="KEY=VALUE",
            dest="overrides",
            help="change a value of the scene, such as loads.0.force=200 (text in quotes); may be repeated",
        )
    for command in (run, modes, compare, campbell, stability):
        command.add_argument(
            "--output", metavar="DIR", help="folder of the results (default: out/NAME of the scene)"
        )
    return parser


def _folder(options: argparse.Namespace, source: str) -> Path:
    return Path(options.output) if options.output else Path("out") / Path(source).stem


def _run(options: argparse.Namespace) -> int:
    if options.stored:
        return _rerun(options)
    if options.scene is None and options.resume:
        raise SceneError(
            "fenicsrom run: --resume needs the model too: --from reduced_model.npz, or the scene file"
        )
    if options.scene is None:
        raise SceneError(
            "fenicsrom run: SCENE is missing: must be a scene file, or --from a stored reduced model"
        )
    comm, say, scene, folder = _start(options)
    from fenicsrom import study
    from fenicsrom.online import measures
    from fenicsrom.post import results

    resume = Path(options.resume) if options.resume else None
    found = study.run(scene, comm, say, lambda made: results.restarts(made, folder, resume))
    say("files ..")
    files = results.write_study(found, folder)
    if comm.rank == 0:
        table = results.terminal_table(found.motions, results.sizes(found)) if found.motions else ""
        _found(scene, table, found.solid.warnings)
        if "reduced" in found.motions and (
            sentence := results.resumed_sentence(found.motions["reduced"])
        ):
            print(sentence)
        if found.deflection is not None:
            print(results.equilibrium_sentence(found.deflection))
        if (basis := found.basis) is not None:
            print(f"basis: {basis.method}, {basis.size} coordinates: {' '.join(basis.labels)}")
            condition = found.modes.flexibility_condition
            print(
                f"condition: {basis.condition:.3g} of the reduced mass, {condition:.3g} of the residual flexibility, scaled"
            )
        for sentence in (
            measures.out_of_reach(found.motions["reduced"], found.solid.points)
            if "reduced" in found.motions
            else []
        ):
            print(sentence)
        if found.errors:
            print(results.estimate_sentence(found))
        if errors := results.errors_of(found.motions):
            print(results.error_sentence(errors))
        if "full" in found.motions and "reduced" in found.motions:
            slow, fast = (found.motions[name] for name in ("full", "reduced"))
            ratio = (slow.seconds / max(slow.steps, 1)) / (fast.seconds / max(fast.steps, 1))
            print(f"The reduced model took 1/{ratio:.0f} of the full model's time for a step.")
        _files(files)
    if found.unfinished:
        comm.barrier()  # the first rank has its files to write
        raise found.unfinished[1]
    return 0


def _rerun(options: argparse.Namespace) -> int:
    from dataclasses import replace

    from fenicsrom.assess import verdicts
    from fenicsrom.online import archive, simulate
    from fenicsrom.online import checkpoints as restart
    from fenicsrom.post import results

    stored = archive.load_model(Path(options.stored))
    resume = Path(options.resume) if options.resume else None
    if resume is not None:  # the run to continue may have another scene than the stored model
        stored = replace(stored, scene=restart.load_scene(resume))
    if options.scene is not None:
        current = stored.with_scene(read_scene(options.scene, options.overrides))
    else:
        current = stored.with_overrides(options.overrides)
    model, scene = current.model, current.scene
    begin = restart.load_checkpoint(resume, model, scene) if resume is not None else None
    folder = _folder(options, options.scene or options.stored)
    _writable(folder)
    unfinished: ConvergenceError | AccuracyError | None = None
    try:
        keep = restart.keeper(folder / results.CHECKPOINT, model, scene)
        motion = simulate.simulate(model, scene, resume=begin, checkpoint=keep)
    except (AccuracyError, ConvergenceError) as error:
        if error.partial is None:
            raise
        motion, unfinished = error.partial, error
    else:
        unfinished = verdicts.rejection_reason(model, scene, motion)
    files = results.write_rerun(stored, scene, motion, folder)
    _found(scene, results.terminal_table({"reduced": motion}, {"reduced": stored.size}), [])
    if sentence := results.resumed_sentence(motion):
        print(sentence)
    _files(files)
    if unfinished:
        raise unfinished
    return 0


def _modes(options: argparse.Namespace) -> int:
    comm, say, scene, folder = _start(options)
    from fenicsrom import study
    from fenicsrom.post import results

    found = study.offline(scene, comm, study.Stopwatch(say), modes_only=True)
    say("files ..")
    files = results.write_study(found, folder)
    if comm.rank == 0:
        print()
        for warning in found.solid.warnings:
            print(f"warning: {warning}")
        for k, frequency in enumerate(found.modes.frequencies_hz):
            print(f"{k + 1}V  {frequency:.5g} Hz")
        if found.derivatives.labels:
            print(f"derivatives: {' '.join(found.derivatives.labels)}")
        _files(files)
    return 0


def _compare(options: argparse.Namespace) -> int:
    comm, say, scene, folder = _start(options)
    from fenicsrom.assess import compare
    from fenicsrom.post import compare_report

    found = compare.compare(scene, comm, say)
    if comm.rank == 0:
        files = compare_report.write_comparison(found, folder)
        _found(scene, compare_report.terminal(found), found.warnings)
        _files(files)
    return 0


def _campbell(options: argparse.Namespace) -> int:
    comm, say, scene, folder = _start(options)
    from fenicsrom.assess import campbell
    from fenicsrom.post import campbell_report

    found = campbell.campbell(scene, comm, say)
    if comm.rank == 0:
        files = campbell_report.write(found, folder)
        _found(scene, campbell_report.terminal(found), found.warnings)
        _files(files)
    if found.unfinished:
        comm.barrier()
        raise found.unfinished
    return 0


def _stability(options: argparse.Namespace) -> int:
    folder = Path(options.output) if options.output else Path("out") / "stability"
    _writable(folder)
    from fenicsrom.assess import stability
    from fenicsrom.post import stability_report

    matrix = stability.stability(
        Path(options.scene),
        options.overrides,
        lambda line: print(line, file=sys.stderr, flush=True),
        options.axis,
    )
    files = stability_report.write(matrix, folder)
    print()
    print("\n".join([*stability_report.sentences(matrix), *matrix.left_out]))
    _files(files)
    return 1 if matrix.count(stability.Verdict.WRONG) else 0


def _plan(options: argparse.Namespace) -> int:
    from fenicsrom.plan import plan

    scene = read_scene(options.scene, options.overrides)
    for stage in plan(scene):
        print(f"{'runs     ' if stage.runs else 'left out '} {stage.name:26} {stage.why}")
    return 0


def _start(options: argparse.Namespace) -> tuple[Any, Any, Scene, Path]:
    """The communicator, where progress goes, the scene and the output folder.

    MPI comes first, so that a scene that is wrong is called so once; the folder is made before
    anything is computed, so that a run is not lost for want of it.
    """
    from mpi4py import MPI

    comm = MPI.COMM_WORLD
    scene = read_scene(options.scene, options.overrides)
    folder = _folder(options, options.scene)
    if comm.rank == 0:
        _writable(folder)

    def say(line: str) -> None:
        if comm.rank == 0:
            print(line, file=sys.stderr, flush=True)

    return comm, say, scene, folder


def _writable(folder: Path) -> None:
    folder.mkdir(parents=True, exist_ok=True)


def _found(scene: Scene, table: str, warnings: Sequence[str]) -> None:
    print()
    if scene.title:
        print(scene.title)
    if table:
        print(table)
    for warning in warnings:
        print(f"warning: {warning}")


def _files(files: Sequence[Path]) -> None:
    print("files:")
    for path in files:
        print(f"  {path}")

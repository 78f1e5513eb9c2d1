"""Pictures and animations of the solid body, drawn by pyvista in a separate process.

VTK may abort its process when there is no display. The process runs under Xvfb if that is
installed.
"""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import warnings
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from fenicsrom.files import atomic_write
from fenicsrom.online.stress import StressTable, von_mises
from fenicsrom.online.stress_peaks import Peak
from fenicsrom.post.optional import missing_module
from fenicsrom.post.vtk import write_fields, write_motion, write_points
from fenicsrom.post.vtk_files import in_space, refined_grid, write_vtu
from fenicsrom.reduction.beam import SerialCommunicator

if TYPE_CHECKING:
    from dolfinx.fem import Function, FunctionSpace


def animate(
    gif: str | Path,
    space: FunctionSpace,
    times: Sequence[float] | np.ndarray,
    frames: Callable[[int], np.ndarray | Function],
    marks: tuple[np.ndarray, Mapping[str, np.ndarray]] | None = None,
    rest: np.ndarray | Function | None = None,
) -> Path | None:
    """Draw a motion as an animated GIF. Collective.

    The body is deformed and coloured by its displacement, its contact points are marked. With a
    state of rest, the displacements are those from this state, which is drawn to scale.
    Displacements are drawn to scale if the largest is at least `style.TRUE_SCALE` of the length
    of the body; otherwise they are magnified by a round number that the picture shows.

    Args:
        gif: the file to write.
        space: vector Lagrange space of degree 1 or 2.
        times: (n_frames,) instants, s.
        frames: as in `write_motion`.
        marks: (P, 3) positions of the contact points in the state of rest, m, and the arrays
            `displacement` from there (n_frames, P, 3), m, and `state` (n_frames, P).
        rest: displacement of the state of rest, as a frame; by default the undeformed body.

    Returns:
        The file, or None after a warning if this machine cannot draw.

    Raises:
        OSError: the file cannot be written.
    """
    comm = space.mesh.comm

    def task(scratch: Path) -> dict[str, Any]:
        found = {
            "motion": str(write_motion(scratch, "motion", space, times, frames)),
            "points": None,
            "rest": None,
        }
        if rest is not None:
            found["rest"] = str(write_fields(scratch, "rest", space, {"displacement": rest}))
        if marks is not None and comm.rank == 0:
            points, arrays = marks
            drawn = {name: arrays[name] for name in ("displacement", "state")}
            found["points"] = str(write_points(scratch, "points", times, points, drawn))
        return found

    return _draw(gif, comm, "draw_motion", task)


def picture_stress(png: str | Path, table: StressTable, peak: Peak, measure: str) -> Path | None:
    """Draw the von Mises stress of a state on the deformed body. On one rank.

    Displacements are magnified as in `animate`; the largest stress is marked.

    Args:
        png: the picture to write.
        table: the table of the stresses.
        peak: the state.
        measure: the stress, one of `fenicsrom.online.stress.MEASURES`.

    Returns:
        The picture, or None after a warning if this machine cannot draw.

    Raises:
        OSError: the picture cannot be written.
    """

    def task(scratch: Path) -> dict[str, Any]:
        grid, mean = refined_grid(table.vertex_position, table.cells)
        stress = table.at_vertices(table.stress(peak.coordinates, measure))
        arrays = {
            "displacement": in_space(mean @ table.displacement(peak.coordinates)),
            "von Mises": von_mises(mean @ stress),
        }
        write_vtu(scratch / "stress.vtu", grid, arrays)
        when = "" if peak.time is None else f", t = {peak.time:.6g} s"
        place = ", ".join(f"{x:.4g}" for x in peak.position)
        return {
            "source": str(scratch / "stress.vtu"),
            "title": f"{peak.state}{when}: {1e-6 * peak.von_mises:.4g} MPa at ({place}) m",
            "label": "von Mises stress, MPa",
        }

    return _draw(png, SerialCommunicator(), "draw_stress", task)


def _draw(
    picture: str | Path, comm: Any, draw: str, task: Callable[[Path], dict[str, Any]]
) -> Path | None:
    """Draw a picture with a function of `drawing` in a separate process. Collective.

    Args:
        picture: the file to write.
        comm: the communicator.
        draw: name of the function.
        task: writes the data to a temporary folder and returns the input of the function.

    Returns:
        The picture, or None after a warning if this machine cannot draw.
    """
    scratch = Path(comm.bcast(tempfile.mkdtemp(prefix="fenicsrom-") if comm.rank == 0 else None))
    reason: str | None = None
    failure: OSError | None = None
    try:
        given = task(scratch)
        if comm.rank == 0:
            drawn = scratch / Path(picture).name
            reason = run_drawing(draw, drawn, given)
            if reason:
                warnings.warn(f"{picture} was not drawn: {reason}.", stacklevel=3)
            else:
                try:
                    with atomic_write(picture) as temporary:
                        shutil.copyfile(drawn, temporary)
                except OSError as error:
                    failure = error
    finally:
        if comm.rank == 0:
            shutil.rmtree(scratch, ignore_errors=True)
    reason, failure = comm.bcast((reason, failure))
    if failure:
        raise failure
    return None if reason else Path(picture)


def run_drawing(
    draw: str, picture: Path, task: Mapping[str, Any], module: str = "drawing"
) -> str | None:
    """Run a drawing function in a separate process.

    Args:
        draw: name of the function.
        picture: the file that it writes.
        task: its input, as JSON.
        module: the module of this package that has the function.

    Returns:
        The reason of a failure, or None.
    """
    if reason := missing_module("pyvista", "matplotlib"):
        return reason
    program = f"from fenicsrom.post.{module} import {draw}; {draw}()"
    command = [sys.executable, "-c", program, json.dumps({"picture": str(picture), **task})]
    if server := shutil.which("xvfb-run"):
        command = [server, "-a", *command]
    environment = {
        k: v for k, v in os.environ.items() if not k.startswith(("OMPI_", "PMIX_", "PRTE_", "PMI_"))
    }
    package = str(Path(__file__).resolve().parents[2])
    paths = [package, environment.get("PYTHONPATH")]
    environment["PYTHONPATH"] = os.pathsep.join(filter(None, paths))
    process = subprocess.Popen(
        command,
        env=environment,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    try:
        _, said = process.communicate()
    except BaseException:
        os.killpg(process.pid, signal.SIGTERM)
        process.wait()
        raise
    if process.returncode == 0 and picture.exists():
        return None
    if server is None:
        return "no display and no Xvfb was found (install the packages xvfb and xauth)"
    last = (said.strip().splitlines() or ["without a message"])[-1]
    return f"the drawing process ended with exit code {process.returncode} ({last})"

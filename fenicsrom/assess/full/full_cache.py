"""The motion of the full model, kept in the cache of results."""

from __future__ import annotations

import os
import platform
import re
import time as clock
from contextlib import suppress
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

from fenicsrom.online.motion.motion import Motion
from fenicsrom.online.run.simulate import simulate
from fenicsrom.online.store.packing import pack, unpack
from fenicsrom.online.store.result_cache import (
    cache_folder,
    key_of,
    mesh_digest,
    read_results,
    write_results,
)
from fenicsrom.progress import log
from fenicsrom.scene import Scene, scene_table

if TYPE_CHECKING:
    from fenicsrom.reduction.protocols import Structure

WHAT = "the motion of the full model"


def full_motion(body: Structure, scene: Scene) -> tuple[Motion, dict[str, Any]]:
    """The motion of the full model, from the cache if an equal scene ran before.

    Args:
        body: the solid or the beam.
        scene: its scene.

    Returns:
        The motion; when and where it ran, and whether it came from the cache.
    """
    comm, folder, key = body.comm, cache_folder(), cache_key(scene)
    if folder is not None and key is not None:
        found = read_results(folder, key, WHAT, _motion_of) if comm.rank == 0 else None
        found = comm.bcast(found)
        if found is not None:
            log.info(f"full model: taken from {folder}")
            return found[0], found[1] | {"cached": True}
    from fenicsrom.fem.full.full import full_model  # slow to import

    log.info("full model ..")
    last = clock.perf_counter()

    def progress(fraction: float, change: float) -> None:
        nonlocal last
        if clock.perf_counter() - last > 5.0:
            last = clock.perf_counter()
            limit = f"at most {scene.time.periods} periods"
            log.info(f"  full model: {100.0 * fraction:.0f} % of {limit}, change {change:.1e}")

    model = full_model(body)
    motion = simulate(model, scene, progress=progress)
    date = datetime.now(UTC).isoformat(timespec="seconds")
    note = {"date": date, "machine": machine(), "ranks": comm.size}
    if folder is not None and key is not None and comm.rank == 0:
        tree, arrays = pack(replace(motion, end=None))
        write_results(folder, key, WHAT, {"note": note, "motion": tree}, arrays)
    return motion, note | {"cached": False}


def _motion_of(header: Any, arrays: Any) -> tuple[Motion, dict[str, Any]]:
    """A motion and its note."""
    return unpack(header["motion"], arrays, {"Motion": Motion}), header["note"]


def cache_key(scene: Scene) -> str | None:
    """A hash of all that the motion depends on; None if the mesh file reads other files."""
    table = scene_table(scene)
    for name in ("title", "basis", "reference", "output", "compare"):
        table.pop(name, None)
    mesh = table["geometry"]["mesh"] = mesh_digest(scene.geometry.mesh)
    return None if mesh is None else key_of(table)


def machine() -> dict[str, Any]:
    """The processor and the number of threads of the numerical libraries."""
    name = platform.processor() or platform.machine()
    with suppress(OSError):
        found = re.search(r"model name\s*: (.*)", Path("/proc/cpuinfo").read_text("utf-8"))
        name = found[1].strip() if found else name
    return {
        "processor": name,
        "cores": os.cpu_count(),
        "system": platform.system(),
        "OMP_NUM_THREADS": os.environ.get("OMP_NUM_THREADS", "not set"),
    }

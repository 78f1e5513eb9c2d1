"""The motion of the full model, kept in the user's cache folder.

The name of a file is a hash of everything the motion depends on: the scene without basis and
output, the content of the mesh file, the versions of the libraries, and every module of this
package.
"""

from __future__ import annotations

import hashlib
import json
import os
import platform
import time as clock
from contextlib import suppress
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

from fenicsrom.errors import SceneError
from fenicsrom.files import (
    cache_is_off,
    read_archive,
    reads_other_files,
    write_archive,
)
from fenicsrom.online.motion.motion import Motion
from fenicsrom.online.run.simulate import simulate
from fenicsrom.online.store.packing import pack, unpack
from fenicsrom.online.store.provenance import provenance
from fenicsrom.progress import log
from fenicsrom.scene import Scene, scene_table

if TYPE_CHECKING:
    from fenicsrom.reduction.protocols import Structure

PACKAGE = Path(__file__).parents[2]


def full_motion(body: Structure, scene: Scene) -> tuple[Motion, dict[str, Any]]:
    """The motion of the full model, from the cache if an equal scene ran before.

    Args:
        body: the solid or the beam.
        scene: its scene.

    Returns:
        The motion; when and where it ran, and whether it came from the cache.
    """
    comm, key = body.comm, cache_key(scene)
    path = cache_folder() / f"full-{key[:32]}.npz"
    kept = not cache_is_off() and not reads_other_files(scene.geometry.mesh.read_bytes())
    found = read_cached(path, key) if kept and comm.rank == 0 else None
    found = comm.bcast(found)
    if found is not None:
        log.info(f"full model: taken from {path}")
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

    model = full_model(body, scene)
    motion = simulate(model, scene, progress=progress)
    note = {
        "date": datetime.now(UTC).isoformat(timespec="seconds"),
        "machine": machine(),
        "ranks": comm.size,
    }
    if kept and comm.rank == 0:
        try:
            write_cached(path, key, motion, note)
        except OSError as error:
            log.info(f"the motion of the full model was not stored in the cache: {error}")
    return motion, note | {"cached": False}


def cache_folder() -> Path:
    """The folder of fenicsrom in the cache folder of the user."""
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "fenicsrom"


def cache_key(scene: Scene) -> str:
    """A hash of everything that the motion of the full model depends on (module docstring)."""
    table = scene_table(scene)
    for name in ("title", "basis", "reference", "output", "compare"):
        table.pop(name, None)
    table["geometry"]["mesh"] = hashlib.sha256(scene.geometry.mesh.read_bytes()).hexdigest()
    table["program"] = provenance()
    digest = hashlib.sha256(json.dumps(table, sort_keys=True).encode())
    digest.update(package_digest(PACKAGE).encode())
    return digest.hexdigest()


def package_digest(folder: Path) -> str:
    """SHA-256 of the names and the content of all modules in a folder."""
    digest = hashlib.sha256()
    for module in sorted(folder.rglob("*.py")):
        content = hashlib.sha256(module.read_bytes()).hexdigest()
        digest.update(f"{module.relative_to(folder)} {content}\n".encode())
    return digest.hexdigest()


def write_cached(path: Path, key: str, motion: Motion, note: dict[str, Any]) -> None:
    """Write a motion to a file that appears only when it is complete.

    Raises:
        OSError: the file cannot be written.
    """
    tree, arrays = pack(replace(motion, end=None))
    write_archive(path, {"format": key, "note": note, "motion": tree}, arrays, compress=True)


def read_cached(path: Path, key: str) -> tuple[Motion, dict[str, Any]] | None:
    """The motion of a key and its note; None if there is no file or it is damaged."""
    with suppress(SceneError), read_archive(path, "a motion", key) as (header, arrays):
        return unpack(header["motion"], arrays, {"Motion": Motion}), header["note"]
    return None


def machine() -> dict[str, Any]:
    """The processor and the number of threads of the numerical libraries."""
    name = platform.processor() or platform.machine()
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
        name = next(
            (line.partition(":")[2].strip() for line in lines if line.startswith("model name")),
            name,
        )
    except OSError:
        pass
    threads = os.environ.get("OMP_NUM_THREADS", "not set")
    return {
        "processor": name,
        "cores": os.cpu_count(),
        "system": platform.system(),
        "OMP_NUM_THREADS": threads,
    }

"""Reduced-order models of geometrically nonlinear structures with friction contact.

    scene = fenicsrom.read_scene("demos/slip_liftoff_2d.toml")
    stored = fenicsrom.build_model(scene)
    motion = stored.simulate()

Imports run one way. A package may import itself and the packages on its left, never those on its
right:

    arrays, errors, files, progress, words, notes < formats < scene < online < reduction < fem
        < exchange < assess < records < post < study < cli

Only `fem` needs dolfinx; `scene`, `online` and `reduction` run with numpy, scipy and numba alone.
The names below are the public interface. Each is imported from its module on first use. Therefore
`import fenicsrom` is fast, and it loads only the modules that the caller uses.
"""

import re
from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from fenicsrom.errors import AccuracyError, ConvergenceError, ErrorKind, SceneError
    from fenicsrom.fem.full.full import FullModel
    from fenicsrom.fem.mesh.inspection import inspect
    from fenicsrom.fem.mesh.mesh import Mesh, build_mesh, mesh_from_dolfinx, mesh_from_gmsh_model
    from fenicsrom.fem.solid.solid import Solid, build_solid, solid_of
    from fenicsrom.online.curves.solutions import Solutions, follow
    from fenicsrom.online.model.matrices import ModelArrays, model_arrays
    from fenicsrom.online.model.model import ReducedModel
    from fenicsrom.online.motion.measures import amplitudes, contact_fractions
    from fenicsrom.online.motion.motion import History, Motion, read_history
    from fenicsrom.online.run.simulate import simulate
    from fenicsrom.online.store.archive import StoredModel, load_disk, load_model, save_model
    from fenicsrom.online.store.disk import StoredDisk
    from fenicsrom.post.base.page import Report
    from fenicsrom.post.reports import report
    from fenicsrom.post.run.pictures import view
    from fenicsrom.progress import asking
    from fenicsrom.records import Study
    from fenicsrom.reduction.modes import component_modes
    from fenicsrom.reduction.stages import choose, differentiate, enrich, reduce
    from fenicsrom.scene import Scene, make_scene, parse_scene, read_scene
    from fenicsrom.study import (
        backbone,
        build_disk,
        build_model,
        campbell,
        compare,
        interaction_map,
        modes,
        response,
        ringdown,
        run,
        run_disk,
        stability,
        statics,
        sweep,
    )

__version__ = "0.2.0"

with open(__file__, encoding="utf-8") as _file:
    _MODULES = {
        name: module
        for module, names in re.findall(
            r"^    from (fenicsrom\.\S+) import (\([^)]*\)|.+)$", _file.read(), re.MULTILINE
        )
        for name in re.findall(r"\w+", names)
    }
"""The module of each public name: the imports above, which only type checkers read."""

__all__ = sorted(_MODULES)


def __getattr__(name: str) -> Any:
    """Import a public name from its module on first use (PEP 562)."""
    if name in _MODULES:
        value = getattr(import_module(_MODULES[name]), name)
        globals()[name] = value
        return value
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    """List the public names."""
    return sorted([*__all__, "__version__"])

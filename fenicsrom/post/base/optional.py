"""Python modules that only some outputs need."""

import importlib.util
import os
from ctypes.util import find_library
from functools import cache


def missing_module(*names: str) -> str | None:
    """Say which of some Python modules is not installed; None if all are installed."""
    missing = (name for name in names if importlib.util.find_spec(name) is None)
    return next((f"{name} is not installed" for name in missing), None)


@cache
def missing_renderer() -> str | None:
    """Say why bodies in space cannot be drawn on this machine; None if they can."""
    if reason := missing_module("matplotlib", "pyvista", "vtkmodules"):
        return reason
    import pyvista
    import vtkmodules.vtkRenderingOpenGL2  # noqa: F401  # the windows that can be found
    from vtkmodules.vtkRenderingCore import vtkRenderWindow

    pyvista.vtk_verbosity("off")  # VTK would print which kinds of windows it tries
    kind = vtkRenderWindow().GetClassName()
    if kind == "vtkXOpenGLRenderWindow" and "DISPLAY" not in os.environ:
        return "VTK older than 9.4 cannot draw without a screen"
    if kind == "vtkOSOpenGLRenderWindow" and not find_library("OSMesa"):
        return "VTK finds neither EGL nor OSMesa, one of which it needs to draw without a screen"
    return None

"""Python modules that only some outputs need."""

from __future__ import annotations

import importlib.util


def missing_module(*names: str) -> str | None:
    """Say which of some Python modules is not installed; None if all are installed."""
    for name in names:
        try:
            found = importlib.util.find_spec(name)
        except ModuleNotFoundError:
            found = None
        if found is None:
            return f"{name} is not installed"
    return None

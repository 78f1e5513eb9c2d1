"""The report of every record that a command finds."""

from __future__ import annotations

from importlib import import_module
from typing import Any

from fenicsrom.post.base.report import Report

MODULES = {
    "Backbone": "curves.backbone_report",
    "Campbell": "studies.campbell_report",
    "Comparison": "studies.compare_report",
    "EquilibriumPath": "curves.equilibrium_report",
    "Matrix": "studies.stability_report",
    "Response": "curves.response_report",
    "Sweep": "studies.sweep_report",
}
"""The kind of a record -> the module of its report, which is imported when it is needed."""


def report(found: Any) -> Report:
    """The report of a record that `response`, `backbone`, `statics`, .. return.

    `report(found).write(folder)` writes its files, `.text()` gives it for the terminal, and
    `.plot()` draws its first picture. A notebook shows it as a page.

    Raises:
        TypeError: the object is no such record.
    """
    name = type(found).__name__
    if name not in MODULES:
        raise TypeError(
            f"{name}: must be what response, backbone, statics, campbell, compare, sweep or "
            "stability returns"
        )
    made: Report = import_module(f"fenicsrom.post.{MODULES[name]}").report(found)
    return made

"""The report of every record that a command finds."""

from collections.abc import Callable
from typing import Any

from fenicsrom.post.base.page import Report


def report(found: Any) -> Report:
    """The report of a record that `run`, `response`, `statics`, .. return.

    `report(found).write(folder)` writes its files, `.text()` gives it for the terminal, and
    `.plot()` draws its first picture. A notebook shows it as a page.

    Raises:
        TypeError: the object is no such record.
    """
    compose: Callable[[Any], Report]
    match type(found).__name__:  # each report is imported when it is needed
        case "Backbone":
            from fenicsrom.post.curves.backbone_report import report as compose
        case "Campbell" if found.waves:
            from fenicsrom.post.studies.disk_report import disk_report as compose
        case "Campbell":
            from fenicsrom.post.studies.campbell_report import report as compose
        case "Comparison":
            from fenicsrom.post.studies.compare_report import report as compose
        case "DiskRun":
            from fenicsrom.post.studies.disk_run_report import report as compose
        case "EquilibriumPath":
            from fenicsrom.post.curves.equilibrium_report import report as compose
        case "InteractionMap":
            from fenicsrom.post.studies.interaction_report import report as compose
        case "Matrix":
            from fenicsrom.post.studies.stability_report import report as compose
        case "Ringdown":
            from fenicsrom.post.studies.ringdown_report import report as compose
        case "Study" | "Rerun":
            from fenicsrom.post.run.report import report as compose
        case "Response":
            from fenicsrom.post.curves.response_report import report as compose
        case "Sweep":
            from fenicsrom.post.studies.sweep_report import report as compose
        case name:
            raise TypeError(
                f"{name}: must be what run, modes, response, backbone, ringdown, statics, "
                "campbell, interaction_map, compare, sweep or stability returns"
            )
    return compose(found)

"""The commands: each module holds the arguments and the function of one command or of several."""

from __future__ import annotations

from fenicsrom.cli.commands import (
    cache,
    export,
    import_matrices,
    init,
    inspect,
    modes,
    plan,
    report,
    run,
    schema,
    stability,
    studies,
    sweep,
    view,
)

COMMANDS = (
    *(module.COMMAND for module in (run, plan, modes, inspect, init)),
    *studies.COMMANDS,
    *(module.COMMAND for module in (sweep, export, import_matrices, cache, schema)),
    *(module.COMMAND for module in (stability, view, report)),
)
"""In the order of the help."""

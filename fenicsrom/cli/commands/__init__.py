"""The commands: each module holds the arguments and the function of one command."""

from __future__ import annotations

from fenicsrom.cli.commands import (
    backbone,
    cache,
    campbell,
    compare,
    export,
    import_matrices,
    init,
    inspect,
    map,
    modes,
    plan,
    report,
    response,
    run,
    schema,
    stability,
    statics,
    sweep,
    view,
)

COMMANDS = tuple(
    module.COMMAND
    for module in (
        run,
        plan,
        modes,
        inspect,
        init,
        compare,
        campbell,
        response,
        backbone,
        statics,
        sweep,
        map,
        export,
        import_matrices,
        cache,
        schema,
        stability,
        view,
        report,
    )
)
"""In the order of the help."""

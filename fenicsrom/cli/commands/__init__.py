"""The commands: each module holds the arguments and the function of one command or of several."""

import argparse

from fenicsrom import __version__
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


def make_parser() -> argparse.ArgumentParser:
    """Make the parser of the command line."""
    parser = argparse.ArgumentParser(
        prog="fenicsrom",
        description="Reduced-order models of geometrically nonlinear structures with friction.",
    )
    parser.add_argument("--version", action="version", version=f"fenicsrom {__version__}")
    subparsers = parser.add_subparsers(required=True, metavar="COMMAND")
    for command in COMMANDS:
        subparser = subparsers.add_parser(command.name, help=command.help)
        for argument in command.arguments:
            subparser.add_argument(*argument.names, **argument.settings)
        subparser.set_defaults(command=command.run, name=command.name)
    return parser

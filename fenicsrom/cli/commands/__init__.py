"""The commands: each module holds the arguments and the function of one command or of several."""

import argparse

from fenicsrom import __version__
from fenicsrom.cli.commands import studies
from fenicsrom.cli.commands.exchange import export, import_matrices
from fenicsrom.cli.commands.folders import cache, report, schema, view
from fenicsrom.cli.commands.meshes import init, inspect
from fenicsrom.cli.commands.plan import plan

RUN, MODES, *STUDIES, SWEEP, STABILITY = studies.COMMANDS
FIRST = (RUN, plan, MODES, inspect, init)
LAST = (SWEEP, export, import_matrices, cache, schema, STABILITY, view, report)
COMMANDS = (*FIRST, *STUDIES, *LAST)
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

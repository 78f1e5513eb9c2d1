"""The parser of the command line."""

import argparse

from fenicsrom import __version__
from fenicsrom.cli.commands import COMMANDS


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

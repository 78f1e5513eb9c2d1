"""`fenicsrom campbell`: compute a Campbell diagram."""

from __future__ import annotations

import argparse

from fenicsrom import study
from fenicsrom.cli.arguments import FORCE, FROM, OUTPUT, SET, Argument, Command
from fenicsrom.cli.ending import finish
from fenicsrom.cli.output import opened
from fenicsrom.cli.starting import source

TURNING_SCENE = Argument(
    "scene",
    nargs="?",
    help="scene file (TOML) with a [rotation] table; its [campbell] table gives the speeds",
)


def campbell(options: argparse.Namespace) -> int:
    """Compute a Campbell diagram."""
    comm, given, scene = source(options, unloaded=True)
    with opened(options, scene, comm) as folder:
        return finish(study.campbell(given, comm, folder=folder), comm)


COMMAND = Command(
    "campbell",
    "compute a Campbell diagram: frequencies and critical speeds",
    campbell,
    (
        TURNING_SCENE,
        FROM,
        SET,
        OUTPUT,
        FORCE,
    ),
)

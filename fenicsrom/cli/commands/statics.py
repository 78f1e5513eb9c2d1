"""`fenicsrom statics`: follow static equilibria over a load factor."""

from __future__ import annotations

import argparse

from fenicsrom import study
from fenicsrom.cli.arguments import RESULTS, Command, scene_file
from fenicsrom.cli.ending import finish
from fenicsrom.cli.output import opened
from fenicsrom.cli.starting import start
from fenicsrom.cli.termination import is_terminated

LOADED_SCENE = scene_file(" with static loads; its [statics] table gives the range of their factor")


def statics(options: argparse.Namespace) -> int:
    """Follow the static equilibria of a scene over a load factor."""
    comm, scene = start(options)
    from fenicsrom.assess.curves.equilibrium_path import varied_loads

    varied_loads(scene)  # before the output folder is opened
    with opened(options, scene, comm) as folder:
        found = study.statics(scene, comm, folder=folder, stop=is_terminated)
        return finish(found, comm, found.points)


COMMAND = Command(
    "statics",
    "follow static equilibria over a load factor, through limit points (snap-through)",
    statics,
    (LOADED_SCENE, *RESULTS),
)

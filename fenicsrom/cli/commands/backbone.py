"""`fenicsrom backbone`: follow a damped nonlinear mode."""

from __future__ import annotations

import argparse

from fenicsrom import study
from fenicsrom.cli.arguments import FROM_MODEL, Command, scene_file
from fenicsrom.cli.ending import finish
from fenicsrom.cli.output import opened
from fenicsrom.cli.starting import source
from fenicsrom.cli.termination import is_terminated

SWINGING_SCENE = scene_file(
    "; its [backbone] table gives the mode and the range of its amplitude", nargs="?"
)


def backbone(options: argparse.Namespace) -> int:
    """Compute a damped nonlinear mode of a scene or of a stored model."""
    comm, given, scene = source(options)
    with opened(options, scene, comm) as folder:
        found = study.backbone(given, comm, folder=folder, stop=is_terminated, fresh=options.fresh)
        return finish(found, comm, found.points)


COMMAND = Command(
    "backbone",
    "follow a damped nonlinear mode: frequency and damping ratio against amplitude",
    backbone,
    (SWINGING_SCENE, *FROM_MODEL),
)

"""`fenicsrom modes`: compute modes and modal derivatives."""

import argparse

from fenicsrom import study
from fenicsrom.cli.arguments import RESULTS, SCENE, command
from fenicsrom.cli.output import opened
from fenicsrom.cli.printing import finish
from fenicsrom.cli.starting import start
from fenicsrom.cli.termination import is_stopped


@command("compute only the modes and modal derivatives, for ParaView", SCENE, *RESULTS)
def modes(options: argparse.Namespace) -> int:
    """Compute modes and modal derivatives."""
    comm, scene = start(options, unloaded=True)
    with opened(options, scene, comm) as folder:
        found = study.run(scene, comm, folder=folder, modes_only=True, stop=is_stopped)
        return finish(found, comm)

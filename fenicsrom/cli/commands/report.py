"""`fenicsrom report`: put the results of several output folders on one page."""

import argparse
from pathlib import Path

from fenicsrom.cli.arguments import Argument, command, refused
from fenicsrom.cli.output import target
from fenicsrom.cli.printing import print_results
from fenicsrom.errors import ErrorKind

FOLDERS = Argument(
    "folders", nargs="+", help="output folders of run, response and backbone, in their order"
)
OUTPUT = Argument("--output", metavar="DIR", default="out/report", help="folder of the page")


@command("compare the results of several output folders on one page", FOLDERS, OUTPUT)
def report(options: argparse.Namespace) -> int:
    """Write a page with the results of several output folders.

    Raises:
        SceneError: a folder holds no such results, or the output folder holds those of a command.
        OSError: a file cannot be written.
    """
    from fenicsrom.post.base.origin import SCENE_FILE
    from fenicsrom.post.studies.folders_report import write

    output = target(options.output)
    if (output / SCENE_FILE).exists():
        reason = "the folder holds the results of a command; give another one"
        raise refused("--output", output, reason, ErrorKind.FILE)
    table, files = write([Path(folder) for folder in options.folders], output)
    print_results(None, table, [], files=files)
    return 0

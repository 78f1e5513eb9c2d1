"""`fenicsrom report`: put the results of several output folders on one page."""

import argparse
from pathlib import Path

from fenicsrom.cli.arguments import Argument, Command
from fenicsrom.cli.output import target
from fenicsrom.cli.printing import print_results

FOLDERS = Argument(
    "folders", nargs="+", help="output folders of run, response and backbone, in their order"
)
OUTPUT = Argument("--output", metavar="DIR", default="out/report", help="folder of the page")


def report(options: argparse.Namespace) -> int:
    """Write a page with the results of several output folders.

    Raises:
        SceneError: a folder holds no such results.
        OSError: a file cannot be written.
    """
    from fenicsrom.post.studies.folders_report import write

    table, files = write([Path(folder) for folder in options.folders], target(options.output))
    print_results(None, table, [], files=files)
    return 0


COMMAND = Command(
    "report",
    "compare the results of several output folders on one page",
    report,
    (FOLDERS, OUTPUT),
)

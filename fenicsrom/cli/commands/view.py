"""`fenicsrom view`: open a report in the browser."""

import argparse
import webbrowser
from pathlib import Path

from fenicsrom.cli.arguments import Argument, command
from fenicsrom.errors import refuse

FOLDER = Argument("folder", help="output folder of a command")


@command("open the report of an output folder in the browser", FOLDER)
def view(options: argparse.Namespace) -> int:
    """Open the report of an output folder, or print its address where no browser is.

    Raises:
        SceneError: the folder has no report.
    """
    page = Path(options.folder).resolve() / "report.html"
    if not page.is_file():
        raise refuse(options.folder, "has no report.html: give the output folder of a command")
    address = f"{page.as_uri()}#body"
    if not webbrowser.open(address):
        print(address)
    return 0

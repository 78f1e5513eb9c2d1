"""`fenicsrom cache`, `schema`, `view` and `report`: what needs no scene."""

import argparse
import json
import webbrowser
from pathlib import Path

from fenicsrom.cli.arguments import FILE, Argument, command, refused
from fenicsrom.cli.output import target
from fenicsrom.cli.printing import print_results
from fenicsrom.errors import ErrorKind, refuse
from fenicsrom.scene import json_schema
from fenicsrom.words import counted

CLEAR = Argument("--clear", action="store_true", help="remove all results")


@command("show the results that later runs use again, or remove them", CLEAR)
def cache(options: argparse.Namespace) -> int:
    """Show the cache of results, or empty it."""
    from fenicsrom.online.store import store as result_cache

    folder = result_cache.cache_folder()
    if folder is None:
        print(f"{result_cache.VARIABLE} = {result_cache.OFF}: results are not kept")
        return 0
    if options.clear:
        print(f"{counted(result_cache.clear(folder), 'file')} removed from {folder}")
        return 0
    found = result_cache.entries(folder)
    size = sum(entry.size for entry in found)
    print(
        f"{folder}: {counted(len(found), 'file')}, {size / 1e6:.1f} MB of at most "
        f"{result_cache.LIMIT / 1e6:.0f} MB; the oldest are removed first"
    )
    return 0


@command("print the JSON schema of scene files, for editors", FILE)
def schema(options: argparse.Namespace) -> int:
    """Print or write the JSON schema of scene files."""
    text = json.dumps(json_schema(), indent=2, ensure_ascii=False)
    if options.output is None:
        print(text)
        return 0
    from fenicsrom.post.base.tables import write_text

    write_text(target(options.output), text + "\n")
    return 0


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


FOLDERS = Argument(
    "folders", nargs="+", help="output folders of run, response and backbone, in their order"
)
PAGE = Argument("--output", metavar="DIR", default="out/report", help="folder of the page")


@command("compare the results of several output folders on one page", FOLDERS, PAGE)
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

"""`fenicsrom cache`: show the cache of results, or empty it."""

import argparse

from fenicsrom.cli.arguments import Argument, command
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

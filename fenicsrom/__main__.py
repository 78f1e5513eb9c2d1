"""`python3 -m fenicsrom`: the same as the command `fenicsrom`."""

import sys

from fenicsrom.cli.supervision import run

if __name__ == "__main__":
    sys.exit(run())

"""`python3 -m fenicsrom`: the same as the command `fenicsrom`."""

import sys

from fenicsrom.cli import main

if __name__ == "__main__":
    sys.exit(main())

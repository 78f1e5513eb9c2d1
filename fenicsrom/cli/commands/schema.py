"""`fenicsrom schema`: print or write the JSON schema of scene files."""

from __future__ import annotations

import argparse
import json
from pathlib import Path

from fenicsrom.cli.arguments import FILE, Command
from fenicsrom.cli.output import require_lasting
from fenicsrom.scene import json_schema


def schema(options: argparse.Namespace) -> int:
    """Print or write the JSON schema of scene files."""
    text = json.dumps(json_schema(), indent=2, ensure_ascii=False)
    if options.output is None:
        print(text)
        return 0
    from fenicsrom.files import atomic_write

    require_lasting(Path(options.output))
    with atomic_write(options.output) as temporary:
        temporary.write_text(text + "\n", encoding="utf-8")
    return 0


COMMAND = Command("schema", "print the JSON schema of scene files, for editors", schema, (FILE,))

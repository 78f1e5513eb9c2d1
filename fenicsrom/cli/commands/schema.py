"""`fenicsrom schema`: print or write the JSON schema of scene files."""

import argparse
import json

from fenicsrom.cli.arguments import FILE, command
from fenicsrom.cli.output import target
from fenicsrom.scene import json_schema


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

"""`fenicsrom stability`: run extreme or random variants of a scene."""

import argparse
from pathlib import Path

from fenicsrom import study
from fenicsrom.cli.arguments import RESULTS, SCENE, Argument, command, refused
from fenicsrom.cli.output import opened
from fenicsrom.cli.printing import finish
from fenicsrom.errors import ErrorKind
from fenicsrom.scene import read_scene


def natural(text: str) -> int:
    """Read a whole number of at least 0.

    Raises:
        ValueError: the text is not a whole number of at least 0.
    """
    number = int(text)
    if number < 0:
        raise ValueError(text)
    return number


AXIS = Argument(
    "--axis",
    action="append",
    default=[],
    metavar="NAME",
    help="run this axis only, such as friction; may be repeated",
)
RANDOM = Argument(
    "--random",
    type=natural,
    default=0,
    metavar="N",
    help="run N random variants instead of the axes, and compare them with the full model",
)
SEED = Argument(
    "--seed", type=natural, default=0, metavar="S", help="seed of the random variants (default: 0)"
)


@command(
    "run extreme or random variants of a scene, with a verdict on each",
    SCENE,
    AXIS,
    RANDOM,
    SEED,
    *RESULTS,
)
def stability(options: argparse.Namespace) -> int:
    """Run extreme or random variants of a scene.

    Raises:
        SceneError: --axis and --random are given together.
    """
    from fenicsrom.assess.studies.stability import Verdict

    if options.random and options.axis:
        reason = "not allowed with --axis, because random variants are not on an axis"
        raise refused("--random", options.random, reason, ErrorKind.CONFLICT)
    with opened(options, read_scene(options.scene, options.overrides)) as folder:
        found = study.stability(
            Path(options.scene),
            options.overrides,
            axes=options.axis,
            variants=options.random,
            seed=options.seed,
            folder=folder,
        )
        finish(found, None)
    return 1 if found.count(Verdict.WRONG) else 0

"""The table of commands, and the parser that it makes.

A new command is one row of `COMMANDS` and one function in `commands`.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from fenicsrom import __version__
from fenicsrom.cli import commands, exchange_commands, mesh_commands


def natural(text: str) -> int:
    """Read a whole number of at least 0.

    Raises:
        ValueError: the text is not such a number.
    """
    number = int(text)
    if number < 0:
        raise ValueError(text)
    return number


class Argument:
    """An argument of a command, as `ArgumentParser.add_argument` takes it."""

    def __init__(self, *names: str, **settings: Any):
        """Keep the names and the settings."""
        self.names = names
        self.settings = settings


@dataclass(frozen=True)
class Command:
    """One command.

    Attributes:
        name: its name.
        help: what it does, in one line.
        run: does it, and returns the exit code.
        arguments: its arguments.
    """

    name: str
    help: str
    run: Callable[[argparse.Namespace], int]
    arguments: tuple[Argument, ...]


SCENE = Argument("scene", help="scene file (TOML)")
SCENE_OR_MODEL = Argument("scene", nargs="?", help="scene file (TOML)")
COMPARED_SCENE = Argument("scene", help="scene file (TOML); its [compare] table lists the bases")
TURNING_SCENE = Argument(
    "scene", help="scene file (TOML) with a [rotation] table; its [campbell] table gives the speeds"
)
RESPONDING_SCENE = Argument(
    "scene",
    nargs="?",
    help="scene file (TOML); its [response] table gives the parameter and its range",
)
SWINGING_SCENE = Argument(
    "scene",
    nargs="?",
    help="scene file (TOML); its [backbone] table gives the mode and the range of its amplitude",
)
LOADED_SCENE = Argument(
    "scene",
    help="scene file (TOML) with static loads; its [statics] table gives the range of their factor",
)
FROM = Argument(
    "--from",
    dest="stored",
    metavar="MODEL",
    help="use the reduced_model.npz of an earlier run, without a mesh and dolfinx",
)
RESUME = Argument(
    "--resume",
    metavar="CHECKPOINT",
    help="continue the reduced model from the checkpoint.npz of an earlier run",
)
RESUME_CURVES = Argument(
    "--resume",
    metavar="STATE",
    help="continue the curves from the folder response_state of an earlier run",
)
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
OVER = Argument(
    "--over",
    action="append",
    default=[],
    metavar="KEY=VALUES",
    help="values of a key of the scene: a list such as loads.0.force=[50, 100], or a range "
    "FIRST:LAST:COUNT, with :log in equal ratios; all combinations run; may be repeated",
)
ZIP = Argument(
    "--zip",
    action="append",
    default=[],
    metavar="KEY=VALUES",
    dest="together",
    help="the same, but all keys of --zip change together; may be repeated",
)
RESUME_SWEEP = Argument(
    "--resume",
    action="store_true",
    help="keep the results of the same runs in the output folder, and compute only the others",
)
SET = Argument(
    "--set",
    action="append",
    default=[],
    metavar="KEY=VALUE",
    dest="overrides",
    help="change a value of the scene, such as loads.0.force=200; put text in quotes; "
    "may be repeated",
)
PICTURE = Argument(
    "--picture",
    metavar="FILE",
    help="make the mesh, and draw it undeformed with its supports, loads and contacts to this "
    "PNG file",
)
OUTPUT = Argument("--output", metavar="DIR", help="output folder (default: out/NAME of the scene)")
FORCE = Argument(
    "--force", action="store_true", help="replace the results of another run in the output folder"
)
FRESH = Argument(
    "--fresh",
    action="store_true",
    help="compute modes and reduced model again, also where an earlier run left them in the cache",
)
CLEAR = Argument("--clear", action="store_true", help="remove all results")
MESH = Argument("mesh", help="mesh or geometry file")
DENSITY = Argument("--density", metavar="NUMBER", help="density in kg/m³, for the mass")
SCALE = Argument("--scale", metavar="NUMBER", help="unit of the coordinates in m, such as 1e-3")
SIZE = Argument("--size", metavar="NUMBER", help="cell size in m, for a .step file")
UNITS = Argument(
    "--units",
    metavar="LENGTH,MASS,TIME",
    help="units of file and scene, such as mm,t,s; by default guessed from the material",
)
ROOT = Argument("--root", metavar="GROUP", help="group or number of the face to clamp")
TIP = Argument(
    "--tip", metavar="GROUP", help="group or number of the face with the load or contact"
)
TEMPLATE = Argument(
    "--template",
    choices=("response", "rub", "damper", "statics"),
    default="response",
    help="task of the scene: a response at the first mode (default), with a stop that it rubs "
    "against, with a friction damper, or a static load",
)
FILE = Argument("--output", metavar="FILE", help="write it to this file")
MODEL = Argument("model", help="the reduced_model.npz of an earlier run; for inp a scene file")
FORMAT = Argument(
    "--format",
    required=True,
    choices=("mat", "jax", "fmu", "dmig", "op4", "inp"),
    help="mat (MATLAB and Octave), jax (a Python module) and fmu (a Functional Mock-up Unit) hold "
    "the nonlinear model; dmig and op4 "
    "(Nastran) hold its linear part; inp is the CalculiX deck of a scene",
)
MATRICES = Argument("matrices", help="file of the matrices: .op4, .bdf, .pch, .mtx, .mat or .npz")
INTERFACE_SCENE = Argument(
    "--scene",
    required=True,
    dest="superelement_scene",
    metavar="SCENE",
    help="scene file (TOML) with the tables [superelement] and [[nodes]]",
)

COMMANDS = (
    Command(
        "run",
        "run a scene, or integrate a stored reduced model again",
        commands.run,
        (SCENE_OR_MODEL, FROM, RESUME, SET, FRESH, OUTPUT, FORCE),
    ),
    Command(
        "plan",
        "list the stages of a scene: which ones run, which ones are left out, and why",
        commands.plan,
        (SCENE, SET, PICTURE),
    ),
    Command(
        "modes",
        "compute only the modes and modal derivatives, for ParaView",
        commands.modes,
        (SCENE, SET, OUTPUT, FORCE),
    ),
    Command(
        "inspect",
        "describe a mesh file: cells, box, volume, mass, groups and what is not read",
        mesh_commands.inspect,
        (MESH, DENSITY, SCALE, SIZE, OUTPUT),
    ),
    Command(
        "init",
        "write a starter scene for a mesh file",
        mesh_commands.init,
        (MESH, SCALE, SIZE, UNITS, ROOT, TIP, TEMPLATE, FILE),
    ),
    Command(
        "compare",
        "compare reduced bases with the full model: error and run time",
        commands.compare,
        (COMPARED_SCENE, SET, OUTPUT, FORCE),
    ),
    Command(
        "campbell",
        "compute a Campbell diagram: frequencies and critical speeds",
        commands.campbell,
        (TURNING_SCENE, SET, OUTPUT, FORCE),
    ),
    Command(
        "response",
        "follow periodic motions over a parameter: response curves and stability",
        commands.response,
        (RESPONDING_SCENE, FROM, RESUME_CURVES, SET, FRESH, OUTPUT, FORCE),
    ),
    Command(
        "backbone",
        "follow a damped nonlinear mode: frequency and damping ratio against amplitude",
        commands.backbone,
        (SWINGING_SCENE, FROM, SET, FRESH, OUTPUT, FORCE),
    ),
    Command(
        "statics",
        "follow static equilibria over a load factor, through limit points (snap-through)",
        commands.statics,
        (LOADED_SCENE, SET, OUTPUT, FORCE),
    ),
    Command(
        "sweep",
        "run a scene or a stored model for lists or ranges of values of its keys",
        commands.sweep,
        (SCENE_OR_MODEL, FROM, OVER, ZIP, RESUME_SWEEP, SET, FRESH, OUTPUT, FORCE),
    ),
    Command(
        "export",
        "write a stored reduced model for MATLAB, Nastran or jax, or a scene for CalculiX",
        exchange_commands.export,
        (MODEL, FORMAT, SET, FILE),
    ),
    Command(
        "import",
        "make a reduced model of the matrices of a linear superelement",
        exchange_commands.import_matrices,
        (MATRICES, INTERFACE_SCENE, FILE),
    ),
    Command(
        "cache",
        "show the results that later runs use again, or remove them",
        commands.cache,
        (CLEAR,),
    ),
    Command(
        "schema",
        "print the JSON schema of scene files, for editors",
        commands.schema,
        (FILE,),
    ),
    Command(
        "stability",
        "run extreme or random variants of a scene, with a verdict on each",
        commands.stability,
        (SCENE, AXIS, RANDOM, SEED, SET, OUTPUT, FORCE),
    ),
)


def make_parser() -> argparse.ArgumentParser:
    """Make the parser of the command line."""
    parser = argparse.ArgumentParser(
        prog="fenicsrom",
        description="Reduced-order models of geometrically nonlinear structures with friction.",
    )
    parser.add_argument("--version", action="version", version=f"fenicsrom {__version__}")
    subparsers = parser.add_subparsers(required=True, metavar="COMMAND")
    for command in COMMANDS:
        subparser = subparsers.add_parser(command.name, help=command.help)
        for argument in command.arguments:
            subparser.add_argument(*argument.names, **argument.settings)
        subparser.set_defaults(command=command.run, name=command.name)
    return parser

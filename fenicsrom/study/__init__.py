"""The stages of a scene, from the mesh to the report, and the runs of a stored model.

`scene_stages` says what a scene needs, `execution` runs it. The work of a stage stands in
`building` (mesh to reduced model), `motions` (integration and checks) or `writing` (files).
`output_folder` guards the folder of the files. `offline_cache` keeps the results up to the reduced
model for later runs: `offline_key` says what they depend on, `result_cache` guards the folder, and
`late_solid` builds a solid only where one is needed. `stored` integrates a stored model again,
`curves` computes response curves, `backbones` computes nonlinear modes, and `sweeps` runs a scene
or a stored model for many values of its keys.
"""

from fenicsrom.study.backbones import backbone, backbone_of_model
from fenicsrom.study.curves import response, response_of_model
from fenicsrom.study.execution import build_model, execute, offline, run, setup_picture
from fenicsrom.study.motions import check
from fenicsrom.study.output_folder import output_folder
from fenicsrom.study.scene_stages import plan, stages
from fenicsrom.study.stage import Item, Run, Stage
from fenicsrom.study.stopwatch import Stopwatch, never
from fenicsrom.study.stored import rerun
from fenicsrom.study.sweeps import sweep

__all__ = [
    "Item",
    "Run",
    "Stage",
    "Stopwatch",
    "backbone",
    "backbone_of_model",
    "build_model",
    "check",
    "execute",
    "never",
    "offline",
    "output_folder",
    "plan",
    "rerun",
    "response",
    "response_of_model",
    "run",
    "setup_picture",
    "stages",
    "sweep",
]

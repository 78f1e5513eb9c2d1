"""The stages of a scene, from the mesh to the report, and the runs of a stored model.

`scene_stages` says what a scene needs, `execution` runs it. The work of a stage stands in
`building` (mesh to reduced model), `motions` (integration and checks) or `writing` (files).
`forecast` says what a run will cost. `output_folder` guards the folder of the files.
`offline_cache` keeps the results up to the reduced model for later runs: `offline_key` says what
they depend on. `stored` integrates a stored model again, `curves` computes response curves,
nonlinear modes and maps, and `sweeps` runs a scene or a stored model for many values of its keys;
both start from a `source`. `analyses` holds what needs no reduced model of its own.
"""

from fenicsrom.study.analyses import campbell, compare, modes, nodal_diameters, stability, statics
from fenicsrom.study.curves import backbone, interaction_map, response, ringdown
from fenicsrom.study.execution import build_disk, build_model, run, run_disk
from fenicsrom.study.forecast import forecast, refusal_of, require_usable, set_up
from fenicsrom.study.motions import check
from fenicsrom.study.output_folder import output_folder
from fenicsrom.study.scene_stages import plan
from fenicsrom.study.stage import Stage
from fenicsrom.study.stored import integrate, rerun
from fenicsrom.study.sweeps import run_sweep, sweep

"""A group that a scene names and the mesh lacks is refused with the key of the scene."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from mpi4py import MPI
from support import refusal

from fenicsrom.errors import ErrorKind
from fenicsrom.fem.mesh.mesh import build_mesh
from fenicsrom.fem.mesh.named_groups import require_groups
from fenicsrom.scene import make_scene
from tests.boxes import stacked

PAIR = {"normal_stiffness": 1e14, "tangential_stiffness": 5e13, "friction": 0.3}
TABLES: dict[str, Any] = {
    "materials[0].group": [{"group": "no", "young": 1e9, "poisson": 0.3, "density": 1e3}],
    "supports[0].group": [{"group": "no"}],
    "attachments[0].group": [{"group": "no", "stiffness": 1.0}],
    "attachments[0].to.group": [{"group": "1 high x", "to": {"group": "no"}, "stiffness": 1.0}],
    "contacts[0].group": [{"group": "no", "against": "0 high y", **PAIR}],
    "contacts[0].against": [{"group": "1 low y", "against": "no", **PAIR}],
    "bolts[0].head": [{"head": "no", "nut": "0 low y", "force": 1.0}],
    "bolts[0].nut": [{"head": "1 high y", "nut": "no", "force": 1.0}],
    "ties[0].group": [{"group": "no", "against": "0 high x"}],
    "ties[0].against": [{"group": "1 high x", "against": "no"}],
    "loads[0].group": [{"group": "no", "pressure": 1.0}],
    "probe.group": {"group": "no"},
}


def test_missing_group_names_the_key_and_the_groups_of_the_mesh(tmp_path: Path) -> None:
    mesh, found = stacked(tmp_path / "two.vtu", 2, 3, 2), None
    for key, table in TABLES.items():
        scene = make_scene(
            **{
                "geometry": {"mesh": str(mesh), "dimension": 2, "thickness": 1.0},
                "material": {"young": 1e9, "poisson": 0.3, "density": 1e3},
                "supports": [{"group": "0 low y"}],
                "contacts": [{"group": "1 low y", "against": "0 high y", **PAIR}],
                "loads": [{"group": "1 high y", "pressure": 1.0}],
                "time": {"duration": 1.0, "step": 0.1},
            }
            | {key.split(".")[0].split("[")[0]: table}
        )
        found = found or build_mesh(scene.geometry, MPI.COMM_SELF)
        names = "solid" if key.startswith("materials") else "0 high x, 0 high y"
        with refusal(ErrorKind.PLACE, key, names=names):
            require_groups(found, scene)

"""What to compute: scenes read from TOML or made in Python, checked and completed."""

from fenicsrom.scene.attachments import Attachment
from fenicsrom.scene.backbone import Backbone
from fenicsrom.scene.checks import FEW_CONTACTS, INTERFACE_MODES
from fenicsrom.scene.damping import Damping
from fenicsrom.scene.headings import scene_heading, titled
from fenicsrom.scene.json_schema import json_schema
from fenicsrom.scene.loads import (
    Acceleration,
    Action,
    Harmonic,
    Harmonics,
    History,
    Load,
    PointForce,
    Pressure,
    Pulse,
    PulseTable,
    Static,
    SupportAcceleration,
    SupportDisplacement,
    Sweep,
    SweepTable,
    Table,
    Traction,
)
from fenicsrom.scene.materials import Elasticity, GroupMaterial, Material
from fenicsrom.scene.overrides import Overrides, override_table, override_texts
from fenicsrom.scene.places import Place, Plane, Region, Support
from fenicsrom.scene.reading import make_scene, parse_scene, read_scene, scene_table
from fenicsrom.scene.response import Families, Parameter, Response, parameter_of
from fenicsrom.scene.schema import (
    Basis,
    BeamSection,
    Campbell,
    Compare,
    Contact,
    Geometry,
    Output,
    Reference,
    Rotation,
    Scene,
    Surface,
)
from fenicsrom.scene.statics import Statics
from fenicsrom.scene.times import (
    Duration,
    EquilibriumOnly,
    FixedStep,
    NoStep,
    Periodic,
    StepsPerPeriod,
    Time,
    Tolerance,
)
from fenicsrom.scene.writing import toml_text

__all__ = [
    "FEW_CONTACTS",
    "INTERFACE_MODES",
    "Acceleration",
    "Action",
    "Attachment",
    "Backbone",
    "Basis",
    "BeamSection",
    "Campbell",
    "Compare",
    "Contact",
    "Damping",
    "Duration",
    "Elasticity",
    "EquilibriumOnly",
    "Families",
    "FixedStep",
    "Geometry",
    "GroupMaterial",
    "Harmonic",
    "Harmonics",
    "History",
    "Load",
    "Material",
    "NoStep",
    "Output",
    "Overrides",
    "Parameter",
    "Periodic",
    "Place",
    "Plane",
    "PointForce",
    "Pressure",
    "Pulse",
    "PulseTable",
    "Reference",
    "Region",
    "Response",
    "Rotation",
    "Scene",
    "Static",
    "Statics",
    "StepsPerPeriod",
    "Support",
    "SupportAcceleration",
    "SupportDisplacement",
    "Surface",
    "Sweep",
    "SweepTable",
    "Table",
    "Time",
    "Tolerance",
    "Traction",
    "json_schema",
    "make_scene",
    "override_table",
    "override_texts",
    "parameter_of",
    "parse_scene",
    "read_scene",
    "scene_heading",
    "scene_table",
    "titled",
    "toml_text",
]

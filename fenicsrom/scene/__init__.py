"""What to compute: scenes read from TOML or made in Python, checked and completed.

Imports run one way, between the packages and modules of this one too:

    base < keys < checks < reading < json_schema < reference
"""

from fenicsrom.scene.base.tables import toml_text
from fenicsrom.scene.json_schema import json_schema
from fenicsrom.scene.keys.contacts import Abradable, Bolt, Contact, Surface, Tie
from fenicsrom.scene.keys.curves import (
    Backbone,
    Families,
    Parameter,
    Response,
    Statics,
    parameter_of,
)
from fenicsrom.scene.keys.loads import (
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
from fenicsrom.scene.keys.places import (
    Attachment,
    Damping,
    Elasticity,
    GroupMaterial,
    Material,
    Place,
    Plane,
    Region,
    Support,
)
from fenicsrom.scene.keys.rotation import Cyclic, Rotation
from fenicsrom.scene.keys.schema import (
    Basis,
    BeamSection,
    Campbell,
    Compare,
    Geometry,
    Output,
    Reference,
    Scene,
)
from fenicsrom.scene.keys.times import (
    Duration,
    EquilibriumOnly,
    FixedStep,
    NoStep,
    Periodic,
    StepsPerPeriod,
    Time,
    Tolerance,
)
from fenicsrom.scene.reading.overrides import Overrides, override_table, override_texts
from fenicsrom.scene.reading.reading import (
    make_scene,
    parse_scene,
    read_scene,
    scene_heading,
    scene_table,
    titled,
)

"""Mistakes in the tables of a scene: each is refused with its kind and its key."""

from __future__ import annotations

import pytest
from support import beam_scene, refusal

from fenicsrom.errors import ErrorKind

BARE = "contacts=[] & probe={group='tip'}"
WITHOUT_TIMES = f"{BARE} & loads=[{{group='load', direction=[0, 1], force=1}}]"
SWEPT = f"{WITHOUT_TIMES} & loads.0.frequency=2 & loads.0.sweep={{to=3, duration=1}}"
CURVE = f"{BARE} & response.first=0.14 & response.last=0.19"
PLY = "young=[40e9, 10e9, 9e9], poisson=[0.3, 0.28, 0.4], density=1800"
SPRINGS = "friction=0.1, normal_stiffness=1, tangential_stiffness=1"
PAIR = f"group='tip', against='load', {SPRINGS}"
BOXED = f"box=[[0.9, 0], [1, 1]], against={{box=[[0.9, 0], [1, 1]]}}, {SPRINGS}"
SECTION = "{length=1, height=0.1, width=0.1, load_at=0.5}"
ROUND = f"group='tip', gap=1e-4, {SPRINGS}, surface={{kind='cylinder', point=[0, 0]}}"
DECAY = f"{BARE} & loads=[{{node=[1, 0], direction=[0, -3], force=2}}] & basis.modes=2"
DECAY += " & basis.derivatives=['1V1V', '1V2V'] & basis.method='craig-bampton'"
DECAY += " & time={duration=1.0, step=1e-3}"
LAYER = "thickness=5e-3, modulus=5e8, yield_stress=1e6, hardening=5e7, area=3e-5, width=1"

MISTAKES = {
    "geometrically_nonlinear=true": """
        UNKNOWN_KEY materal                      materal={}
        UNKNOWN_KEY contacts[0].frction          contacts.0.frction=0.3
        TYPE     material.young               material.young="207e9"
        TYPE     material.young               material.young=true
        TYPE     basis.modes                  basis.modes=3.0
        TYPE     output.pictures              output.pictures=1
        TYPE     title                        title=1979-05-27
        TYPE     geometry                     geometry=3
        TYPE     loads[0]                     loads=[1]
        TYPE     supports[0].group            supports.0.group=7
        RANGE    supports[0].group            supports.0.group=" "
        RANGE    material.density             material.density=nan
        RANGE    loads[0].force               loads.0.force=inf
        TYPE     contacts[0].normal           contacts.0.normal=[nan, 1]
        RANGE    geometry.parameters.length   geometry.parameters.length=nan
        RANGE    material.young               material.young=0
        RANGE    material.poisson             material.poisson=0.5
        RANGE    material.poisson             material.poisson=-0.1
        RANGE    material.mass_damping        material.mass_damping=-1
        RANGE    contacts[0].normal_stiffness contacts.0.normal_stiffness=-1
        RANGE    contacts[0].tangential_stiffness contacts.0.tangential_stiffness=0
        RANGE    contacts[0].friction         contacts.0.friction=-0.1
        RANGE    contacts[0].gap              contacts.0.gap=-1
        RANGE    loads[0].frequency           loads.0.frequency=0
        RANGE    basis.modes                  basis.modes=-1
        RANGE    basis.threshold              basis.threshold=1.5
        RANGE    time.steps_per_period        time.steps_per_period=3
        RANGE    geometry.thickness           geometry.thickness=0.0
        RANGE    basis.method                 basis.method="macneal"
        RANGE    time.scheme                  time.scheme="euler"
        RANGE    contacts[0].normal           contacts.0.normal=[0.0, 0]
        RANGE    loads[0].direction           loads.0.direction=[0, 0, 0]
        CONFLICT loads[0].direction           loads.0.direction=[0, 0, 1]
        CONFLICT probe.node                   probe.node=[0, 1, 0]
        TYPE     loads[0].direction           loads.0.direction=[1]
        CONFLICT loads[0].node                loads.0.node=[1, 0]
        MISSING  probe.group                  probe={}
        CONFLICT probe.at                     probe={node=[1, 0], at="centre"}
        TYPE     supports                     supports=3
        CONFLICT geometry.thickness           geometry.dimension=3
        CONFLICT geometry.parameters.structured geometry.parameters.structured=1
        RANGE    geometry.parameters.a;b      geometry.parameters={"a;b"=1}
        RANGE    basis.derivatives            basis.derivatives="some"
        RANGE    basis.derivatives[0]         basis.derivatives=["1X1V"]
        RANGE    basis.derivatives[0]         basis.derivatives=["0V1V"]
        RANGE    basis.derivatives[0]         basis.derivatives=["1V1V1V"]
        RANGE    basis.derivatives[0]         basis.derivatives=["1v1v"]
        RANGE    basis.derivatives[0]         basis.derivatives=["1V1V\\n"]
        TYPE     basis.derivatives[0]         basis.derivatives=[11]
        CONFLICT basis.derivatives[0]         basis.derivatives=["1V4V"]
        CONFLICT basis.derivatives[0]         basis.derivatives=["1V3S"]
        CONFLICT basis.derivatives[1]         basis={modes=0, derivatives=["1S1S", "1V1S"]}
        RANGE    basis.derivatives[1]         basis.derivatives=["1V1S", "1S1V"]
        CONFLICT time.tolerance               time={tolerance=1e-4, steps_per_period=100}
        CONFLICT time.duration                time.duration=1.0
        CONFLICT time.spectral_radius         time.spectral_radius=0.5
        MISSING  reference.beam_section       reference.beam=true
        MISSING  reference.beam_section.length reference.beam_section={}
        CONFLICT loads[0].at                  loads.0.at="nodes"
        CONFLICT probe.at                     probe={group="tip", at="nodes"}
        RANGE    basis.masters                basis.masters="tangents"
        CONFLICT basis.derivatives[0]         basis={masters='normal', derivatives=['1V2S']}
        RANGE    material.young               material.young=1e300
        RANGE    loads[0].force               loads.0.force=-1e300
        RANGE    rotation.speed_rpm           rotation={speed_rpm=1e300}
        RANGE    rotation.point               rotation={speed_rpm=1, point=[1e300, 0]}
        MISSING  probe                      contacts=[] & loads=[{direction=[0, 1], acceleration=1}]
        RANGE    basis.modes                  basis.modes='all'
        TYPE     basis.modes                  basis.modes=1.5
        RANGE    compare.meshes[0]            compare.meshes=["material.young=1.0"]
        RANGE    compare.modes[1]             compare.modes=[1, 1]
        RANGE    compare.methods[0]           compare.methods=["guyan"]
        RANGE    damping.ratios               damping.ratios=-0.1
        TYPE     damping.ratios[1]            damping.ratios=[0.1, "x"]
        RANGE    damping.ratios[1]            damping.ratios=[0.1, 2.0]
        RANGE    output.stresses              output.stresses='piola'
        TYPE     output.stresses              output.stresses=true
        CONFLICT supports[0].components[0]    supports.0.components=["z"]
        RANGE    statics.loads[0]             statics.loads=[1]
        CONFLICT statics.loads[0]             statics.loads=[0]
        RANGE    statics.last                 statics.last=0.0
        RANGE    statics.lowest               statics.lowest=0.5
        CONFLICT rotation.point               rotation={speed_rpm=1, point=[0, 1, 0]}
    """,
    "supports.0.normal=[1, 0]": """
        CONFLICT supports[0].normal           supports.0.components=["y"]
    """,
    "attachments=[{group='tip', mass=1}]": """
        MISSING  attachments[0].mass          attachments.0={group='tip'}
        MISSING  attachments[0].group         attachments.0={mass=1}
        RANGE    attachments[0].damping       attachments.0.damping=-1
        CONFLICT attachments[0].stiffness_per_area attachments.0={node=[1, 0], stiffness_per_area=1}
        CONFLICT attachments[0].damping_per_area attachments.0={node=[1, 0], damping_per_area=1}
        CONFLICT attachments[0].mass          attachments.0.to={group='load'}
    """,
    "attachments=[{group='tip', at='centre', mass=1}]": """
        CONFLICT attachments[0].stiffness_per_area attachments.0.stiffness_per_area=1
    """,
    "attachments=[{group='tip', stiffness=1, to={group='load'}}]": """
        CONFLICT attachments[0].stiffness_per_area attachments.0.stiffness_per_area=1
        CONFLICT attachments[0].to            attachments.0.to={group='tip'}
    """,
    f"reference={{beam=true, beam_section={SECTION}}}": """
        CONFLICT reference.beam               rotation={speed_rpm=1}
    """,
    "rotation.speed_rpm=100.0": """
        TYPE     campbell.speeds_rpm          campbell.speeds_rpm=[0.0]
        RANGE    campbell.speeds_rpm[2]       campbell.speeds_rpm=[0.0, 100.0, 100.0]
        RANGE    campbell.speeds_rpm.last     campbell.speeds_rpm={first=9, last=9, number=3}
        RANGE    campbell.engine_orders[1]    campbell.engine_orders=[1, 1]
    """,
    BARE: """
        MISSING  loads[0].force               loads=[{group='tip', direction=[0, -1]}]
        CONFLICT loads[0].node                loads=[{node=[1, 0], pressure=1}]
        CONFLICT loads[0].acceleration        loads=[{direction=[0, 1], traction=1, acceleration=1}]
        CONFLICT loads[0].traction            loads=[{direction=[0, 1], force=1, traction=1}]
        CONFLICT loads[0].frequency           loads=[{pressure=1, frequency=2, pulse={duration=1}}]
    """,
    f"{BARE} & loads=[{{group='tip', direction=[0, -1], traction=1}}]": """
        CONFLICT loads[0].follower            loads.0.follower=true
    """,
    f"{BARE} & loads=[{{direction=[0, 1], support_acceleration=1, frequency=3}}]": """
        CONFLICT loads[0].support_acceleration loads.0={direction=[0, 1], support_acceleration=1}
        CONFLICT loads[0].support_displacement loads.0={direction=[0, 1], support_displacement=1}
        CONFLICT loads[0].support_acceleration rotation.speed_rpm=60
    """,
    f"{BARE} & loads=[{{group='tip', pressure=1e5, follower=true, frequency=3}}]": """
        CONFLICT loads[0].follower            geometrically_nonlinear=false
        CONFLICT loads[0].follower            basis.elastic_force='projection'
        CONFLICT output.stresses              output.stresses='cauchy'
    """,
    f"{WITHOUT_TIMES} & time={{duration=1.0, step=1e-3}}": """
        RANGE    loads[0].table[1]            loads.0.table=[[0, 1], [0, 2]]
        TYPE     loads[0].table[1]            loads.0.table=[[0, 1], 3]
        MISSING  loads[0].frequency           loads.0.sweep={to=3, duration=1}
        RANGE    loads[0].pulse.duration      loads.0.pulse={duration=0}
        MISSING  loads[0].sweep.duration      loads.0.frequency=2 & loads.0.sweep={to=3}
        MISSING  time.duration                time={step=0.1}
    """,
    f"{WITHOUT_TIMES} & time={{duration=1.0, step=1e-3}} & loads.0.pulse={{duration=1}}": """
        CONFLICT response.parameter           response={first=1, last=2}
    """,
    f"{SWEPT} & time={{duration=1.0, step=1e-3}}": """
        CONFLICT time.periods                 time={periods=3}
        MISSING  time.duration                time={step=1e-3}
        CONFLICT time.step                    time.step=0.1
    """,
    "loads.0.harmonics=[[1, 1, 0]]": """
        RANGE    loads[0].harmonics[0][0]     loads.0.harmonics=[[0, 1, 0]]
        TYPE     loads[0].harmonics[0]        loads.0.harmonics=[[1, 1]]
        CONFLICT loads[0].phase               loads.0.phase=1
    """,
    f"material={{{PLY}, shear=[4e9, 4e9, 3e9]}}": f"""
        MISSING  material.shear               material={{{PLY}}}
        CONFLICT material.poisson             material.poisson=0.3
        RANGE    material.poisson             material.poisson=[0.3, 0.9, 1.02]
        CONFLICT material.axes[0]             material.axes=[[1, 0, 0]]
    """,
    CURVE: """
        RANGE    response.parameter           response.parameter="geometry.thickness"
        RANGE    response.parameter           response.parameter="contacts.0.preload"
        CONFLICT response.parameter           response.parameter="loads.0.pressure"
        RANGE    response.last                response.last=0.14
        RANGE    response.last                response.last=0.0
        RANGE    response.first               response.first=0.0
        RANGE    response.full[0]             response.full=[0.4]
        RANGE    response.full                response.full=0
        TYPE     response.full                response.full='all'
        RANGE    response.isolated            response.isolated=[0.05]
        RANGE    response.isolated            response.isolated=[0.4]
        RANGE    response.peak_over           response.peak_over="loads.0.force"
        RANGE    response.peak_over           response.peak_over="contacts.0.preload"
        TYPE     response.peak_over           response.peak_over=3
        CONFLICT response.peak_range          response.peak_range=[1, 2]
    """,
    f"{CURVE} & response.peak_over='material.mass_damping'": """
        RANGE    response.peak_range          response.peak_range=[1, 2]
        CONFLICT response.peak_over           response.parameter="loads.0.force"
    """,
    f"{BARE} & backbone.first=0.1 & backbone.last=3.0": """
        RANGE    backbone.last                backbone.last=0.1
        RANGE    backbone.first               backbone.first=0.0
        RANGE    backbone.mode                backbone.mode=0
        RANGE    backbone.load_factors        backbone.load_factors=[2.0, 1.0]
    """,
    f"contacts=[{{{PAIR}}}] & bolts=[{{head='root', nut='tip', force=1}}]": f"""
        CONFLICT basis.masters                basis.masters=5
        CONFLICT basis.method                 basis.method='craig-bampton'
        CONFLICT basis.derivatives            basis.derivatives='mmi'
        CONFLICT basis.elastic_force          basis.elastic_force='projection'
        CONFLICT time.tolerance               time.tolerance=1e-4
        CONFLICT bolts                        contacts=[] & probe={{group='tip'}}
        CONFLICT contacts[1].against          contacts=[{{{PAIR}}}, {{{PAIR}, reach=1}}]
        CONFLICT contacts[1].against          contacts=[{{{BOXED}}}, {{{BOXED}, reach=1}}]
    """,
    f"contacts.0={{{ROUND}, abradable={{{LAYER}}}}}": """
        CONFLICT contacts[0].preload          contacts.0.gap=0 & contacts.0.preload=1
        CONFLICT time.scheme                  time.scheme='generalised-alpha'
        RANGE    contacts[0].abradable        contacts.0.surface.spin=7
        CONFLICT response                     response={first=3, last=4}
    """,
    f"contacts.0={{{ROUND}}}": """
        CONFLICT contacts[0].gap              contacts.0.surface.radius=1.0
        CONFLICT contacts[0].normal           contacts.0.normal=[1.0, 0.0]
        RANGE    contacts[0].surface.kind     contacts.0.surface.kind="plane"
        CONFLICT contacts[0].surface.kind     contacts.0.surface.kind="sphere"
        CONFLICT contacts[0].surface.axis     contacts.0.surface.axis=[0, 1]
        CONFLICT contacts[0].surface.point    contacts.0.surface.point=[0, 0, 0]
        RANGE    contacts[0].surface.radius   contacts.0.surface.radius=0
        TYPE     contacts[0].surface.inside   contacts.0.surface.inside=1
        TYPE     contacts[0].surface.spin     contacts.0.surface.spin="fast"
        TYPE     contacts[0].surface.waves[0] contacts.0.surface.waves=[[2, 1e-4]]
        RANGE    contacts[0].surface.waves[0] contacts.0.surface.waves=[[1.5, 1e-4, 0]]
        TYPE     contacts[0].approach         contacts.0.approach=1e-3
        TYPE     contacts[0].approach[0]      contacts.0.approach=[[0, 0, 0]]
        RANGE    contacts[0].approach         contacts.0.approach=[[0, 0], [0, 1e-3]]
    """,
    DECAY: """
        CONFLICT loads[0].phase               loads.0.phase=1.0
        CONFLICT basis.modes                  basis.modes=0
        CONFLICT basis.derivatives[0]         basis.derivatives=["1S1V"]
        MISSING  time.duration                time={step=1.0}
        MISSING  time.step                    time={duration=1.0}
        CONFLICT time.step                    time.step=2.0
        CONFLICT time.steps_per_period        time.steps_per_period=10
        CONFLICT time.steady_tolerance        time.steady_tolerance=0
        CONFLICT basis.masters                basis.masters=3
    """,
    f"contacts.0={{group='tip', normal=[1, 0], {SPRINGS}}}": f"""
        MISSING  contacts[0].normal           contacts.0={{group='tip', {SPRINGS}}}
        CONFLICT contacts[0].at               contacts.0={{node=[1, 0], at='nodes', {SPRINGS}}}
    """,
}
"""Overrides of the paper's beam -> kind, key and overrides of each mistake."""

CASES = [
    (base, *line.split(maxsplit=2))
    for base, lines in MISTAKES.items()
    for line in lines.strip().splitlines()
]


@pytest.mark.parametrize("base", MISTAKES)
def test_scene_without_the_mistake_is_accepted(base: str) -> None:
    beam_scene(2, tuple(base.split(" & ")))


@pytest.mark.parametrize(("base", "kind", "key", "overrides"), CASES)
def test_mistake_is_refused_with_its_kind_and_key(
    base: str, kind: str, key: str, overrides: str
) -> None:
    with refusal(ErrorKind[kind], key):
        beam_scene(2, (*base.split(" & "), *overrides.split(" & ")))

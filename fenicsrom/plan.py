"""What a scene will compute, what it leaves out, and why."""

from __future__ import annotations

from dataclasses import dataclass

from fenicsrom.scene import Scene

STILL = "nothing moves: the equilibrium is all"
MOVING = (
    "normal modes",
    "static modes",
    "linear transient",
    "nonlinear statics",
    "modal derivatives",
    "elastic polynomial",
    "intrusive projection",
    "time integration",
    "full model",
    "beam model",
    "pictures",
    "ParaView modes",
    "ParaView motion",
)


@dataclass(frozen=True)
class Stage:
    """A stage, whether it runs, and the reason in a few words."""

    name: str
    runs: bool
    why: str


def plan(scene: Scene, modes_only: bool = False) -> list[Stage]:
    """The stages of a scene in their order; those of its modes are run for their own sake if they
    are all that is wanted.
    """
    if scene.static_only and not modes_only:
        return [
            Stage(stage.name, False, STILL) if stage.name in MOVING else stage
            for stage in plan(scene, True)
        ]
    basis, nonlinear, touching = scene.basis, scene.geometrically_nonlinear, bool(scene.contacts)
    by_motion = basis.derivatives in ("mmi", "mmi-nls")
    selecting = nonlinear and by_motion and not scene.static_only
    listed = nonlinear and not by_motion and basis.derivatives != "none"
    static = [load for load in scene.loads if load.static]
    d = scene.geometry.dimension
    rotation = scene.rotation
    linear = "the scene is geometrically linear"

    def derivative_reason() -> str:
        if not nonlinear:
            return linear
        if by_motion and scene.static_only:
            return STILL
        if basis.derivatives == "none":
            return "basis.derivatives is none"
        return "basis.derivatives is " + (
            basis.derivatives if isinstance(basis.derivatives, str) else "a list of labels"
        )

    def equilibrium_reason() -> str:
        loads = (
            f"{len(static)} static load{'s' * (len(static) > 1)}" if static else "no static load"
        )
        return f"{loads}, centrifugal force" if rotation else loads

    def gyroscopic_reason() -> str:
        return (
            f"rotation.coriolis is {str(rotation.coriolis).lower()}" if rotation else "no rotation"
        )

    def masters_reason() -> str:
        if not touching:
            return "no contact"
        if not isinstance(basis.masters, str):
            return f"interface modes, at most {basis.masters}"
        each = d if basis.masters == "all" else 1
        what = "contact displacements" if basis.masters == "all" else "normal contact displacements"
        known = sum(contact.place.at != "nodes" for contact in scene.contacts)
        parts = [f"{known * each}"] if known else []
        many = [k for k, contact in enumerate(scene.contacts) if contact.place.at == "nodes"]
        parts += [f"{each} of each node of contacts[{k}]" for k in many]
        return f"{what}: {', '.join(parts)}" if many else f"{parts[0]} {what}"

    def points_reason() -> str:
        nodes = sum(contact.place.at == "nodes" for contact in scene.contacts)
        points = len(scene.contacts) - nodes
        parts = [f"{points} point{'s' * (points > 1)}"] if points else []
        parts += [f"every node of {nodes} place{'s' * (nodes > 1)}"] if nodes else []
        return " and ".join(parts) or "no contact"

    weighted = any(contact.place.at == "nodes" for contact in scene.contacts)
    projected = basis.elastic_force == "projection"
    return [
        Stage("mesh", True, f"{scene.geometry.mesh.name}, {d}D"),
        Stage("static equilibrium", bool(static) or rotation is not None, equilibrium_reason()),
        Stage(
            "rotating frame",
            rotation is not None,
            f"{rotation.speed_rpm:g} rpm" if rotation else "no rotation",
        ),
        Stage("gyroscopic term", rotation is not None and rotation.coriolis, gyroscopic_reason()),
        Stage(
            "normal modes",
            basis.modes > 0,
            f"{basis.modes} {'free' if basis.method == 'rubin' else 'fixed'}-interface modes",
        ),
        Stage(
            "static modes",
            touching,
            masters_reason(),
        ),
        Stage("linear transient", selecting, derivative_reason()),
        Stage(
            "nonlinear statics", selecting and basis.derivatives == "mmi-nls", derivative_reason()
        ),
        Stage("modal derivatives", selecting or listed, derivative_reason()),
        Stage(
            "elastic polynomial",
            nonlinear and not projected,
            linear if not nonlinear else f"basis.elastic_force is {basis.elastic_force}",
        ),
        Stage(
            "intrusive projection",
            nonlinear and projected,
            linear if not nonlinear else f"basis.elastic_force is {basis.elastic_force}",
        ),
        Stage("contact forces", touching, points_reason()),
        Stage(
            "contact weighting",
            weighted,
            points_reason() if weighted or not touching else "no region of many nodes",
        ),
        Stage(
            "second tangent direction",
            touching and d == 3,
            "no contact" if not touching else f"{d} dimensions",
        ),
        Stage(
            "time integration",
            not scene.static_only,
            STILL if scene.static_only else f"{scene.time.scheme}",
        ),
        Stage(
            "Newton iterations",
            nonlinear,
            "nonlinear elastic force" if nonlinear else linear + ": one solve a step",
        ),
        Stage(
            "full model",
            scene.reference.full,
            "reference.full" if scene.reference.full else "not asked for",
        ),
        Stage(
            "beam model",
            scene.reference.beam is not None,
            "reference.beam" if scene.reference.beam else "not asked for",
        ),
        Stage(
            "pictures",
            scene.output.pictures,
            f"output.pictures = {str(scene.output.pictures).lower()}",
        ),
        Stage(
            "ParaView modes",
            scene.output.paraview,
            f"output.paraview = {str(scene.output.paraview).lower()}",
        ),
        Stage(
            "ParaView motion",
            scene.output.motion,
            f"output.motion = {str(scene.output.motion).lower()}",
        ),
        Stage(
            "animation",
            scene.output.animation,
            f"output.animation = {str(scene.output.animation).lower()}",
        ),
    ]

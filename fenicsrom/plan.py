"""What a scene will compute, what it leaves out, and why."""

from __future__ import annotations

from dataclasses import dataclass

from fenicsrom.scene import Scene


@dataclass(frozen=True)
class Stage:
    """A stage, whether it runs, and the reason in a few words."""

    name: str
    runs: bool
    why: str


def plan(scene: Scene) -> list[Stage]:
    """The stages of a scene in their order."""
    basis, nonlinear, touching = scene.basis, scene.geometrically_nonlinear, bool(scene.contacts)
    selecting = nonlinear and basis.derivatives in ("mmi", "mmi-nls")
    static = [load for load in scene.loads if load.frequency is None]
    d = scene.geometry.dimension
    linear = "the scene is geometrically linear"

    def derivative_reason() -> str:
        if not nonlinear:
            return linear
        if basis.derivatives == "none":
            return "basis.derivatives is none"
        return "basis.derivatives is " + (basis.derivatives if isinstance(basis.derivatives, str) else "a list of labels")

    projected = basis.elastic_force == "projection"
    return [
        Stage("mesh", True, f"{scene.geometry.mesh.name}, {d}D"),
        Stage("static equilibrium", bool(static), f"{len(static)} static loads" if static else "no static load"),
        Stage("normal modes", basis.modes > 0, f"{basis.modes} {'free' if basis.method == 'rubin' else 'fixed'}-interface modes"),
        Stage(
            "static modes",
            touching,
            f"{len(scene.contacts) * d} contact displacements" if touching else "no contact",
        ),
        Stage("linear transient", selecting, derivative_reason()),
        Stage("nonlinear statics", selecting and basis.derivatives == "mmi-nls", derivative_reason()),
        Stage("modal derivatives", nonlinear and basis.derivatives != "none", derivative_reason()),
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
        Stage("contact forces", touching, f"{len(scene.contacts)} points" if touching else "no contact"),
        Stage("second tangent direction", touching and d == 3, "no contact" if not touching else f"{d} dimensions"),
        Stage("Newton iterations", nonlinear, "nonlinear elastic force" if nonlinear else linear + ": one solve a step"),
        Stage("full model", scene.reference.full, "reference.full" if scene.reference.full else "not asked for"),
        Stage("beam model", scene.reference.beam is not None, "reference.beam" if scene.reference.beam else "not asked for"),
        Stage("pictures", scene.output.pictures, f"output.pictures = {str(scene.output.pictures).lower()}"),
        Stage("ParaView modes", scene.output.paraview, f"output.paraview = {str(scene.output.paraview).lower()}"),
        Stage("ParaView motion", scene.output.motion, f"output.motion = {str(scene.output.motion).lower()}"),
        Stage("animation", scene.output.animation, f"output.animation = {str(scene.output.animation).lower()}"),
    ]

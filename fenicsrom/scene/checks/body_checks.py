"""Checks between keys of the body: its supports, attachments and follower pressures."""

from __future__ import annotations

from dataclasses import MISSING

from fenicsrom.scene.base.rules import Problem, Problems
from fenicsrom.scene.keys.places import AXES
from fenicsrom.scene.keys.schema import Scene


def beam_problems(scene: Scene) -> Problems:
    """Yield what the beam of [reference] cannot be compared with."""
    if scene.reference.beam is None:
        return
    reasons = {
        "[[materials]]": scene.materials,
        "a material that is not isotropic": not scene.material.is_isotropic,
        "[[attachments]]": scene.attachments,
        "a pressure with follower = true": scene.followers,
    }
    for reason, given in reasons.items():
        if given:
            yield Problem("reference.beam", f"must be false with {reason}")
    for index, support in enumerate(scene.supports):
        for name in ("components", "normal"):
            if getattr(support, name) is not None:
                allowed = "not allowed with reference.beam, whose end is clamped"
                yield Problem(f"supports[{index}].{name}", allowed)


def support_problems(scene: Scene) -> Problems:
    """Yield the problems of the components that the supports clamp."""
    for index, support in enumerate(scene.supports):
        yield from _component_problems(scene, f"supports[{index}]", support.components)
        if support.normal is not None and support.components is not None:
            yield Problem(f"supports[{index}].normal", "not allowed with components")


def _component_problems(scene: Scene, key: str, components: tuple[str, ...] | None) -> Problems:
    known = AXES[: scene.geometry.dimension]
    for k, axis in enumerate(components or ()):
        if axis not in known:
            allowed = f"must be {' or '.join(known)} in {len(known)}D"
            yield Problem(f"{key}.components[{k}]", allowed)


def attachment_problems(scene: Scene) -> Problems:
    """Yield the problems of the masses, springs and dashpots."""
    for index, found in enumerate(scene.attachments):
        key = f"attachments[{index}]"
        yield from _component_problems(scene, key, found.components)
        if not (found.mass or found.stiffness or found.stiffness_per_area or found.viscous):
            allowed = "a mass, a stiffness or a damping above 0 must be given"
            yield Problem(f"{key}.mass", allowed, value=MISSING)
        for name in ("stiffness", "damping"):
            per_area = getattr(found, f"{name}_per_area")
            if per_area and not found.place.is_mean:
                allowed = f"only allowed on a whole region; use {name}"
                yield Problem(f"{key}.{name}_per_area", allowed)


def follower_problems(scene: Scene) -> Problems:
    """Yield the problems of the pressures that follow the deformation."""
    if not scene.followers:
        return
    key = f"loads[{scene.followers[0]}].follower"
    if not scene.geometrically_nonlinear:
        yield Problem(key, "only allowed with geometrically_nonlinear = true")
    if "projection" in (scene.basis.elastic_force, *scene.compare.elastic_force):
        yield Problem(key, 'only allowed with elastic_force = "polynomial"')
    if scene.output.stresses != "none":
        allowed = f'must be "none" with {key} = true, whose forces are not in the reactions'
        yield Problem("output.stresses", allowed)

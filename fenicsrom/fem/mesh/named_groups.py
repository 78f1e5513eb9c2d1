"""The groups of a mesh that a scene names."""

from collections.abc import Iterator

from fenicsrom.errors import ErrorKind
from fenicsrom.fem.mesh.mesh import Mesh
from fenicsrom.scene import Scene
from fenicsrom.scene.base.rules import Where

CELLS, FACETS, ANY = "cells", "facets", "facets or nodes"


def require_groups(mesh: Mesh, scene: Scene) -> None:
    """Check that a mesh has the groups of a scene.

    Raises:
        SceneError: it lacks one; the sentence names the key, the group, and those that there are.
    """
    facets = {*mesh.facet_groups}
    groups = {CELLS: {*mesh.cell_groups}, FACETS: facets, ANY: facets | {*mesh.node_groups}}
    for key, name, kind in _named(scene):
        if name is not None and name not in groups[kind]:
            known = ", ".join(sorted(groups[kind])) or "none"
            allowed = f"must be a group of {kind} of {mesh.source}, which has {known}"
            raise Where(scene.source, key).refuse(name, allowed, ErrorKind.PLACE)


def _named(scene: Scene) -> Iterator[tuple[str, str | None, str]]:
    """Yield each key that names a group, the group or None, and its kind."""
    for k, material in enumerate(scene.materials):
        yield f"materials[{k}].group", material.group, CELLS
    for k, support in enumerate(scene.supports):
        yield f"supports[{k}].group", support.group, ANY
    for k, attachment in enumerate(scene.attachments):
        yield f"attachments[{k}].group", attachment.place.group, ANY
        if attachment.to is not None:
            yield f"attachments[{k}].to.group", attachment.to.group, ANY
    for k, contact in enumerate(scene.contacts):
        kind = ANY if contact.against is None else FACETS
        yield f"contacts[{k}].group", contact.place.group, kind
        yield f"contacts[{k}].against", contact.other.group, kind
    for k, bolt in enumerate(scene.bolts):
        yield f"bolts[{k}].head", bolt.head, ANY
        yield f"bolts[{k}].nut", bolt.nut, ANY
    for k, tie in enumerate(scene.ties):
        yield f"ties[{k}].group", tie.group, FACETS
        yield f"ties[{k}].against", tie.against, FACETS
    for k, load in enumerate(scene.loads):
        if load.place is not None:
            kind = ANY if load.kind == "force" else FACETS
            yield f"loads[{k}].group", load.place.group, kind
    if scene.probe is not None:
        yield "probe.group", scene.probe.group, ANY
    if scene.cyclic is not None:
        yield "cyclic.left", scene.cyclic.left, FACETS
        yield "cyclic.right", scene.cyclic.right, FACETS

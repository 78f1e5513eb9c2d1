"""Stored reduced models: everything the online stage needs, in one `.npz` file without dolfinx.

With n coordinates, p = n (n + 1) / 2 pairs of coordinates (p = 0 in a linear model), P contact
points in d dimensions, v normal modes, and c different cubic coefficients, the file holds these
arrays of float64, in SI units:

    ==================== ============ ========== ================================================
    name                 shape        unit       meaning
    ==================== ============ ========== ================================================
    mass                 (n, n)       kg         M
    damping              ()           1/s        alpha of the damping matrix C = alpha M
    force                (n,)         N          elastic force at q = 0
    stiffness            (n, n)       N/m        K, the tangent at q = 0
    quadratic            (p, n)       N/m^2      A by pairs (`fenicsrom.online.model.polynomial`)
    cubic                (c,)         N/m^3      B (`fenicsrom.online.model.polynomial`)
    velocity_matrix      (n, n)       kg/s       D, gyroscopic and viscous; (0, 0) without
    loads                (n, loads)   1          projected unit loads, one column for each load
    contact_rows         (P d, n)     1          local contact displacement = rows q + offset
    contact_offset       (P d,)       m          local contact displacement at q = 0
    probe                (d, n)       1          probe displacement = probe q + offset, global axes
    probe_offset         (d,)         m          probe displacement at q = 0
    point_contact        (P,) int64   -          contact of the scene that each point belongs to
    point_tributary_area (P,)         m^(d-1)    area, length or number that a point stands for
    point_position       (P, d)       m          place on the undeformed body
    point_frame          (P, d, d)    1          rows: normal into the surface, then tangents
    point_unit_lengths   (P,) int64   -          0 of facets, 1 of edges, 2 of nodes of a region
    frequencies_hz       (v,)         Hz         natural frequencies of the normal modes
    pressure_linear      (k, n, n)    m          G of k follower pressures
    pressure_quadratic   (k, c, n, n) 1          H (`online.model.pressure`), c = n, 0 in 2D
    ==================== ============ ========== ================================================

A model without follower pressures has no arrays of pressures. The model of a body that static loads
or its speed deform has the array `deformation` (3 + d,): `fenicsrom.online.stress.stress`.

A model of a scene that asks for stresses has more arrays: `fenicsrom.online.stress.reactions`.

The arrays are those of all coordinates that the file holds, in their order. The model has the first
`size` of them. The larger model of all of them judges it
(`fenicsrom.assess.errors.estimates.basis_errors`), and a model of any of them is a part of the
arrays.

Arrays with the prefix `finer_` are those of a model of finer elements, which judges the mesh
(`fenicsrom.assess.errors.estimates.mesh_errors`). Its coordinates have the `finer_labels` of the
header. `finer_frequencies_hz` (v,) are the natural frequencies of the finer elements, those of
`frequencies_hz` in the same order. Without a finer model, `unjudged` in the header says why.

A model for a speed that varies has the arrays of `fenicsrom.online.model.turning.Turning`, with the
prefix `turning_`.

A model for a range of speeds has the arrays of the range model (`online.step.speed_range`) with the
prefix `range_`: those above, and `range_centrifugal` (n,), `range_softening` and `range_coriolis`
(n, n), `range_euler` (n,), `range_inertia` (1,), `range_moments` (loads, 1 + n), `range_speeds`
(s,), `range_equilibria` (s, n) and `range_errors` (4, k). The range model of finer elements has the
prefix `range_finer_`. The other arrays are those of the model at the speed of the scene; at another
speed they follow from the range model.

The entry `header` is JSON text: format, method, labels of all coordinates, `size`, number of
unknowns of the mesh (`dofs`), scene with its source, provenance, and of a range model the
numbers of its modes and masters. The entry `digest` is
the SHA-256 of all other entries: a file that was changed is refused.

`fenicsrom.online.store.scene_changes` states which keys may change when a stored model runs again.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from fenicsrom.arrays import Array
from fenicsrom.errors import ErrorKind, SceneError, refuse
from fenicsrom.files import read_archive, write_archive
from fenicsrom.online.contact.points import stored_points
from fenicsrom.online.contact.surfaces import history_of, speed_history
from fenicsrom.online.model.loads import PressurePolynomial
from fenicsrom.online.model.model import ReducedModel, reduced_model
from fenicsrom.online.model.polynomial import ElasticPolynomial, paired_cubic, unique_cubic
from fenicsrom.online.model.subspace import nested_model
from fenicsrom.online.model.turning import Turning
from fenicsrom.online.motion.motion import Motion
from fenicsrom.online.run.simulate import load_histories, simulate
from fenicsrom.online.step.speed_range import AtSpeed, RangeErrors, RangeModel
from fenicsrom.online.store.scene_changes import changed_key, changed_path
from fenicsrom.online.stress.reactions import (
    Recovery,
    read_recovery,
    recovery_arrays,
    reduced_modes,
)
from fenicsrom.online.stress.stress import Deformation, StressTable
from fenicsrom.scene import Overrides, Scene, override_table, parse_scene, scene_table, titled
from fenicsrom.scene.base.rules import Where
from fenicsrom.scene.reading.overrides import override_in_si, override_texts
from fenicsrom.words import brief

FORMAT = "fenicsrom reduced model 9"
FINER = "finer_"  # start of the names of the arrays of the model of finer elements
RANGE = "range_"  # start of the names of the arrays of the model for a range of speeds
PLAIN = ("loads", "contact_rows", "contact_offset", "probe", "probe_offset", "velocity_matrix")
TURNING = "turning_"  # start of the names of the arrays of a speed that varies
RANGE_ARRAYS = (
    *("centrifugal", "softening", "coriolis", "euler", "inertia", "moments"),
    *("speeds", "equilibria"),
)
PRESSURES = ("pressure_linear", "pressure_quadratic")
SUPERELEMENT = "superelement"  # the method of a model that was made of matrices
EARLIER = "fenicsrom reduced model"  # start of the names of earlier formats
Meshes = tuple[ReducedModel, ReducedModel, list[int]]


@brief("scene", "method", "size", "labels", "frequencies_hz", "dofs", "model", "recovery", "file")
@dataclass(frozen=True, eq=False, repr=False)
class StoredModel:
    """A reduced model with its scene, as a file holds it.

    Attributes:
        model: the model, under the load histories and the damping of the scene.
        scene: the scene from which the model was made, or under which it runs.
        method: "rubin", "craig-bampton" or "superelement".
        labels: (n,) labels of the coordinates of the model.
        dofs: number of free unknowns of the solid.
        frequencies_hz: (v,) natural frequencies of the normal modes.
        provenance: versions of the programs that made it, by name.
        tables: tables of the stresses and reactions for all coordinates, those of `further`
            included; None if the scene did not ask for them.
        candidates: the larger model that judges the basis, whose first n coordinates are those of
            the model; None if it was not made.
        deformation: extremes of the deformation in the equilibrium; None of an undeformed body.
        file: the file from which it was read, for messages; "" if there is none.
        further: labels of the other coordinates of the larger model.
        finer: the model of finer elements, which judges the mesh; None if it was not made.
        finer_labels: labels of its coordinates.
        finer_frequencies_hz: (v,) those of `frequencies_hz` with finer elements; (0,) unknown.
        unjudged: why there is no model of finer elements; "" if there is one.
        whole: the model for a range of speeds from which the model at the speed of the scene
            follows; None of a model for one speed.
    """

    model: ReducedModel
    scene: Scene
    method: str
    labels: tuple[str, ...]
    dofs: int
    frequencies_hz: Array
    provenance: dict[str, str]
    tables: Recovery | None = None
    candidates: ReducedModel | None = None
    deformation: Deformation | None = None
    file: str = ""
    further: tuple[str, ...] = ()
    finer: ReducedModel | None = None
    finer_labels: tuple[str, ...] = ()
    finer_frequencies_hz: Array = field(default_factory=lambda: np.zeros(0))
    unjudged: str = ""
    whole: RangeModel | None = None

    @property
    def meshes(self) -> Meshes | None:
        """The models of the same coordinates on the elements of the mesh and on finer ones.

        With the numbers of these coordinates among those of the model; -1 for another coordinate.

        Raises:
            ConvergenceError: the finer elements have no equilibrium at the speed of the scene.
        """
        finer, labels = self.finer, self.finer_labels
        if self.whole is not None and self.whole.finer is not None:
            found = replace(self, whole=self.whole.finer, labels=()).at_speed()
            known = {*self.labels, *self.further}
            found = found.resized([label for label in found.labels if label in known])
            finer, labels = found.model, found.labels
        if finer is None:
            return None
        numbered = {label: number for number, label in enumerate(self.labels)}
        numbers = [numbered.get(label, -1) for label in labels]
        return self.resized(labels).model, finer, numbers

    @property
    def normal_modes(self) -> dict[int, float]:
        """Frequencies in Hz of the structure's modes among the coordinates, by their numbers.

        They are nan where the normal modes are those of a held interface.
        """
        count = self.frequencies_hz.size
        if self.method == "craig-bampton":
            return dict.fromkeys(range(1, count + 1), math.nan)
        numbers = [int(label[:-1]) for label in self.labels if re.fullmatch(r"\d+V", label)]
        return {k: float(self.frequencies_hz[k - 1]) for k in sorted(numbers) if k <= count}

    @property
    def size(self) -> int:
        """Number of coordinates."""
        return self.model.size

    @property
    def recovery(self) -> Recovery | None:
        """The tables of the stresses and reactions for the coordinates of the model."""
        return None if self.tables is None else self.tables.of(range(self.size))

    @property
    def least_size(self) -> int:
        """The fewest coordinates that the model may have: those of the contact and one more."""
        return least_size((*self.labels, *self.further))

    def require_size(self) -> None:
        """Check the number of coordinates that the scene asks for.

        Raises:
            SceneError: the model has no such `basis.size`.
        """
        require_size(self.scene, (*self.labels, *self.further), self.size)

    def resized(self, chosen: int | Sequence[str]) -> StoredModel:
        """The model of other coordinates of those that the file holds, without a mesh.

        Args:
            chosen: the labels of the coordinates in their order, or the number of the first ones.

        Raises:
            ValueError: there are no such coordinates.
        """
        known = (*self.labels, *self.further)
        labels = known[: max(chosen, 0)] if isinstance(chosen, int) else tuple(chosen)
        wanted = chosen if isinstance(chosen, int) else len(labels)
        if not (0 < wanted == len(set(labels)) and set(labels) <= set(known)):
            raise ValueError(f"{chosen}: must be coordinates of {' '.join(known)}")
        if labels == self.labels:
            return self
        order = [known.index(label) for label in labels]
        order += [k for k in range(len(known)) if k not in set(order)]
        whole = nested_model(self.candidates or self.model, order)
        return replace(
            self,
            model=nested_model(whole, range(len(labels))),
            labels=labels,
            tables=None if self.tables is None else self.tables.of(order),
            candidates=whole if len(labels) < len(known) else None,
            further=tuple(known[k] for k in order[len(labels) :]),
        )

    def with_scene(self, scene: Scene) -> StoredModel:
        """The same model under the loads, damping, contacts and time integration of a scene.

        Args:
            scene: a scene that agrees with the stored scene in all keys of the offline stage.

        Raises:
            SceneError: the scenes do not agree; the error names the first key that differs. Or the
                model has no such `basis.size`.
        """
        return self._with_scene(scene, scene.source)

    def _with_scene(self, scene: Scene, source: str) -> StoredModel:
        """As `with_scene`; messages name this source of the scene."""
        if (key := changed_key(self.scene, scene)) is not None:
            path = changed_path(self.scene, scene)
            raise SceneError(
                f"{source}: {path} cannot change on a stored reduced model; run the scene "
                "again, without --from",
                kind=ErrorKind.MISMATCH,
                key=key,
                source=source,
            )
        changes: dict[str, Any] = {
            "load_histories": load_histories(scene),
            "damping": float(scene.material.mass_damping),
        }
        models = {"model": self.model, "candidates": self.candidates, "finer": self.finer}
        changed: dict[str, Any] = {
            name: None if model is None else model._replace(**changes)
            for name, model in models.items()
        }
        found = replace(self, scene=scene, **changed)
        if self.whole is not None:
            found = replace(found, whole=self.whole.under(**changes))
            if scene.rotation != self.scene.rotation:
                found = found.at_speed()
        found.require_size()
        return found

    def at_speed(self) -> StoredModel:
        """The model at the speed or for the history of its scene, from that for the range.

        It has the coordinates of this model, if there are any of their labels at this speed.

        Raises:
            ConvergenceError: there is no equilibrium at this speed.
        """
        whole, scene = self.whole, self.scene
        assert whole is not None and scene.rotation is not None
        history, omega = history_of(scene.rotation), scene.rotation.omega
        if history.size:
            return self._with_coordinates(whole.over(history, omega))
        modes = isinstance(scene.basis.masters, int)
        return self._with_coordinates(whole.at(omega, modes, scene.geometrically_nonlinear))

    def over_speeds(self, first: float, last: float) -> StoredModel:
        """The model for all speeds between two in rev/min, from that for the range.

        Its `model.turning` says how it depends on the speed, as that of a model for a speed that
        varies (`fenicsrom.online.periodic.shooting.speed_family`).

        Raises:
            ConvergenceError: there is no equilibrium at a speed.
        """
        whole, rotation = self.whole, self.scene.rotation
        assert whole is not None and rotation is not None
        history = speed_history([[0.0, np.pi / 30.0 * first], [1.0, np.pi / 30.0 * last]])
        return self._with_coordinates(whole.over(history, rotation.omega))

    def _with_coordinates(self, found: AtSpeed) -> StoredModel:
        """The model with other coordinates, in the order of those of this model if they are."""
        made = replace(
            self,
            model=found.model,
            candidates=found.candidates if found.further else None,
            labels=found.labels,
            further=found.further,
            frequencies_hz=found.frequencies_hz,
        )
        same = self.labels and {*self.labels} <= {*found.labels, *found.further}
        return made.resized(self.labels) if same else made

    def with_overrides(self, overrides: Overrides) -> StoredModel:
        """The same model under its scene with other values.

        Args:
            overrides: as `--set` takes them, such as "loads.0.force=200", one or several; or a
                dict, such as {"loads.0.force": 200.0}.

        Raises:
            SceneError: an override is wrong, or changes a key of the offline stage.

        Example:
            >>> import fenicsrom as fr
            >>> stored = fr.load_model("out/beam.npz")
            >>> for force in (50, 100):
            ...     motion = stored.with_overrides(f"loads.0.force={force}").simulate()
            ...     print(f"{force} N: {1e3 * fr.amplitudes(motion)['tangential'][0]:.1f} mm")
            50 N: 13.9 mm
            100 N: 103.2 mm
        """
        source = self.file or self.scene.source
        return self._with_scene(changed_scene(self.scene, overrides, source), source)

    def with_values(self, values: Mapping[str, Any]) -> StoredModel:
        """As `with_overrides`, with numbers in SI units, also if the scene has other [units]."""
        source = self.file or self.scene.source
        return self._with_scene(changed_scene(self.scene, values, source, si=True), source)

    @property
    def nodes(self) -> Array:
        """(N, d) vertices of the cells of the undeformed body, m.

        Raises:
            SceneError: the scene did not ask for `output.stresses`.
        """
        return self._stress_table().vertex_position

    def displacement(self, coordinates: Array) -> Array:
        """The displacement of the `nodes`, that of the equilibrium included.

        Args:
            coordinates: (n,) or (k, n) coordinates q, such as `Motion.coordinates`, m.

        Returns:
            (N, d) or (k, N, d), m, in global axes.

        Raises:
            SceneError: the scene did not ask for `output.stresses`.
        """
        return self._stress_table().displacement(coordinates)

    def mode_shapes(self) -> tuple[Array, Array]:
        """The structure's modes in the basis about the equilibrium, without contact and damping.

        Returns:
            (k,) frequencies, Hz, of the modes with the numbers of `normal_modes`; and (k, N, d)
            displacements of the `nodes` in the modes, which have the modal mass 1 kg, 1/sqrt(kg).

        Raises:
            SceneError: the scene did not ask for `output.stresses`.
        """
        vectors = self._stress_table().vertex_displacement[1:]
        _, frequencies, modes = reduced_modes(self.model, self.normal_modes)
        return frequencies, np.asarray(np.tensordot(modes.T, vectors, 1))

    def _stress_table(self) -> StressTable:
        """The table with the displacements of the nodes.

        Raises:
            SceneError: there is none.
        """
        if self.recovery is None:
            reason = (
                "the model knows the displacements of its contact points and of its probe only; "
                'for those of all nodes, build it with output.stresses="cauchy"'
            )
            source = self.file or self.scene.source
            raise refuse(source, reason, ErrorKind.MISSING, "output.stresses")
        return self.recovery.stress

    def simulate(self, scene: Scene | None = None, **options: Any) -> Motion:
        """Integrate the model under a scene: its loads, damping, contacts and time integration.

        Args:
            scene: the scene; by default the scene of the model.
            options: as `fenicsrom.online.run.simulate.simulate`.

        Raises:
            SceneError: the scene differs in a key of the offline stage.
            ConvergenceError: the smallest step did not converge.
            AccuracyError: the error of the energy balance is too large.

        Example:
            >>> import fenicsrom as fr
            >>> motion = fr.load_model("out/beam.npz").simulate()
            >>> motion.time.size == motion.displacement.shape[0]
            True
            >>> round(float(motion.force[:, 0, 0].max()), 1)  # normal force of the first point, N
            40.0
        """
        run = self if scene is None else self.with_scene(scene)
        return simulate(run.model, run.scene, **options)


def least_size(labels: Sequence[str]) -> int:
    """The fewest of these coordinates that a model may have: those of the contact and one more."""
    return 1 + next((k for k, label in enumerate(labels) if label[-1] != "S"), 0)


def require_size(scene: Scene, labels: Sequence[str], own: int) -> None:
    """Check the number of coordinates that a scene asks for.

    Args:
        scene: the scene.
        labels: of all coordinates that its model can hold.
        own: number of the first of these, which a model without `basis.size` begins with.

    Raises:
        SceneError: there is no model of `basis.size` that the other coordinates can judge.
    """
    size, least, known = scene.basis.size, least_size(labels), len(labels)
    if size is None or (own < known and least <= size < known):
        return
    allowed = (
        f"must be from {least} to {known - 1}; the model holds {known} coordinates, and those "
        "that it leaves out judge it"
        if own < known
        else "not allowed: the model holds no coordinates besides its own"
    )
    raise Where(scene.source, "basis.size").refuse(size, allowed)


def changed_scene(
    scene: Scene, overrides: Overrides, source: str = "", *, si: bool = False
) -> Scene:
    """A scene with other values, which its title names; its paths stay as they are.

    Args:
        scene: the scene.
        overrides: as `StoredModel.with_overrides` takes them.
        source: the file that messages name; by default that of the scene.
        si: whether the values are in SI units, and not in those of the scene's [units].

    Raises:
        SceneError: an override is wrong.
    """
    source, overrides = source or scene.source, override_texts(overrides)
    if not si:
        overrides = [override_in_si(scene, override) for override in overrides]
    changed = override_table(scene_table(scene), overrides, source)
    found = parse_scene(titled(changed, overrides, scene.source), source, None)
    return replace(found, source=scene.source)


def save_model(path: Path, stored: StoredModel) -> None:
    """Write a reduced model to a file that appears only when it is complete.

    Raises:
        OSError: the file cannot be written.
    """
    write_archive(path, *model_contents(stored))


def model_contents(stored: StoredModel) -> tuple[dict[str, Any], dict[str, Any]]:
    """The header and the arrays of the file of a reduced model."""
    header = {
        "format": FORMAT,
        "method": stored.method,
        "labels": [*stored.labels, *stored.further],
        "size": stored.size,
        "dofs": stored.dofs,
        "source": stored.scene.source,
        "scene": scene_table(stored.scene),
        "provenance": stored.provenance,
        "unjudged": stored.unjudged,
    }
    model = stored.model
    arrays = {
        "frequencies_hz": stored.frequencies_hz,
        f"{FINER}frequencies_hz": stored.finer_frequencies_hz,
        "damping": np.array(model.damping),
        **{f"point_{name}": array for name, array in model.points._asdict().items()},
        **_arrays(stored.candidates or model),
        **recovery_arrays(stored.tables),
    }
    if stored.deformation is not None:
        arrays["deformation"] = stored.deformation.as_array()
    if stored.finer is not None:
        arrays |= {f"{FINER}{name}": array for name, array in _arrays(stored.finer).items()}
        header["finer_labels"] = list(stored.finer_labels)
    if (whole := stored.whole) is not None:
        arrays |= {f"{RANGE}{name}": array for name, array in _range_arrays(whole).items()}
        header["range"] = {"modes": whole.modes, "masters": whole.masters}
    return header, arrays


def _range_arrays(whole: RangeModel) -> dict[str, Array]:
    """The arrays of a range model by their names, and those of the finer one with a prefix."""
    found = _arrays(whole.model)
    found |= {name: np.array(getattr(whole, name)) for name in (*RANGE_ARRAYS, "errors")}
    finer = {} if whole.finer is None else _range_arrays(whole.finer)
    return found | {f"{FINER}{name}": array for name, array in finer.items()}


def _arrays(model: ReducedModel) -> dict[str, Array]:
    """The arrays of a model by their names in the file, without its contact points."""
    follows = model.pressure.numbers.size > 0
    turning, varies = model.turning._asdict(), model.turning.history.size > 0
    return {
        "mass": model.mass,
        **({name: getattr(model.pressure, name[9:]) for name in PRESSURES} if follows else {}),
        **model.elastic._asdict(),
        "cubic": unique_cubic(model.elastic.cubic, model.size),
        **{name: getattr(model, name) for name in PLAIN},
        **({f"{TURNING}{name}": np.array(a) for name, a in turning.items()} if varies else {}),
    }


def load_model(path: Path) -> StoredModel:
    """Read a reduced model.

    Raises:
        SceneError: the file is missing, damaged or of another format.

    Example:
        A run without a mesh: `fenicsrom import demos/superelement/beam.op4 --scene
        demos/superelement/rub.toml --output out/beam.npz` writes this model.

        >>> import fenicsrom as fr
        >>> stored = fr.load_model("out/beam.npz")
        >>> stored.size, stored.frequencies_hz[:2].round(2).tolist()
        (9, [3.28, 20.58])
    """
    with read_archive(path, "a reduced model", FORMAT, EARLIER) as (header, data):
        return model_of_contents(path, header, data)


def model_of_contents(path: Path, header: dict[str, Any], data: dict[str, Any]) -> StoredModel:
    """The reduced model of a header and arrays; `path` names their file in messages.

    Raises:
        SceneError: the scene in the header is wrong.
    """
    scene = parse_scene(header["scene"], str(header["source"]), None)
    labels, size, finer_labels = header["labels"], header["size"], header.get("finer_labels", ())
    whole = _model(data, scene)
    return StoredModel(
        nested_model(whole, range(size)) if size < len(labels) else whole,
        scene,
        header["method"],
        tuple(labels[:size]),
        header["dofs"],
        data["frequencies_hz"],
        header["provenance"],
        read_recovery(data, scene),
        whole if size < len(labels) else None,
        Deformation.of_array(data["deformation"]) if "deformation" in data else None,
        str(path),
        tuple(labels[size:]),
        _model(data | _part(data, FINER), scene) if finer_labels else None,
        tuple(finer_labels),
        data[f"{FINER}frequencies_hz"],
        header["unjudged"],
        _range_model(_part(data, RANGE), data, scene, **header["range"])
        if "range" in header
        else None,
    )


def _part(data: dict[str, Any], prefix: str) -> dict[str, Any]:
    """The arrays whose names have a prefix, without it."""
    return {name[len(prefix) :]: data[name] for name in data if name.startswith(prefix)}


def _range_model(
    data: dict[str, Any], shared: dict[str, Any], scene: Scene, modes: int, masters: int
) -> RangeModel:
    """The range model of the arrays of a file, with that of finer elements if there is one.

    Args:
        data: its own arrays.
        shared: arrays that have its points and its damping.
        scene: the scene.
        modes: number of its normal modes.
        masters: number of its masters.
    """
    finer = _part(data, FINER)
    common = {key: shared[key] for key in shared if key == "damping" or key.startswith("point_")}
    return RangeModel(
        _model(common | data, scene),
        **{name: data[name] for name in RANGE_ARRAYS},
        modes=modes,
        masters=masters,
        errors=RangeErrors(*data["errors"]),
        finer=_range_model(finer, shared, scene, modes, masters) if finer else None,
    )


def _model(data: dict[str, Any], scene: Scene) -> ReducedModel:
    """The model of the arrays of a file under the loads of a scene."""
    followers = np.array(scene.followers, dtype=np.int64)
    pressures = (data[name] for name in PRESSURES) if followers.size else None
    cubic = paired_cubic(data["cubic"], len(data["mass"]))
    return reduced_model(
        mass=data["mass"],
        damping=float(data["damping"]),
        elastic=ElasticPolynomial(data["force"], data["stiffness"], data["quadratic"], cubic),
        load_histories=load_histories(scene),
        points=stored_points(data),
        pressure=None if pressures is None else PressurePolynomial(followers, *pressures),
        turning=Turning(*(data[f"{TURNING}{name}"] for name in Turning._fields))
        if f"{TURNING}history" in data
        else None,
        **{name: data[name] for name in PLAIN},
    )

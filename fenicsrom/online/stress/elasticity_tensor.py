"""Elasticity tensors of materials as matrices in Mandel's notation.

A symmetric tensor x becomes the vector of its normal components and of √2 times its shear
components, in the order (xx, yy, zz, xy, xz, yz) in space and (xx, yy, xy) in the plane. The
product x : y of two tensors is that of their vectors, so that a rotation of the tensor is an
orthogonal matrix, and the elasticity tensor a symmetric one.
"""

import numpy as np

from fenicsrom.arrays import Array
from fenicsrom.scene.keys.materials import Elasticity

IN_PLANE = [0, 1, 3]
"""Places of (xx, yy, xy) in space."""


def stiffness(material: Elasticity, dimension: int, plane: str | None) -> Array:
    """The elasticity tensor (m, m) of a material in global axes, Pa; m = 3 in 2D, 6 in 3D.

    Args:
        material: the material, with its axes.
        dimension: 2 or 3.
        plane: "stress" or "strain" in 2D.
    """
    whole = in_space(material)
    if dimension == 3:
        found = whole
    elif plane == "strain":
        found = whole[np.ix_(IN_PLANE, IN_PLANE)]
    else:
        found = np.linalg.inv(np.linalg.inv(whole)[np.ix_(IN_PLANE, IN_PLANE)])
    return np.asarray(0.5 * (found + found.T))


def across(material: Elasticity, plane: str | None) -> Array:
    """The row (3,) that gives S_zz in plane strain, or E_zz in plane stress, from the strain."""
    whole = in_space(material)
    if plane == "strain":
        return np.asarray(whole[2, IN_PLANE])
    return np.asarray(np.linalg.inv(whole)[2, IN_PLANE] @ stiffness(material, 2, plane))


def in_space(material: Elasticity) -> Array:
    """The elasticity tensor (6, 6) of a material in space, in global axes, Pa."""
    turned = rotation(axes(material))
    return np.asarray(turned @ np.linalg.inv(compliance(material)) @ turned.T)


def compliance(material: Elasticity) -> Array:
    """The compliance (6, 6) of a material in its own axes, 1/Pa.

    This is (1) of `fenicsrom.scene.keys.materials`.
    """
    young, (nu12, nu13, nu23), shear = material.orthotropic_constants
    found = np.diag([*(1.0 / np.array(young)), *(0.5 / np.array(shear))])
    for i, j, nu in ((0, 1, nu12), (0, 2, nu13), (1, 2, nu23)):
        found[i, j] = found[j, i] = -nu / young[i]
    return found


def axes(material: Elasticity) -> Array:
    """The material axes as the columns of a rotation (3, 3)."""
    if material.axes is None:
        return np.eye(3)
    given = [np.array([*axis, 0.0][:3]) for axis in material.axes]
    first = given[0] / np.linalg.norm(given[0])
    if len(given) == 2:
        second = given[1]
    else:  # in 2D axis 3 is z; in 3D any direction in the plane of isotropy serves
        normal = np.eye(3)[2 if len(material.axes[0]) == 2 else np.argmin(np.abs(first))]
        second = np.cross(normal, first)
    second = second - (second @ first) * first
    second /= np.linalg.norm(second)
    return np.column_stack([first, second, np.cross(first, second)])


def rotation(turn: Array) -> Array:
    """The matrix (6, 6) that turns the vector of a symmetric tensor x into that of R x Rᵀ."""
    basis = mandel_basis(3)
    turned = turn @ basis @ turn.T
    return np.asarray(np.einsum("aij,bij->ab", basis, turned))


def mandel_basis(dimension: int) -> Array:
    """The orthonormal basis (m, d, d) of the symmetric tensors, in the order of the vectors."""
    d = dimension
    pairs = [(k, k) for k in range(d)] + [(i, j) for i in range(d) for j in range(i + 1, d)]
    found = np.zeros((len(pairs), d, d))
    for k, (i, j) in enumerate(pairs):
        found[k, i, j] = found[k, j, i] = 1.0 if i == j else np.sqrt(0.5)
    return found

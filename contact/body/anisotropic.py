r"""Anisotropic materials: stiffness tensors in Voigt's notation, with rotated material axes.

The order of the components is xx, yy, zz, yz, zx, xy, and shear strains are engineering strains,

.. math:: \sigma_I = \sum_J C_{IJ}\, \epsilon_J, \qquad
          \epsilon = (\epsilon_{xx}, \epsilon_{yy}, \epsilon_{zz},
                      2\epsilon_{yz}, 2\epsilon_{zx}, 2\epsilon_{xy}) .
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from contact.errors import InputError
from skfem_adini.ground.arguments import numbers

Array = NDArray[np.float64]
VOIGT = np.array([[0, 5, 4], [5, 1, 3], [4, 3, 2]])  # Voigt index of the tensor component ij


class Anisotropic:
    """A linearly elastic material with any stiffness tensor.

    Parameters
    ----------
    C : array, shape (6, 6) or (ncells, 6, 6)
        Voigt stiffness in the material axes, symmetric and positive definite, in the unit of
        stress. The order is xx, yy, zz, yz, zx, xy.
    rotation : float, array or scipy Rotation, optional
        Of the material axes: an angle about z in radians, a matrix whose columns are the material
        axes, or a `scipy.spatial.transform.Rotation`; one for all cells or one a cell, shapes
        (ncells,) and (ncells, 3, 3).

    Attributes
    ----------
    C : ndarray, shape (6, 6) or (ncells, 6, 6)
        In the axes of the mesh (read-only).

    Raises
    ------
    InputError
        C is not symmetric or not positive definite, or the rotation is none.

    References
    ----------
    T. C. T. Ting, Anisotropic Elasticity, Oxford University Press 1996, sections 2.3 and 2.4.

    Examples
    --------
    A cubic crystal, silicon, with axes turned by 45 degrees; constants in GPa:

    >>> import numpy as np
    >>> C = np.diag([165.7 - 63.9] * 3 + [79.6] * 3)
    >>> C[:3, :3] += 63.9
    >>> turned = Anisotropic(C, rotation=np.pi / 4)
    >>> [round(float(turned.C[i, i]), 1) for i in (0, 2, 5)]
    [194.4, 165.7, 50.9]
    """

    def __init__(self, C: ArrayLike, rotation: Any = None) -> None:
        self.C: Array = _rotated(_checked_stiffness(C), rotation)
        self.C.flags.writeable = False

    def __repr__(self) -> str:
        cells = f"{len(self.C)} cells, " if self.C.ndim == 3 else ""
        stiffest = float(np.diagonal(self.C, axis1=-2, axis2=-1).max())
        return f"{type(self).__name__}({cells}largest stiffness {stiffest:.6g})"


class Orthotropic(Anisotropic):
    r"""A material with three planes of symmetry, given by its engineering constants.

    .. math:: \epsilon_{11} = \frac{\sigma_{11}}{E_1} - \frac{\nu_{12}}{E_1} \sigma_{22} \cdots,
              \qquad \frac{\nu_{ij}}{E_i} = \frac{\nu_{ji}}{E_j},
              \qquad 2 \epsilon_{12} = \frac{\sigma_{12}}{G_{12}}

    with nu_ij the contraction along j under tension along i. Transverse isotropy about axis 1 has
    E2 = E3, nu12 = nu13, G12 = G13 and G23 = E2 / (2 (1 + nu23)). In two dimensions all nine
    constants are needed too, for axis 3 is that of the thickness.

    Parameters
    ----------
    E : array, shape (3,) or (ncells, 3)
        Young's moduli E1, E2, E3 along the material axes.
    nu : array, shape (3,) or (ncells, 3)
        Poisson's ratios nu12, nu13, nu23.
    G : array, shape (3,) or (ncells, 3)
        Shear moduli G12, G13, G23.
    rotation : float, array or scipy Rotation, optional
        As for `Anisotropic`.

    Raises
    ------
    InputError
        A modulus that is not positive, or ratios with which the energy is not positive, such as
        ``nu12**2 >= E1 / E2``.

    References
    ----------
    S. G. Lekhnitskii, Theory of Elasticity of an Anisotropic Body, Mir 1981, section 3.

    Examples
    --------
    A block of spruce whose fibres make an angle of .3 with x, moduli in GPa:

    >>> from skfem import MeshQuad
    >>> from contact import ContactProblem, ElasticBody, Orthotropic
    >>> E, nu, G = (12.0, 0.8, 0.5), (0.4, 0.4, 0.3), (0.7, 0.7, 0.04)
    >>> spruce = Orthotropic(E, nu, G, rotation=0.3)
    >>> mesh = MeshQuad().refined(3).with_defaults()
    >>> body = ElasticBody.from_mesh(mesh, material=spruce).fix("top", "xy", 0.0)
    >>> result = ContactProblem(body, "bottom", -0.001).solve()
    >>> bool(result.pressure.min() > 0)
    True
    """

    def __init__(self, E: ArrayLike, nu: ArrayLike, G: ArrayLike, rotation: Any = None) -> None:
        moduli, ratios, shears = (_triple(*pair) for pair in (("E", E), ("nu", nu), ("G", G)))
        for name, value in (("E", moduli), ("G", shears)):
            if not np.all(value > 0):
                raise InputError(f"{name}={value!r}: the moduli must be positive")
        _check_ratios(moduli, ratios)
        shape = np.broadcast_shapes(moduli.shape, ratios.shape, shears.shape)[:-1]
        S = np.zeros((*shape, 6, 6))
        for i in range(3):
            S[..., i, i] = 1.0 / moduli[..., i]
        for k, (i, j) in enumerate(((0, 1), (0, 2), (1, 2))):
            S[..., i, j] = S[..., j, i] = -ratios[..., k] / moduli[..., i]
        for k, place in enumerate((5, 4, 3)):
            S[..., place, place] = 1.0 / shears[..., k]
        C = np.linalg.inv(S)
        super().__init__(0.5 * (C + C.swapaxes(-1, -2)), rotation)


def tensor_of(C: Array) -> Array:
    """The tensor C_ijkl of Voigt stiffnesses, shape (3, 3, 3, 3) or (3, 3, 3, 3, ncells)."""
    full = C[..., VOIGT[:, :, None, None], VOIGT[None, None]]
    return np.moveaxis(full, 0, -1) if C.ndim == 3 else full


def _triple(name: str, value: ArrayLike) -> Array:
    found = numbers(name, value)
    if found.ndim not in (1, 2) or found.shape[-1] != 3 or not np.all(np.isfinite(found)):
        raise InputError(
            f"{name}: expected three finite numbers, or three for each cell in an array of shape "
            f"(ncells, 3), got shape {found.shape}"
        )
    return found


def _check_ratios(E: Array, nu: Array) -> None:
    """Raise an `InputError` that names the axes whose ratio makes the energy indefinite."""
    try:
        E, nu = np.broadcast_arrays(E, nu)
    except ValueError:
        raise InputError(f"nu: shape {nu.shape} does not fit E of shape {E.shape}") from None
    for k, (i, j) in enumerate(((0, 1), (0, 2), (1, 2))):
        if not np.all(nu[..., k] ** 2 < E[..., i] / E[..., j]):
            pair = f"{i + 1}{j + 1}"
            raise InputError(
                f"nu: nu{pair}**2 must be less than E{i + 1} / E{j + 1}, else the energy is not "
                f"positive; nu{pair} is the contraction along {j + 1} under tension along {i + 1}"
            )
    a, b, c = nu[..., 0] ** 2, nu[..., 1] ** 2, nu[..., 2] ** 2
    e1, e2, e3 = E[..., 0], E[..., 1], E[..., 2]
    product = 2 * nu[..., 0] * nu[..., 1] * nu[..., 2] * e3 / e1
    if not np.all(a * e2 / e1 + b * e3 / e1 + c * e3 / e2 + product < 1):
        raise InputError(
            "nu: nu12**2 E2/E1 + nu13**2 E3/E1 + nu23**2 E3/E2 + 2 nu12 nu13 nu23 E3/E1 must be "
            "less than 1, else the energy is not positive"
        )


def _checked_stiffness(C: ArrayLike) -> Array:
    found = numbers("C", C)
    if found.ndim not in (2, 3) or found.shape[-2:] != (6, 6) or not np.all(np.isfinite(found)):
        raise InputError(
            "C: expected finite numbers of shape (6, 6) or (ncells, 6, 6), in the order xx, yy, "
            f"zz, yz, zx, xy, got shape {found.shape}"
        )
    skew = np.abs(found - found.swapaxes(-1, -2))
    # Constants from tables are symmetric up to their rounding.
    if skew.max(initial=0.0) > 1e-10 * np.abs(found).max(initial=0.0):
        raise InputError(f"C: must be symmetric; entries differ by {skew.max():.3g} from C^T")
    found = 0.5 * (found + found.swapaxes(-1, -2))
    lowest = np.linalg.eigvalsh(found)
    if not np.all(lowest[..., 0] > 1e-14 * lowest[..., -1]):
        raise InputError(
            f"C: must be positive definite; its lowest eigenvalue is {lowest[..., 0].min():.3g}"
        )
    return found


def _rotated(C: Array, rotation: Any) -> Array:
    if rotation is None:
        return C
    R = _matrices(rotation)
    if C.ndim == 3 and R.ndim == 3 and len(R) != len(C):
        raise InputError(f"rotation: {len(R)} rotations for the stiffness of {len(C)} cells")
    T = np.empty((*R.shape[:-2], 6, 6))  # stresses turn as T sigma, and C becomes T C T^T
    pairs = ((0, 0), (1, 1), (2, 2), (1, 2), (2, 0), (0, 1))
    for I, (i, j) in enumerate(pairs):
        for J, (k, l) in enumerate(pairs):
            T[..., I, J] = R[..., i, k] * R[..., j, l]
            if k != l:
                T[..., I, J] += R[..., i, l] * R[..., j, k]
    turned = T @ C @ T.swapaxes(-1, -2)
    return 0.5 * (turned + turned.swapaxes(-1, -2))


def _matrices(rotation: Any) -> Array:
    """Rotation matrices, shape (3, 3) or (ncells, 3, 3)."""
    # Not isinstance: importing scipy.spatial would slow down every import of this package.
    given = rotation.as_matrix() if hasattr(rotation, "as_matrix") else rotation
    R = numbers("rotation", given)
    if R.ndim < 2 and np.all(np.isfinite(R)):
        turned = np.zeros((*R.shape, 3, 3))
        turned[..., 0, 0] = turned[..., 1, 1] = np.cos(R)
        turned[..., 1, 0], turned[..., 0, 1] = np.sin(R), -np.sin(R)
        turned[..., 2, 2] = 1.0
        return turned
    right = R.ndim in (2, 3) and R.shape[-2:] == (3, 3) and np.all(np.isfinite(R))
    if not right or np.abs(R @ R.swapaxes(-1, -2) - np.eye(3)).max(initial=0.0) > 1e-8:
        raise InputError(
            "rotation: expected an angle, an orthogonal matrix of shape (3, 3) or a scipy "
            f"Rotation, or one of them a cell, got shape {R.shape}"
        )
    return R

"""Random contact problems of periodic layers, and their compliance by the sparse path."""

from dataclasses import dataclass

import numpy as np

from contact import GridContact, PeriodicLayers, Rigid, Rough
from skfem_adini import ElementHexAdini, ElementQuadAdini

ADINI = {2: ElementQuadAdini, 3: ElementHexAdini}


@dataclass(frozen=True, eq=False)
class SparseCompliance:
    """Displacements of the lower nodes by the stiffness matrix of the body on its mesh, a matrix.

    A body that nothing holds is displaced by the pseudo-inverse, its mean force left out: its
    translations are the obstacle's.
    """

    matrix: np.ndarray
    initial: np.ndarray
    block: PeriodicLayers

    def __getattr__(self, name):
        return getattr(self.block, name)

    @classmethod
    def of(cls, block):
        body, dim = block.elastic(), block.dim
        places = body.mesh.p
        low = np.flatnonzero(
            (abs(places[-1]) < 1e-9 * places[-1].max())
            & np.all(
                [(places[a] < (1 - 1e-9) * block.lengths[a]) | block.mirrored[a]
                 for a in range(dim - 1)], axis=0,
            )
        )  # fmt: skip
        at = [np.rint(places[a, low] / block.spacing[a]).astype(int) for a in range(dim - 1)]
        order = np.argsort(np.ravel_multi_index(at, block.shape))
        dofs = body.basis.nodal_dofs[:dim, low[order]].ravel()
        P, u0 = body.constraint
        S = (P.T @ body.stiffness @ P).toarray()
        loads = np.zeros((body.basis.N, dofs.size))
        loads[dofs, np.arange(dofs.size)] = 1.0
        parts = loads.reshape(body.basis.N, dim, -1)
        shares = block.weights.ravel() / block.weights.sum()
        for c in np.flatnonzero(block.constant):
            parts[dofs.reshape(dim, -1)[c], c] -= shares[:, None]
        unit = 1.0 / np.sqrt(np.diag(S))
        scaled = S * unit * unit[:, None]
        solve = np.linalg.inv if not block.constant.any() else _pseudo_inverse
        inverse = unit[:, None] * solve(scaled) * unit
        W = (P @ (inverse @ (P.T @ loads)))[dofs]
        initial = (P @ (inverse @ (P.T @ (-body.stiffness @ u0))) + u0)[dofs]
        if block.constant.any():
            W, initial = _centred(W, block), _centred(initial[:, None], block)[:, 0]
        return cls(W, initial.reshape(dim, *block.shape), block)

    def apply(self, forces):
        return (self.matrix @ forces.ravel()).reshape(forces.shape)


def _pseudo_inverse(S):
    return np.linalg.pinv(S, rcond=1e-13, hermitian=True)


def _centred(columns, block):
    """Displacements without the mean of components that nothing holds."""
    parts = columns.reshape(block.dim, -1, columns.shape[1]).copy()
    for c in np.flatnonzero(block.constant):
        parts[c] -= block.weights.ravel() @ parts[c] / block.weights.sum()
    return parts.reshape(columns.shape)


def random_problem(seed):
    """A block, obstacle, friction and law: `GridContact`, and what distinguishes it."""
    rng = np.random.default_rng([23, seed])
    dim = int(rng.choice([2, 2, 3]))
    unit, modulus = 10 ** rng.uniform(-3, 3), 10 ** rng.uniform(-3, 9)
    adini = bool(rng.random() < 0.4)
    cells = rng.integers(6, 17, 1) if dim == 2 else rng.integers(3, 5 if adini else 7, 2)
    sides = unit * rng.uniform(0.7, 1.5, dim - 1)
    most = 4 if dim == 2 else 3
    layers = [
        (unit * 10 ** rng.uniform(-1.3, -0.3), int(rng.integers(1, most)),
         modulus * 10 ** rng.uniform(-2, 2), rng.uniform(0.0, 0.48))
        for _ in range(rng.integers(1, most))
    ]  # fmt: skip
    loose = bool(rng.random() < 0.25)
    settings = {"plane": str(rng.choice(["strain", "stress"]))} if dim == 2 else {}
    block = PeriodicLayers(
        tuple(sides), layers, tuple(map(int, cells)), top="xyz"[dim - 1] if loose else None,
        element=ADINI[dim]() if adini else None, **settings,
    )  # fmt: skip
    height = sum(layer[0] for layer in layers)
    rise = height * 10 ** rng.uniform(-3, -1.5)
    pressure = rng.uniform(0.1, 0.6) * rise / sum(h / E for h, _, E, _ in layers)
    rough = Rough(-rise * rng.random(block.shape), tuple(sides), interpolation="linear")
    law = str(rng.choice(["none", "coulomb", "tresca"]))
    friction = {"none": 0.0, "coulomb": 1.0, "tresca": pressure}[law] * rng.uniform(0.05, 0.6)
    if law != "none" and rng.random() < 0.5:
        friction = friction * rng.uniform(0.5, 1.0, block.shape)
    grip = np.mean(friction) * (pressure if law == "coulomb" else 1.0) * np.prod(sides)
    along = rng.uniform(-1, 1, dim - 1)
    pressed = bool(rng.random() < 0.5)
    dragged = (loose and law != "none") or bool(rng.random() < 0.3)
    motion, force = [None] * dim, [None] * dim
    for i in range(dim - 1):
        if dragged:
            force[i] = 0.3 * grip * along[i] * (pressed or law == "tresca")
        else:
            motion[i] = rise * along[i]
    if pressed:
        force[-1] = pressure * np.prod(sides)
    else:
        motion[-1] = rise * rng.uniform(0.2, 0.9)
    drive = {"displacement": tuple(motion)} if any(m is not None for m in motion) else {}
    drive |= {"force": tuple(force)} if any(f is not None for f in force) else {}
    contact = GridContact(
        block, Rigid(rough, **drive), friction, "coulomb" if law == "none" else law
    )
    return contact, {
        "dim": dim, "adini": adini, "loose": loose, "law": law, "pressed": pressed,
        "dragged": dragged,
    }  # fmt: skip

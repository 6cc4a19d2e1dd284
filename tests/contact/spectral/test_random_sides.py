"""Random layers between sides of all kinds: contact beside the sparse body, in any units.

Obstacles are moved or driven along rollers and sides that are held, without friction, with Tresca's
and Coulomb's.
"""

from dataclasses import replace

import numpy as np
import pytest
from layer_problems import ADINI, SparseCompliance

from contact import GridContact, PeriodicLayers, Rigid
from contact.spectral.grid_result import certified


def random_block(rng):
    dim = int(rng.choice([2, 2, 3]))
    unit, modulus = (float(10 ** rng.uniform(low, high)) for low, high in ((-9, 6), (-12, 12)))
    kinds = [["x", "y"]] if dim == 2 else [["periodic", "x", "yz"], ["periodic", "y", "xz"]]
    sides = [str(rng.choice(kind)) for kind in kinds]
    cells = [int(rng.integers(2, 12 if dim == 2 else 5)) for _ in sides]
    layers = [
        (unit * rng.uniform(0.1, 0.6), int(rng.integers(1, 4)), modulus * 10 ** rng.uniform(-1, 1),
         float(rng.choice([0.0, 0.3, 0.45])))
        for _ in range(rng.integers(1, 4))
    ]  # fmt: skip
    top = [None, "xyz"[dim - 1], "x"][rng.integers(3)]
    element = ADINI[dim]() if rng.random() < 0.3 else None
    lengths = tuple(unit * rng.uniform(0.7, 1.5, dim - 1))
    return PeriodicLayers(lengths, layers, cells, sides=sides, top=top, element=element)


def random_contact(seed):
    rng = np.random.default_rng([25, seed])
    block = random_block(rng)
    dim, height = block.dim, sum(layer.height for layer in block.layers)
    rise = height * 10 ** rng.uniform(-4, -2)
    gaps = np.where(block.fixed[-1], 1e3 * height, rise * rng.random(block.shape))
    pressure = rise * rng.uniform(0.1, 0.6) / sum(l.height / l.E for l in block.layers)
    law = str(rng.choice(["coulomb", "tresca"]))
    friction = float(rng.choice([0.0, 0.05, 0.3, 1.0])) * (pressure if law == "tresca" else 1.0)
    pressed = bool(block.constant[-1]) or rng.random() < 0.5
    grip = friction * (pressure * pressed if law == "coulomb" else 1.0) * np.prod(block.lengths)
    motion, force = [None] * dim, [None] * dim
    for i in range(dim - 1):
        if block.constant[i] or rng.random() < 0.4:
            force[i] = 0.2 * grip * rng.uniform(-1, 1)
        else:
            motion[i] = rise * rng.uniform(-1, 1)
    if pressed:
        force[-1] = pressure * np.prod(block.lengths)
    else:
        motion[-1] = rise * rng.uniform(0.2, 0.9)
    drive = {"displacement": tuple(motion)} if any(m is not None for m in motion) else {}
    drive |= {"force": tuple(force)} if any(f is not None for f in force) else {}
    return GridContact(block, Rigid(gaps, **drive), friction, law)


def check(seed):
    """The solution passes the certificate with the displacements of the sparse body."""
    contact = random_contact(seed)
    result, dim = contact.solve(), contact.compliance.dim
    sparse = replace(contact, compliance=SparseCompliance.of(contact.compliance))
    problem = sparse._case(None).problem()
    a = -problem.turned(result.motion.reshape(-1, *[1] * (dim - 1))).ravel()
    a[np.isnan(problem.force)] = 0.0
    law = contact._case(None).friction_law(np)
    certified(problem, law, (result.forces, a), contact._controls()[0], 1e-8, ())


@pytest.mark.sampled(6)
@pytest.mark.parametrize("seed", range(24))
def test_contacts_between_sides(seed):
    check(seed)


@pytest.mark.slow
def test_three_hundred_contacts_between_sides():
    for seed in range(300):
        check(seed)

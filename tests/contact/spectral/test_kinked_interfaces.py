"""Layers whose derivatives across an interface are their own, beside a coating's closed form."""

import numpy as np
import pytest
import scipy.linalg
from example_scripts import load

from contact import InputError, PeriodicLayers
from skfem_adini import ElementHexAdini, ElementQuadAdini, ElementQuadBFS

THICK, STIFF, NU = 0.125, 100.0, 0.2  # of the coating, its ground E = 1, nu = .3, depth 1.5
K = 2 * np.pi


def exact():
    """Displacements of the lower side per stress (xz, zz) there, and the coating's transfer."""
    state_matrix = load("validation_periodic").state_matrix
    coating = scipy.linalg.expm(THICK * state_matrix(K, STIFF, NU))
    whole = scipy.linalg.expm(1.5 * state_matrix(K, 1.0, 0.3)) @ coating
    return -np.linalg.solve(whole[:2, :2], whole[:2, 2:]), coating


def block(n, element=None, interfaces="kinked"):
    layers = [(THICK, n // 8, STIFF, NU), (1.5, 3 * n // 2, 1.0, 0.3)]
    element = ElementQuadAdini() if element is None else element
    if isinstance(element, ElementHexAdini):
        return PeriodicLayers((1.0, 0.25), layers, (n, 2), element=element, interfaces=interfaces)
    return PeriodicLayers(1.0, layers, n, element=element, interfaces=interfaces)


def wave_of(body, component):
    """Displacement of a wave of unit tractions along one component."""
    forces = np.zeros((body.dim, *body.shape))
    n = body.shape[0]
    wave = np.cos(K * np.arange(n) / n) * np.prod(body.spacing)
    forces[component] = wave if body.dim == 2 else wave[:, None]
    u = body.apply(forces).reshape(body.dim, n, -1)[..., 0]
    return forces, np.fft.rfft(u, axis=1)[[0, -1], 1] / (n / 2)


@pytest.mark.parametrize("element", [ElementQuadAdini(), ElementQuadBFS(), ElementHexAdini()],
                         ids=lambda e: type(e).__name__)  # fmt: skip
def test_coating_beside_its_closed_form(element):
    """Third order, 3e-5 at 64 points a wave; first order where derivatives are shared."""
    flexible, _ = exact()
    sizes, errors, shared = (16, 32, 64), [], []
    for n in sizes:
        for found, interfaces in ((errors, "kinked"), (shared, "smooth")):
            body = block(n, element, interfaces)
            off = []
            for k, component in enumerate((0, -1)):
                _, u = wave_of(body, component)
                wanted = -flexible[:, k]  # the traction on a lower side is minus the stress
                off.append(np.linalg.norm(u - wanted) / np.linalg.norm(wanted))
            found.append(off)
    assert np.max(errors[-1]) < 3e-5
    rate = -np.polyfit(np.log(sizes), np.log(errors), 1)[0]
    assert np.all((rate > 2.8) & (rate < 4.2))
    rate = -np.polyfit(np.log(sizes), np.log(shared), 1)[0]
    assert np.all((rate > 0.8) & (rate < 1.2))


def test_stress_jumps_as_it_should():
    """Beside the interface, where sigma_xx of the two layers differs by a factor."""
    flexible, coating = exact()
    errors = []
    for n in (32, 64):
        body = block(n)
        forces, _ = wave_of(body, 1)
        state = coating @ np.r_[-flexible[:, 1], 0.0, -1.0]  # of the wave at the interface
        off = []
        for side, (young, ratio) in ((-1e-9, (STIFF, NU)), (1e-9, (1.0, 0.3))):
            mu = young / (2 * (1 + ratio))
            lame = 2 * mu * ratio / (1 - 2 * ratio)
            axial = lame + 2 * mu
            ratio_zz = lame / axial
            xx = 1j * K * (axial - lame * ratio_zz) * state[0] + ratio_zz * state[3]
            x = np.array([0.5 / n, 10.5 / n])
            sigma = body.stress(forces, np.array([x, np.full(2, THICK + side)]))
            size = abs(coating @ np.r_[-flexible[:, 1], 0.0, -1.0])[2:].max()
            for wanted, (i, j) in ((xx, (0, 0)), (state[2], (0, 1)), (state[3], (1, 1))):
                value = (wanted * np.exp(1j * K * x)).real
                off.append(abs(sigma[i, j] - value).max() / max(size, abs(wanted)))
        errors.append(max(off))
    assert errors[1] < 2e-2
    assert errors[1] < 0.4 * errors[0]


def test_displacements_inside_are_of_one_body():
    """Betti: forces on the lower side and what they do on each plane, whichever path has it."""
    body, rng = block(16), np.random.default_rng(0)
    forces = rng.standard_normal((2, *body.shape))
    forces -= forces.mean(axis=1, keepdims=True)
    size = abs(body.apply(forces)).max()
    assert abs(body.displacement(forces, 0) - body.apply(forces)).max() < 1e-11 * size
    x = rng.uniform(0, 1, 5)
    seam = body.displacement(forces, 2)
    nodes = np.array([np.arange(16) / 16, np.full(16, THICK)])
    assert abs(body.sample(forces, nodes) - seam).max() < 1e-11 * size
    for z in (THICK - 1e-10, THICK + 1e-10):
        near = body.sample(forces, np.array([x, np.full(5, z)]))
        assert abs(near - body.sample(forces, np.array([x, np.full(5, THICK)]))).max() < 1e-8 * size


def test_kinks_make_a_body_softer():
    forces = np.random.default_rng(1).standard_normal((2, 16))
    kinked, smooth = (np.vdot(forces, block(16, interfaces=i).apply(forces))
                      for i in ("kinked", "smooth"))  # fmt: skip
    assert kinked > (1 + 1e-4) * smooth
    assert block(16).unknowns == block(16, interfaces="smooth").unknowns + 2 * 16


def test_without_kinks_nothing_changes():
    """Linear cells have no derivatives, one material no kink."""
    forces = np.random.default_rng(2).standard_normal((2, 8))
    cases = (None, [(0.2, 2, 5.0, 0.2), (0.5, 3, 1.0, 0.3)]), (
        ElementQuadAdini(), [(0.2, 2, 1.0, 0.3), (0.5, 3, 1.0, 0.3)])  # fmt: skip
    for element, layers in cases:
        bodies = [PeriodicLayers(1.0, layers, 8, element=element, interfaces=interfaces)
                  for interfaces in ("kinked", "smooth")]  # fmt: skip
        assert np.array_equal(bodies[0].apply(forces), bodies[1].apply(forces))
        assert bodies[0].elastic().basis.N == bodies[1].elastic().basis.N


def test_what_is_refused():
    with pytest.raises(InputError, match="interfaces='rough': expected 'smooth' or 'kinked'"):
        block(8, interfaces="rough")
    with pytest.raises(InputError, match="interfaces=array"):
        block(8, interfaces=np.array(["smooth", "kinked"]))
    with pytest.raises(InputError, match="interfaces: a mesh shares all derivatives"):
        block(8).elastic()

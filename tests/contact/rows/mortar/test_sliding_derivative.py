"""The derivative of the projection against central differences of the projection itself."""

import numpy as np
import pytest
from families import PLANE, SOLID
from scipy import sparse
from solid_boxes import box
from two_blocks import block, ring

from contact.body.rigid_modes import dof_kinds, rigid_field, value_dofs
from contact.rows.mortar.mortar_rows import Interface, chart, trace_of_nodes
from contact.rows.mortar.sliding_derivative import SlidingDerivative, turning_normals

STEP = 1e-6
pytestmark = pytest.mark.filterwarnings("ignore:the cells are not parallelepipeds")


def field(body, rng, size):
    """A smooth displacement, in the values and the derivatives of the element."""
    u, x, kinds = np.zeros(body.basis.N), body.basis.doflocs, dof_kinds(body.basis)
    for c in range(body.dim):
        a, b, d = size * rng.normal(), rng.normal(), size * rng.normal()
        own = np.arange(u.size) % body.dim == c
        wave = a * np.sin(1.3 * x[0] + b) + d * np.cos(0.7 * x[-2]) * x[-1]
        u += np.where(own & value_dofs(body), wave, 0.0)
        slopes = np.zeros((body.dim, u.size))
        slopes[0] += 1.3 * a * np.cos(1.3 * x[0] + b)
        slopes[-2] -= 0.7 * d * np.sin(0.7 * x[-2]) * x[-1]
        slopes[-1] += d * np.cos(0.7 * x[-2])
        for k, slope in enumerate(slopes):
            u += np.where(own & (kinds == k), slope, 0.0)
    return u


def ring_part(x):
    """The middle third of a half ring of outer radius 2."""
    return ring(1.0, (0.0, 0.0), np.pi / 3)(np.array([2 - x[1], x[0]]))


def bent(x):
    """Both boxes bent about the y axis, by a radius of four."""
    angle, radius = (x[0] - 0.5) / 4.0, 4.0 + x[2]
    return np.array([radius * np.sin(angle), x[1], radius * np.cos(angle) - 4.0])


def tilted(x):
    a, b = 0.8, 0.5
    one = np.array([[np.cos(a), 0, np.sin(a)], [0, 1, 0], [-np.sin(a), 0, np.cos(a)]])
    two = np.array([[1, 0, 0], [0, np.cos(b), -np.sin(b)], [0, np.sin(b), np.cos(b)]])
    return one @ two @ bent(x)


def bodies(element, place):
    """Of one deformation of sizes of a hundredth in the plane, of a thousandth in space."""
    if element in PLANE:
        upper = block(element, np.linspace(0.2, 0.8, 6), [0.01, 0.3, 0.6], place=place)
        return upper, block(element, np.linspace(0.0, 1.0, 11), [-0.6, -0.3, 0.0], place=place)
    upper = box(element, (2, 2, 1), (0.2, 0.25, 1.002), (0.6, 0.5, 0.4), place=place)
    return upper, box(element, (4, 5, 1), place=place)


def state(element, place):
    rng, size = np.random.default_rng(7), 1e-2 if element in PLANE else 1e-3
    upper, lower = pair = bodies(element, place)
    facets = upper.facets("bottom"), lower.facets("top")
    interface = Interface.of(upper, facets[0], lower, facets[1], "dual")
    fields = [field(body, rng, size) for body in pair * 2]
    return interface, fields, [field(body, rng, 1.0) for body in pair], rng


@pytest.mark.sampled(3)
@pytest.mark.parametrize(
    ("element", "place"),
    [(e, p) for e in PLANE for p in (None, ring_part)]
    + [(e, p) for e in SOLID for p in (None, bent, tilted)],
)
def test_derivatives_of_gap_slip_and_forces(element, place):
    interface, (u, v, du, dv), (a, b), _rng = state(element, place)
    found, solid = interface.displaced(u, v), element in SOLID
    # Pressures that vary little over a facet: how forces are shared between points is held.
    mu = found.rows.weights * (1.0 + 0.1 * found.rows.x_nominal[0])
    t = 0.3 * np.repeat(mu[:, None], interface.first.body.dim - 1, axis=1)
    t = t if solid else t[:, 0]
    derivative = SlidingDerivative.of(interface, found, (u, v), (du, dv), (mu, t))

    def at(step):
        now = interface.displaced(u + step * a, v + step * b)
        rows = now.rows
        through = rows.G @ (u + step * a) + now.other_G @ (v + step * b) - rows.gap
        slip = rows.T @ (du + step * a) + now.other_T @ (dv + step * b)
        own = rows.G.T @ mu + rows.T.T @ t.ravel()
        theirs = now.other_G.T @ mu + now.other_T.T @ t.ravel()
        return through, slip, np.concatenate((own, theirs))

    along = np.concatenate((a, b))
    G = sparse.hstack((found.rows.G, found.other_G)) @ along
    T = sparse.hstack((found.rows.T, found.other_T)) @ along
    ours = G + derivative.normal @ along, T + derivative.tangential @ along
    ours += (derivative.force @ along,)
    # The ends of segments, and how forces are shared between the points of facets of other sizes,
    # are held, which matters in the plane as much as the gap is open.
    limits = (1e-5, 1e-3, 3e-2) if solid else (2e-2,) * 3
    for mine, ahead, behind, limit in zip(ours, at(STEP), at(-STEP), limits, strict=True):
        exact = (ahead - behind) / (2 * STEP)
        assert np.abs(mine - exact).max() <= limit * np.abs(exact).max()
    if (
        solid and place is not None
    ):  # without the derivative the conditions would be off by far more
        assert np.abs(derivative.normal @ along).max() > 1e-2 * np.abs(ours[0]).max()


elements = pytest.mark.parametrize("element", SOLID, ids=lambda e: e.__name__)


@elements
def test_a_rotation_turns_the_normals_by_itself(element):
    interface, (u, *_), _, _rng = state(element, tilted)
    outline = interface.first
    facet, X = np.arange(outline.facets.size), np.full((2, outline.facets.size), 0.3)
    maps = chart(outline, 0.0 * u)
    parts = turning_normals(outline, maps, trace_of_nodes(outline), facet, X)
    rotations = rigid_field(outline.body, np.zeros(3))[:, 3:]
    n = maps.direction(facet, X)
    for axis, motion in zip(np.eye(3), rotations.T, strict=True):
        turned = np.cross(axis, n, axisb=0, axisc=0)
        assert np.abs(np.array([part @ motion for part in parts]) - turned).max() <= 1e-11

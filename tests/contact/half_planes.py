"""Two blocks so large that, where they touch, they are half planes; the gap is x^2 / 2R."""

import numpy as np
from skfem import MeshQuad

from contact import ContactProblem, ElasticBody

FAR = 100.0  # size of the blocks, in half-widths of contact


def ticks(step, fine, ratio=1.25):
    """From 0 to FAR: equal steps up to `fine`, then growing."""
    found = list(np.arange(round(fine / step) + 1) * step)
    while found[-1] < FAR:
        step *= ratio
        found.append(found[-1] + step)
    found[-1] = FAR
    if found[-1] - found[-2] < 0.5 * (found[-2] - found[-3]):
        del found[-2]
    return np.array(found)


def block(element, cells, up, E, nu, flat=0.25, half=False):
    """Above or below y = 0, of `cells` cells a unit of length, `flat` times as high as wide."""
    x, y = ticks(1 / cells, 1.4), ticks(flat / cells, flat / cells)
    x = x if half else np.r_[-x[:0:-1], x]
    mesh = MeshQuad.init_tensor(x, y if up else -y[::-1]).with_defaults()
    return ElasticBody.from_mesh(mesh, element(), E=E, nu=nu)


def pressed(upper, lower, radius, friction, **more):
    """Upper's multipliers; the gap of a cylinder between the two."""
    surface = lower.surface("top", clearance=lambda x: x[0] ** 2 / (2 * radius))
    return ContactProblem(upper, "bottom", surface, friction=friction, **more)

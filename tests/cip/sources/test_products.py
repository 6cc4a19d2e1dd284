"""Moments of products: transposes, products of factors, closed forms."""

import numpy as np
import pytest

from cip import Grid, State
from cip.formulas.formula import Formula
from cip.sources.reaction import NodalMoments, Products

LINE = np.linspace(0, 1, 9)
GRIDS = {
    "periodic": lambda dim: Grid([(0, 1)] * dim, (6, 5, 4)[:dim], periodic=True),
    "walls": lambda dim: Grid.from_coordinates(*[LINE[: 9 - 2 * d] ** 1.2 for d in range(dim)]),
}
SCHEMES = [
    ("cubic", 1), ("quintic", 1), ("csl2", 1), ("csl4", 1), ("adini", 2), ("bicubic", 2),
    ("cubic", 2), ("csl2", 2), ("csl4", 2), ("quintic", 3), ("csl2", 3),
]  # fmt: skip
every_scheme = pytest.mark.parametrize(("profile", "dim"), SCHEMES)
every_grid = pytest.mark.parametrize("grid", GRIDS)


def factors(grid, products, text):
    integrals = NodalMoments(grid, Formula.of(text, grid.bounds, "g"), True, np)
    node = Formula.of(text, grid.bounds, "g").expression
    return {
        key: integrals.integral(node, moment, 0.0, 1.0, midpoints=True)
        for key, moment in products.wanted.items()
    }


@every_scheme
@every_grid
def test_the_transpose(profile, dim, grid):
    grid = GRIDS[grid](dim)
    products, rng = Products(grid, profile, np), np.random.default_rng(3)
    known = factors(grid, products, "1.5 + x1**2" + " - 0.3*x2*x1" * (dim > 1))
    shape = State.from_function(1.0, grid, profile).data.shape
    data, weight = rng.standard_normal(shape), rng.standard_normal(shape)
    new, back = products.times(data, known), products.transposed(weight, known)
    size = np.abs(weight * new).sum() + np.abs(data * back).sum()
    assert abs(np.sum(weight * new) - np.sum(data * back)) <= 1e-14 * size


@every_scheme
@every_grid
def test_products_follow_each_other_as_their_factors(profile, dim, grid):
    """The moments of (g f) u in two ways; those of g and of f by themselves."""
    grid = GRIDS[grid](dim)
    products, more = Products(grid, profile, np), " + x2" * (dim > 1)
    g, f = "1 + x1" + more, "2 - x1" + more
    data = State.from_function("sin(x1) + 2" + more, grid, profile).data
    one, other = (factors(grid, products, text) for text in (g, f))
    both = factors(grid, products, f"({g})*({f})")
    found = products.times(products.times(data, other), one)
    np.testing.assert_allclose(found, products.times(data, both), rtol=0, atol=1e-13)


@every_grid
@pytest.mark.parametrize("profile", ["cubic", "quintic", "csl2", "csl4"])
def test_means_and_derivatives_of_a_polynomial(profile, grid):
    """(1 + x) u with u = 2 - x + x^2: of degree three, which the rule for means takes exactly."""
    grid = GRIDS[grid](1)
    products = Products(grid, profile, np)
    data = State.from_function("2 - x1 + x1**2", grid, profile).data
    if grid.periodic[0]:  # not a periodic function: away from the ends
        inner = slice(0, grid.nodes[0] - 1)
    else:
        inner = slice(None)
    expected = State.from_function("(1 + x1)*(2 - x1 + x1**2)", grid, profile).data
    found = products.times(data, factors(grid, products, "1 + x1"))
    np.testing.assert_allclose(found[:, inner], expected[:, inner], rtol=0, atol=1e-13)

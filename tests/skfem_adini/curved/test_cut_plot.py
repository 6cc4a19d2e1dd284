"""Pictures of cut domains show every kind of cell."""

import matplotlib.pyplot as plt
import numpy as np
import pytest
from skfem import Basis

from skfem_adini import AdiniExtension, CutDomain, ElementQuadAdini
from skfem_adini.plot import plot_cut_domain, plot_cut_field


@pytest.fixture
def domain(cut_problems):
    return CutDomain(cut_problems.unit_square(8), cut_problems.LEVEL_SETS["disk"], q=3)


def test_cells(domain):
    basis = Basis(domain.mesh, ElementQuadAdini(), intorder=1)
    extension = AdiniExtension(basis, domain)
    ax = plot_cut_domain(domain, extension)
    drawn = {c.get_label(): len(c.get_paths()) for c in ax.collections}
    assert drawn["full"] == domain.full.size
    assert drawn["cut"] + drawn["aggregated"] == domain.cut.size
    assert drawn["ghost facets"] == domain.ghost_facets.size
    assert "extension" in drawn
    plain = plot_cut_domain(domain, ax=plt.figure().add_subplot())
    assert {c.get_label() for c in plain.collections} == {"full", "cut", "ghost facets"}
    plt.close("all")


def test_field_and_error(domain):
    element = ElementQuadAdini()
    x = Basis(domain.mesh, element).project(lambda x: x[0] ** 3)
    whole, dots = plot_cut_field(domain, element, x).collections
    assert 0 < dots.get_array().min() < dots.get_array().max() < 1
    assert whole.get_clim() == dots.get_clim()
    # The surfaces are x^3 at the corners of the full cells and between.
    assert 0 < whole.get_array().min() < whole.get_array().max() < 1
    assert whole.get_array().size == 36 * domain.full.size
    whole, dots = plot_cut_field(domain, element, x, exact=lambda x: x[0] ** 3).collections
    assert max(whole.get_array().max(), dots.get_array().max()) < -10
    (inside,) = [np.hypot(*(dots.get_offsets() - 0.5).T)]
    assert inside.max() < 0.411
    plt.close("all")

"""Facets, and the cells beside them, are numbered as scikit-fem does it."""

from dataclasses import replace

import numpy as np
import pytest
from skfem import (
    MeshHex,
    MeshHex2,
    MeshLine,
    MeshQuad,
    MeshQuad2,
    MeshTet,
    MeshTet2,
    MeshTri,
    MeshTri2,
    MeshWedge1,
)

from contact.body.cell_check import number_facets


def shuffled(mesh):
    """The same mesh with its vertices and cells numbered at random."""
    rng = np.random.default_rng(4)
    places = rng.permutation(mesh.p.shape[1])
    t = np.argsort(places)[mesh.t][:, rng.permutation(mesh.t.shape[1])]
    return replace(mesh, doflocs=mesh.p[:, places], t=t.astype(np.int32))


def three_cells_at_a_facet():
    mesh = MeshTri().refined(1)
    return MeshTri(mesh.p, np.hstack([mesh.t, mesh.t[:, :2]]))


def three_common_corners():
    """Two bricks whose facets have three corners in common, and not the fourth."""
    p = np.hstack([MeshHex().p, [[0.5], [0.5], [2.0]]])
    one = MeshHex().t
    return MeshHex(p, np.hstack([one, np.where(one == one.max(), 8, one)]))


MESHES = {
    "triangles": lambda: shuffled(MeshTri().refined(3)),
    "rectangles": lambda: shuffled(MeshQuad().refined(3)),
    "tetrahedra": lambda: shuffled(MeshTet().refined(2)),
    "bricks": lambda: shuffled(MeshHex().refined(2)),
    "curved triangles": lambda: MeshTri2.from_mesh(MeshTri().refined(2)),
    "curved quadrilaterals": lambda: MeshQuad2.from_mesh(MeshQuad().refined(2)),
    "curved tetrahedra": lambda: MeshTet2.from_mesh(MeshTet().refined(1)),
    "curved bricks": lambda: MeshHex2.from_mesh(MeshHex().refined(1)),
    "three cells at a facet": three_cells_at_a_facet,
    "three common corners": three_common_corners,
}


def agree(ours, theirs):
    for name in ("facets", "t2f", "f2t"):
        one, other = getattr(ours, name), getattr(theirs, name)
        np.testing.assert_array_equal(one, other)
        assert one.dtype == other.dtype


@pytest.mark.parametrize("name", MESHES)
def test_numbers_are_those_of_scikit_fem(name):
    ours, theirs = MESHES[name](), MESHES[name]()
    number_facets(ours)
    assert hasattr(ours, "_f2t") == (name != "three common corners")
    agree(ours, theirs)


@pytest.mark.parametrize("kind", [MeshLine, MeshWedge1])
def test_other_cells_are_left_alone(kind):
    mesh = kind()
    number_facets(mesh)
    assert not hasattr(mesh, "_t2f")


def test_numbers_that_are_there_are_kept():
    mesh = MESHES["bricks"]()
    facets = mesh.facets
    number_facets(mesh)
    assert mesh.facets is facets

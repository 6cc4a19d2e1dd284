"""Elements of first order on curved cells hold no rotation without strain: the remedy is named."""

from dataclasses import replace

import numpy as np
import pytest
from skfem import (
    ElementHex1,
    ElementQuad1,
    ElementQuad2,
    ElementTetP1,
    ElementTriP1,
    ElementTriP2,
    MeshHex,
    MeshHex2,
    MeshQuad,
    MeshQuad2,
    MeshTet,
    MeshTet2,
    MeshTri,
    MeshTri2,
)

from contact import ContactProblem, ElasticBody, NotConverged


def pressed(plain, curved, element, bent=True, held=False):
    ticks = np.linspace(0, 1, 4)
    mesh = curved.from_mesh(plain.init_tensor(*(ticks,) * element().refdom.p.shape[0]))
    x = mesh.doflocs.copy()
    if bent:
        x[0] += 0.1 * (x[0] - 0.5) * np.sin(3 * x[-1])
        x[-1] += 0.15 * x[-1] * np.sin(2 * x[0])
    mesh = replace(mesh, doflocs=x).with_boundaries(
        {"bottom": lambda x: x[-1] == 0, "top": lambda x: x[-1] > 0.95}
    )
    body = ElasticBody.from_mesh(mesh, element(), E=1.0, nu=0.3)
    body.load("top", np.r_[np.zeros(len(x) - 1), -0.01])
    return ContactProblem(body.fix("top") if held else body, "bottom", 0.0, 0.4)


@pytest.mark.sampled(2)
@pytest.mark.parametrize(
    ("plain", "curved", "element", "remedy"),
    [
        (MeshTri, MeshTri2, ElementTriP1, r"P2 elements \(ElementTriP2\)"),
        (MeshQuad, MeshQuad2, ElementQuad1, r"Q2 elements \(ElementQuad2\)"),
        (MeshTet, MeshTet2, ElementTetP1, r"P2 elements \(ElementTetP2\)"),
        (MeshHex, MeshHex2, ElementHex1, r"Q2 elements \(ElementHex2\)"),
    ],
    ids=lambda v: getattr(v, "__name__", ""),
)
def test_remedy(plain, curved, element, remedy):
    with pytest.raises(NotConverged, match=remedy):
        pressed(plain, curved, element).solve()
    # Neither straight cells nor a body that is held have this trouble.
    for others in ({"bent": False}, {"held": True}):
        assert max(pressed(plain, curved, element, **others).solve().kkt.values()) < 1e-10


@pytest.mark.parametrize(
    "kind", [(MeshTri, MeshTri2, ElementTriP2), (MeshQuad, MeshQuad2, ElementQuad2)]
)
def test_it_is_one(kind):
    result = pressed(*kind).solve()
    assert max(result.kkt.values()) < 1e-10

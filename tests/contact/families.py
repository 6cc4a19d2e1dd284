"""Elements the contact tests run over, and the meshes of each: straight cells and curved ones."""

from skfem import (
    ElementHex1,
    ElementHex2,
    ElementQuad1,
    ElementQuad2,
    ElementTetP1,
    ElementTetP2,
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

from skfem_adini import ElementHexAdini, ElementQuadAdini, ElementQuadBFS

PLANE = [ElementTriP1, ElementTriP2, ElementQuad1, ElementQuad2, ElementQuadAdini]
SOLID = [ElementTetP1, ElementTetP2, ElementHex1, ElementHex2, ElementHexAdini]
PLANE_AND_BFS = [*PLANE, ElementQuadBFS]  # those of rectangles too
STRAIGHT = {
    ElementTriP1: MeshTri,
    ElementTriP2: MeshTri,
    ElementQuad1: MeshQuad,
    ElementQuad2: MeshQuad,
    ElementQuadAdini: MeshQuad,
    ElementQuadBFS: MeshQuad,
    ElementTetP1: MeshTet,
    ElementTetP2: MeshTet,
    ElementHex1: MeshHex,
    ElementHex2: MeshHex,
    ElementHexAdini: MeshHex,
}
CURVED = {
    ElementTriP1: MeshTri2,
    ElementTriP2: MeshTri2,
    ElementQuad1: MeshQuad2,
    ElementQuad2: MeshQuad2,
    ElementTetP1: MeshTet2,
    ElementTetP2: MeshTet2,
    ElementHex1: MeshHex2,
    ElementHex2: MeshHex2,
}

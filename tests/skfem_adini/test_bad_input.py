"""Whatever is given to a public function, it answers or an InputError names the cause."""

import sys
from functools import partial

import matplotlib.pyplot as plt
import numpy as np
import pytest
import skfem
from scipy import sparse
from skfem import Basis, ElementHex1, ElementQuad1, ElementTriP1, ElementVector, MeshHex, MeshQuad
from skfem.models.poisson import laplace, mass

from skfem_adini import (
    AdiniError,
    AdiniExtension,
    CutDomain,
    ElementHexAdini,
    ElementQuadAdini,
    ElementQuadAdiniCut,
    ElementQuadAdiniWeighted,
    ElementQuadBFS,
    FieldLevelSet,
    InputError,
    LevelSet,
    MissingDependency,
    Polygon,
    UniformSolver,
    assemble,
    cut_quadrature,
    essential_constraints,
    essential_dofs,
    factorize,
    ghost_penalty,
    hanging_constraints,
    lowest_eigenpairs,
    near_null_space,
    nitsche,
    nodal_gradient,
    nodal_stress,
    project_trace,
    refine_eigenpair,
    refined_at_boundary,
    save,
    to_pyvista,
    von_mises,
)
from skfem_adini.plot import plot_matrix, plot_shape_function

ADINI = ElementQuadAdini()
MESH = MeshQuad().refined(2).with_defaults()
SCALAR, VECTOR = Basis(MESH, ADINI), Basis(MESH, ElementVector(ElementQuadAdini(1)))
Q1, BRICK = Basis(MESH, ElementQuad1()), Basis(MeshHex().with_defaults(), ElementHexAdini())
GRID = MeshQuad.init_tensor(*[np.linspace(-1, 1, 9)] * 2)


def phi(x):
    return x[0] ** 2 + x[1] ** 2 - 0.6


def slope(x):
    return -2 * x


def nan(x):
    return np.full(x.shape[1:], np.nan)


DOMAIN, ON_GRID = CutDomain(GRID, phi), Basis(GRID, ADINI)
CURVE, EXTENSION = DOMAIN.boundary(ADINI), AdiniExtension(ON_GRID, DOMAIN)
VECTOR_CURVE = DOMAIN.boundary(ElementVector(ElementQuadAdini(1)))
STIFFNESS = DOMAIN.assemble(laplace, ADINI)
T, X0 = essential_constraints(SCALAR)
WEIGHTED = Basis(GRID, ElementQuadAdiniWeighted(lambda x: -phi(x), slope))
K, M = laplace.assemble(SCALAR), mass.assemble(SCALAR)
MODE = lowest_eigenpairs(K, M, 2)[1][:, 1]
ZERO, FIELD, NO_NUMBER = SCALAR.zeros(), {"u": SCALAR.zeros()}, np.nan * T
VECTORS = {
    "nan": np.full(SCALAR.N, np.nan),
    "one nan": np.where(np.arange(SCALAR.N) == 3, np.nan, 0.0),
    "inf": np.full(SCALAR.N, -np.inf),
    "too short": np.zeros(3),
    "column": np.zeros((SCALAR.N, 1)),
    "none": None,
    "text": "u",
    "objects": np.array([None] * SCALAR.N),
    "complex": 1j * np.ones(SCALAR.N),
    "ragged": [[1, 2], [3]],
    "matrix": K,
    "masked": np.ma.masked_equal(np.arange(float(SCALAR.N)), 3.0),
}
COMPLEX = VECTORS["complex"]  # loads may be complex
OF_VECTORS = {
    "nodal_gradient": lambda x: nodal_gradient(SCALAR, x),
    "to_pyvista": lambda x: to_pyvista(SCALAR, x),
    "to_pyvista named": lambda x: to_pyvista(SCALAR, {"u": x}),
    "FieldLevelSet": lambda x: FieldLevelSet(SCALAR, x),
    "hanging x0": lambda x: hanging_constraints(SCALAR, (T, x)),
    "von_mises": von_mises,
    "value of constraints": lambda x: essential_constraints(SCALAR, None, x),
    "value of trace": lambda x: project_trace(SCALAR, None, x),
    "value of nitsche": lambda x: nitsche(CURVE, x),
    "coefficient": lambda x: nitsche(CURVE, coefficient=x),
    "load": lambda x: EXTENSION.load(None if x is COMPLEX else x),
    "solve": lambda x: EXTENSION.solve(STIFFNESS, None if x is COMPLEX else x),
    "expand": lambda x: EXTENSION.expand(None if x is COMPLEX else x),
    "apply": EXTENSION.apply,
}
BASES = [None, "u", MESH, ADINI, Q1]
OF_BASES = {
    "essential_dofs": essential_dofs,
    "essential_constraints": essential_constraints,
    "hanging_constraints": hanging_constraints,
    "near_null_space": near_null_space,
    "project_trace": lambda basis: project_trace(basis, None, 1.0),
    "nodal_gradient": lambda basis: nodal_gradient(basis, np.zeros(25)),
    "nodal_stress": lambda basis: nodal_stress(basis, np.zeros(25), 1.0, 0.3),
    "AdiniExtension": lambda basis: AdiniExtension(basis, DOMAIN),
    "domain": lambda domain: AdiniExtension(ON_GRID, domain),
    "nitsche": nitsche,
    "ghost_penalty": lambda domain: ghost_penalty(domain, ADINI),
    "to_pyvista": lambda basis: to_pyvista(basis, np.zeros(7)),
    "save": lambda basis: save("never.vtu", basis, {"u": np.zeros(7)}),
    "series": lambda basis: save("never.pvd", basis, [(0.0, {"u": np.zeros(7)})]),
    "refine_eigenpair": lambda basis: refine_eigenpair(basis, np.zeros(25)),
}


@pytest.mark.parametrize("call", OF_VECTORS)
def test_vectors(call):
    for what, x in VECTORS.items():
        with pytest.raises(InputError):
            pytest.fail(f"{what} is taken: {OF_VECTORS[call](x)}")


@pytest.mark.parametrize("call", OF_BASES)
def test_bases(call):
    for basis in BASES:
        with pytest.raises(InputError):
            pytest.fail(f"{basis} is taken: {OF_BASES[call](basis)}")


@pytest.mark.parametrize("kind", [ElementQuadAdini, ElementQuadBFS, ElementHexAdini])
def test_orders_of_derivatives(kind):
    for given in (True, False, np.True_, 7, -1, 1.5, "2", [1], np.array([1, 2]), np.nan):
        with pytest.raises(InputError, match="derivatives: expected 0 to 6"):
            kind(derivatives=given)


@pytest.mark.parametrize("suffix", ["vtu", "vtk", "pvd"])
def test_files_are_not_written(tmp_path, suffix):
    """Of a series not even the first step, which is sound."""
    path = tmp_path / f"field.{suffix}"
    for bad in (x for what, x in VECTORS.items() if what != "column"):
        if suffix == "pvd":
            with pytest.raises(InputError):
                save(path, SCALAR, [(0.0, FIELD), (1.0, {"u": bad})])
            if bad is not None:
                with pytest.raises(InputError):
                    save(path, SCALAR, [(0.0, FIELD), (1.0, FIELD, {"s": bad})])
        else:
            with pytest.raises(InputError):
                save(path, SCALAR, {"u": bad})
            for data in ("point_data", "cell_data"):
                with pytest.raises(InputError, match=data):
                    save(path, SCALAR, FIELD, **{data: {"s": bad}})
    assert not list(tmp_path.iterdir())


def eigen(**wrong):
    return lowest_eigenpairs(**{"K": K, "M": M, "count": 2} | wrong)


def half(mesh=GRID):
    return CutDomain(mesh, lambda x: x[0] - 0.6)


def edge(vector=False):
    return half().boundary(ElementVector(ADINI) if vector else ADINI)


def grid(x, *cells):
    mesh = MeshQuad.init_tensor(np.array(x, float), np.arange(4.0))
    return Basis(mesh.remove_elements(np.array(cells, int)) if cells else mesh, ADINI)


def with_amg(modes):
    return factorize(K + M, solver="amg", near_null=modes)


def extended(extension):
    return nitsche(CURVE, extension=extension)


def weighted(weight, gradient=slope):
    return Basis(MESH, ElementQuadAdiniWeighted(weight, gradient))


stress = partial(nodal_stress, VECTOR, VECTOR.zeros())
pyvista = partial(to_pyvista, SCALAR, ZERO)
solver = partial(UniformSolver, (4, 4))
held = partial(essential_dofs, VECTOR, "left")
refined = partial(refine_eigenpair, SCALAR)
with_k = partial(assemble, laplace, MESH, ADINI)
UNIT = np.zeros((2, 1)), np.ones((2, 1))
TRIANGLES = Basis(skfem.MeshTri(), ElementTriP1())
PAIR = Basis(MESH, ElementQuad1() * ElementQuad1())
VECTORS_ON_GRID = Basis(GRID, ElementVector(ADINI))
OF_ONE_CELL = essential_constraints(Basis(MeshQuad().with_defaults(), ADINI), "left")
SOLID = Basis(MeshHex(), ElementVector(ElementHexAdini(1)))
CORNER, ON_FACETS = Basis(MESH, ADINI, elements=[0]), (skfem.FacetBasis, skfem.InteriorFacetBasis)
NO_SERIES = FIELD, None, "steps", [1, 2], [(0.0,)], [("0", FIELD)], [(np.nan, np.zeros(1))]
NO_SERIES += ([(0.0, {}, {}, {})],)
STEP = lambda x: np.sign(np.hypot(*(x - 0.5)) - 0.411)  # noqa: E731
DOUBLE = lambda x: (x[0] - 0.51) ** 2 * (x[1] - 2)  # noqa: E731
THIN, NO_PLACES = lambda x: (x[0] - 0.1) ** 2 - 1e-6, (1, lambda x: x[0] * np.nan, lambda x: x > 0)
SQUARE = Polygon([[0.1, 0.8, 0.8, 0.1], [0.1, 0.1, 0.8, 0.8]])
TURNED = MeshQuad(np.array([[0.8, -0.6], [0.6, 0.8]]) @ GRID.p, GRID.t)
SHEARED = Basis(MeshQuad(np.array([[1, 0.4], [0, 1]]) @ MESH.p, MESH.t), ADINI)
NAN_MESH = MeshQuad(np.where(MESH.p == 0, np.nan, MESH.p), MESH.t)
FLAT = MeshQuad(MESH.p * [[1.0], [0.0]], MESH.t)
FLAT_BRICK = MeshHex(MeshHex().p * [[1.0], [1], [0]], MeshHex().t)
LARGE = Basis(MeshQuad().refined(5), ADINI)
WEIGHT = lambda x: -phi(x)  # noqa: E731
HIDDEN = lambda x: np.ma.masked_greater(x[0] - 0.5, 0.2)  # noqa: E731


def rows(words, call, *values):
    return [(words, lambda v=v: call(v)) for v in values]


# Words of the message, and a call that it is for.
TABLE = [
    # Conditions.
    ("lid.*bottom", lambda: essential_dofs(SCALAR, "lid")),
    ("facets.* empty|empty", lambda: essential_dofs(SCALAR, lambda x: x[0] > 9)),
    ("facets.* empty|empty", lambda: essential_constraints(SCALAR, {})),
    ("facets.* empty|empty", lambda: project_trace(SCALAR, np.array([], dtype=int), 1.0)),
    ("0 to 39", lambda: essential_dofs(SCALAR, np.array([99]))),
    ("0 to 5", lambda: essential_dofs(BRICK, np.array([6]))),
    *rows("facets", partial(essential_dofs, SCALAR), 1.5, np.array([None, 1]), np.array([np.nan])),
    *rows("components", lambda c: held(components=c), 2, 0.9, [[0], [0, 1]], []),
    *rows("NaN", lambda basis: essential_constraints(basis, "left", nan), SCALAR, BRICK),
    ("NaN", lambda: project_trace(BRICK, "left", nan)),
    ("expected 1", lambda: project_trace(BRICK, "left", (1, 2))),
    ("expected 2", lambda: essential_constraints(VECTOR, "left", (1, 2, 3))),
    ("shape", lambda: essential_constraints(VECTOR, "left", lambda x: x[0])),
    ("real number", lambda: essential_constraints(SCALAR, "left", "zero")),
    ("real number", lambda: project_trace(SCALAR, "left", 1j)),
    *[
        ("u over the weight", partial(f, WEIGHTED))
        for f in (essential_dofs, essential_constraints, near_null_space)
    ],
    ("u over the weight", lambda: nodal_gradient(WEIGHTED, WEIGHTED.zeros())),
    ("u over the weight", lambda: project_trace(WEIGHTED, None, 1.0)),
    ("essential: expected T and x0 with", lambda: hanging_constraints(SCALAR, OF_ONE_CELL)),
    *rows("essential", partial(hanging_constraints, SCALAR), T, (NO_NUMBER, X0), (T.toarray(), X0)),
    *rows("expected ElementQuadAdini", hanging_constraints, Q1, Basis(MESH, ElementQuadBFS())),
    # Output, nodal fields, pictures.
    ("length 75", lambda: to_pyvista(SCALAR, np.zeros(5))),
    ("length 32", lambda: to_pyvista(BRICK, np.zeros(5))),
    (
        r"x\['u'\]: 1 of 75 entries are NaN.*nan at \(3,\)",
        lambda: to_pyvista(SCALAR, VECTORS["one nan"]),
    ),
    ("cell basis", lambda: to_pyvista(skfem.FacetBasis(MESH, ADINI), ZERO)),
    *rows("subdivide", lambda v: pyvista(subdivide=v), 0, True, 1.5),
    ("power of two", lambda: to_pyvista(TRIANGLES, TRIANGLES.zeros(), subdivide=3)),
    ("cell_data", lambda: pyvista(cell_data={"c": np.zeros(5)})),
    *rows("point_data", lambda v: pyvista(point_data=v), {"c": np.zeros(5)}, np.zeros(25)),
    ("composite|scalar or vector", lambda: to_pyvista(PAIR, PAIR.zeros())),
    (
        "cannot write",
        lambda: to_pyvista(Basis(skfem.MeshWedge1(), skfem.ElementWedge1()), np.zeros(6)),
    ),
    ("path", lambda: save("field.png", SCALAR, FIELD)),
    ("path", lambda: save(None, SCALAR, FIELD)),
    ("pvd", lambda: save("a.vtu", SCALAR, [(0, FIELD)])),
    ("non-empty", lambda: save("a.pvd", SCALAR, [])),
    ("fields", lambda: save("a.vtu", SCALAR, None)),
    ("a mapping from names", lambda: save("a.vtu", SCALAR, {1: ZERO})),
    *rows(r"fields: a \.pvd series", partial(save, "a.pvd", SCALAR), *NO_SERIES),
    ("ElementVector", lambda: nodal_stress(SCALAR, ZERO, 1.0, 0.0)),
    ("both E and nu", stress),
    ("or a law", lambda: stress(1.0, 0.0, law=lambda g: g)),
    *rows("law", lambda v: stress(law=v), lambda g: g[..., :1], lambda g: g * np.nan, 1),
    *rows("E: ", lambda v: stress(v, 0.0), -1.0, [1.0, 2.0], np.nan),
    ("nu: ", lambda: stress(1.0, 0.5)),
    ("plane", lambda: stress(1.0, 0.0, plane="flat")),
    ("plane", lambda: nodal_stress(SOLID, SOLID.zeros(), 1.0, 0.3, "stress")),
    ("sigma_zz", lambda: von_mises(np.zeros((2, 2)))),
    ("von_mises|stress|finite|NaN", lambda: von_mises(np.full((3, 3, 4), np.nan))),
    *rows("quadrilaterals", lambda v: plot_shape_function(v, 0), ElementTriP1(), ElementHexAdini()),
    ("projection", lambda: plot_shape_function(ADINI, 0, plt.figure().add_subplot())),
    ("A: expected shape", lambda: plot_matrix(K[1:], SCALAR)),
    ("coarser mesh", lambda: plot_matrix(sparse.eye_array(LARGE.N), LARGE)),
    ("elsewhere", lambda: plot_matrix(K, Basis(MESH, skfem.ElementQuad2()))),
    ("not positive", lambda: plot_matrix(0 * K, SCALAR)),
    # Solvers.
    (r"x: .*\(75,\)", lambda: refine_eigenpair(SCALAR, np.ones(5))),
    ("x=.*inhomogeneous", lambda: refine_eigenpair(SCALAR, [[1, 2], [3]])),
    ("x=.*masked", lambda: refine_eigenpair(SCALAR, np.ma.masked_equal(MODE, MODE[0]))),
    ("not zero", lambda: refine_eigenpair(SCALAR, ZERO)),
    *rows("basis: .*Basis of cells", UniformSolver.from_basis, None, "x", MESH),
    *rows("no eigenvector", refined, MODE + 1e-3 * MODE**2, np.cos(np.arange(SCALAR.N) ** 2)),
    ("axis-parallel", lambda: refine_eigenpair(SHEARED, np.ones(SHEARED.N))),
    ("axis-parallel", lambda: CutDomain(TURNED, phi)),
    ("Adini's element", lambda: refine_eigenpair(Q1, np.ones(25))),
    ("Adini's element", lambda: UniformSolver.from_basis(Q1)),
    ("basis:", lambda: refine_eigenpair(VECTOR, VECTOR.zeros())),
    *rows("fixed", lambda v: refine_eigenpair(SCALAR, MODE, v), [10**6], [0.5]),
    ("tol", lambda: refine_eigenpair(SCALAR, MODE, tol=np.nan)),
    # Anything passed as an eigenvector: the residual was NaN, and no NaN is above a tolerance.
    *rows("Basis of cells", lambda v: refine_eigenpair(v(MESH, ADINI), MODE), *ON_FACETS),
    ("zero in all cells", lambda: refine_eigenpair(CORNER, np.eye(SCALAR.N)[-1])),
    *rows("count=.*a whole number from 1 to 74", lambda v: eigen(count=v), 75, 0, 2.0, True),
    ("fixed: expected dofs from 0", lambda: eigen(fixed=[999])),
    *rows("fixed: expected numbers", lambda v: eigen(fixed=v), [1.0], "left"),
    ("fixed: a mask", lambda: eigen(fixed=np.ones(3, dtype=bool))),
    *rows("shift=.*: expected", lambda v: eigen(shift=v), np.nan, 1j),
    ("definite", lambda: eigen(shift=20.0)),
    ("K, M", lambda: eigen(M=M[1:][:, 1:])),
    ("K: expected real", lambda: eigen(K=K * (1 + 1j))),
    ("M: expected real", lambda: eigen(M=M * 1j)),
    *rows("K: expected", lambda v: eigen(K=v), "matrix", np.ones(3)),
    ("holds NaN|NaN", lambda: eigen(K=K * np.nan)),
    ("M: ", lambda: eigen(M=-M)),
    (
        "2 components, got 3",
        lambda: near_null_space(Basis(MeshQuad(), ElementVector(ADINI, dim=3))),
    ),
    ("dofs: .* 0 to 74", lambda: near_null_space(SCALAR, [0, 75])),
    *rows("dofs", partial(near_null_space, SCALAR), np.ones(75, dtype=bool), NO_NUMBER),
    *rows("dofs", solver().as_linear_operator, [0.5], [-1]),
    ("75 rows", lambda: near_null_space(SCALAR, T[1:])),
    *rows("shape: ", UniformSolver, (1, 4), (2, 2, 2, 2)),
    *rows("lengths", lambda v: solver(lengths=v), (1, -1), (1, 1, 1)),
    ("bc", lambda: solver(bc="robin")),
    ("k: expected positive", lambda: solver(k=0.0)),
    ("k: expected real", lambda: solver(k=[1.0, 1 + 2j])),
    ("k: expected one number or 2", lambda: solver(k=[1.0, 2.0, 3.0])),
    ("c: expected not negative", lambda: solver(c=-1.0)),
    (r"\(75,\)", lambda: solver().solve(np.ones(5))),
    ("x: expected", lambda: solver().solve(np.ones(75) * 1j)),
    ("f: the load holds NaN", lambda: solver().solve(np.full(75, np.nan))),
    ("values", lambda: solver().from_grid(np.ones((3, 5)))),
    ("different", lambda: solver().as_linear_operator([1, 1])),
    ("0 to 74", lambda: solver().as_linear_operator([75])),
    *rows("modes", lambda v: solver().eigenvalue(v, 1), 0, 1.5),
    ("digits", lambda: solver().eigenvalue(1, 1, digits=0)),
    ("zero", lambda: solver(bc="neumann").eigenvalue_error(0, 0)),
    ("uniform grid", lambda: UniformSolver.from_basis(grid([0, 0.4, 1.0]))),
    ("full box", lambda: UniformSolver.from_basis(grid(range(5), 4))),
    ("at least", lambda: UniformSolver.from_basis(Basis(MeshQuad(), ADINI))),
    # Assembly.
    ("form", lambda: assemble(3.0, MESH, ADINI)),
    ("form", lambda: DOMAIN.assemble(lambda u, v, _: u * v, ADINI)),
    ("mesh: |mesh", lambda: assemble(laplace, "mesh", ADINI)),
    ("element", lambda: assemble(laplace, MESH)),
    ("element", lambda: DOMAIN.assemble(laplace, None)),
    ("element", lambda: DOMAIN.boundary(ElementHexAdini())),
    ("element: ElementHex1 does not fit", lambda: assemble(laplace, MESH, ElementHex1())),
    ("test_element", lambda: assemble(laplace, MESH, ADINI, ElementTriP1())),
    ("coordinate", lambda: assemble(laplace, NAN_MESH, ADINI)),
    ("degenerate|volume", lambda: assemble(laplace, FLAT, ElementQuad1())),
    ("degenerate|volume", lambda: assemble(laplace, FLAT_BRICK, ElementHex1())),
    *rows("intorder=.*: expected", lambda v: with_k(intorder=v), -1, 1.5),
    ("intorder, quadrature", lambda: assemble(laplace, SCALAR, intorder=2)),
    ("quadrature: expected", lambda: assemble(laplace, MESH, ADINI, quadrature=([1.0], [1.0]))),
    ("second basis", lambda: assemble(laplace, SCALAR, ADINI)),
    ("does not take 2", lambda: assemble(skfem.LinearForm(lambda v, w: v), MESH, ADINI, ADINI)),
    ("k: the field holds NaN", lambda: with_k(k=np.full((16, 1), np.nan))),
    ("k: expected a finite", lambda: with_k(k=np.inf)),
    ("k: expected a number", lambda: with_k(k="one")),
    ("k: expected 16 numbers", lambda: with_k(k=np.ones(17))),
    ("k: expected an array over", lambda: with_k(k=np.ones((99, 1)))),
    # Cut domains.
    ("n >= 3", lambda: Polygon(np.zeros((2, 2)))),
    ("finite corners", lambda: Polygon([[0, 1, np.nan], [0, 0, 1]])),
    ("two corners in a row are equal", lambda: Polygon([[0, 1, 1, 0], [0, 0, 0, 1]])),
    ("no area", lambda: Polygon([[0, 1, 2], [0, 1, 2]])),
    ("cross", lambda: Polygon([[0.0, 1, 1, 0], [0.0, 1, 0, 0.7]])),
    *rows("vertices: expected real", Polygon, "abc", [[0, 1, 1j], [0, 0, 1]]),
    *rows("half planes", lambda v: SQUARE - v, LevelSet(lambda x: x[0] - 0.5), 3),
    ("a Polygon is not composed", lambda: SQUARE & LevelSet(phi)),
    ("a Polygon is not composed", lambda: LevelSet(phi) & SQUARE),
    ("a Polygon is not composed", lambda: SQUARE | LevelSet(phi)),
    ("half planes", lambda: LevelSet(lambda x: x[0]) - SQUARE),
    ("gradient: a polygon has none", lambda: cut_quadrature(SQUARE, *UNIT, gradient=slope)),
    ("level_set: expected a function", lambda: cut_quadrature(3.0, *UNIT)),
    ("level_set: .* one argument", lambda: cut_quadrature(lambda x, y: x + y, *UNIT)),
    ("level_set: the function returned NaN", lambda: cut_quadrature(nan, *UNIT)),
    ("level_set: the function returned shape", lambda: cut_quadrature(lambda x: x, *UNIT)),
    ("level_set: expected real numbers", lambda: cut_quadrature(lambda x: x[0] * 1j, *UNIT)),
    ("level_set: not smooth along its zero line", lambda: cut_quadrature(STEP, *UNIT)),
    ("level_set: its zero line is degenerate", lambda: cut_quadrature(DOUBLE, *UNIT)),
    *rows("lower", lambda v: cut_quadrature(phi, v, [[1], [1]]), [0, 0], [[0], [0, 1]]),
    ("lower: expected", lambda: cut_quadrature(phi, [[0j], [0]], [[1], [1]])),
    ("positive sides", lambda: cut_quadrature(phi, UNIT[0], UNIT[0])),
    ("finite", lambda: cut_quadrature(phi, UNIT[0], UNIT[1] * np.nan)),
    ("q=0: expected", lambda: cut_quadrature(phi, *UNIT, q=0)),
    ("mesh: expected a MeshQuad", lambda: CutDomain(skfem.MeshTri(), phi)),
    ("no cell of the mesh", lambda: CutDomain(MESH, lambda x: 1 + x[0])),
    ("threshold=.*: expected", lambda: AdiniExtension(ON_GRID, half(), 1.5)),
    ("basis: expected", lambda: AdiniExtension(Basis(GRID, ElementQuad1()), half())),
    ("the same mesh", lambda: AdiniExtension(Basis(GRID.refined(), ADINI), half())),
    ("too thin for this mesh", lambda: AdiniExtension(ON_GRID, CutDomain(GRID, THIN))),
    ("A: needed", lambda: AdiniExtension(SCALAR, half(MESH), essential=(T, X0 + 1)).load(ZERO)),
    ("A", lambda: EXTENSION.apply(STIFFNESS * np.nan)),
    ("A", lambda: EXTENSION.solve(STIFFNESS * np.nan, np.zeros(STIFFNESS.shape[0]))),
    ("beta=.*: expected", lambda: nitsche(edge(), beta=np.nan)),
    ("lame: give", lambda: nitsche(edge(), lame=(1, 1))),
    ("lame: give", lambda: nitsche(edge(vector=True))),
    ("lame", lambda: nitsche(VECTOR_CURVE, lame=(np.nan, 1.0))),
    ("coefficient: exp", lambda: nitsche(edge(), coefficient=-1.0)),
    ("value: the data hold", lambda: nitsche(edge(), np.nan)),
    ("extension: it belongs to another domain", lambda: extended(AdiniExtension(ON_GRID, half()))),
    ("extension: expected an AdiniExtension, got CutDomain", lambda: extended(DOMAIN)),
    ("give both the same element", lambda: extended(AdiniExtension(VECTORS_ON_GRID, DOMAIN))),
    ("gamma=.*: expected", lambda: ghost_penalty(half(), ADINI, gamma=-1)),
    ("matrix='K': expected", lambda: ghost_penalty(half(), ADINI, matrix="K")),
    ("elem: expected", lambda: ghost_penalty(half(), ElementQuad1())),
    ("parts: 3 has no boundary", lambda: half().boundary(ADINI, parts=3)),
    ("levels=-1: expected", lambda: refined_at_boundary(GRID, phi, -1)),
    ("layers=0: expected", lambda: refined_at_boundary(GRID, phi, 1, 0)),
    *rows("where", lambda v: refined_at_boundary(GRID, phi, where=v), *NO_PLACES),
    ("weight: expected a function", lambda: ElementQuadAdiniWeighted(1.0, slope)),
    ("gradient: expected a function", lambda: ElementQuadAdiniWeighted(WEIGHT, None)),
    ("derivatives: expected", lambda: ElementQuadAdiniWeighted(WEIGHT, slope, None, 2)),
    ("degree=-1: expected", lambda: ElementQuadAdiniWeighted(WEIGHT, slope, None, 1, -1)),
    ("weight: the function returned shape", lambda: weighted(lambda x: x)),
    ("weight: the function returned NaN", lambda: weighted(lambda x: x[0] * np.nan)),
    ("gradient: the function returned shape", lambda: weighted(WEIGHT, WEIGHT)),
    ("hess", lambda: WEIGHTED.basis[0][0].hess),
    *rows("level_set", partial(ElementQuadAdiniCut, GRID), lambda x: x, lambda x: 1j * x[0]),
    # What a mask hides is no number: neither in arrays nor in what functions return.
    *rows("masked", lambda f: f(SCALAR, None, HIDDEN), essential_constraints, project_trace),
    ("value=.*masked", lambda: nitsche(CURVE, HIDDEN)),
    ("components=.*masked", lambda: held(components=np.ma.array([0, 1], mask=[0, 1]))),
    ("law=.*masked", lambda: stress(law=lambda g: np.ma.array(g, mask=g == 0))),
    *rows("masked", lambda name: solver(**{name: [1.0, np.ma.masked]}), "lengths", "k"),
    ("shape=.*masked", lambda: UniformSolver(np.ma.array([4, 4], mask=[0, 1]))),
    ("k=.*masked", lambda: with_k(k=np.ma.array(np.ones((16, 1)), mask=np.eye(16)[:, :1]))),
    ("fixed=.*masked", lambda: eigen(fixed=np.ma.array([0, 1], mask=[0, 1]))),
    ("vertices=.*masked", lambda: Polygon(np.ma.masked_equal([[0, 1, 1], [0, 0, 2]], 2))),
    ("lower=.*masked", lambda: cut_quadrature(phi, np.ma.masked_equal(UNIT[0], 0), UNIT[1])),
    ("level_set=.*masked", lambda: CutDomain(GRID, HIDDEN)),
    ("gradient=.*masked", lambda: CutDomain(GRID, phi, lambda x: [HIDDEN(x), x[1]])),
    ("where=.*masked", lambda: refined_at_boundary(GRID, phi, where=lambda x: HIDDEN(x) > 0)),
    ("weight=.*masked", lambda: weighted(HIDDEN)),
]


@pytest.mark.filterwarnings("ignore::RuntimeWarning")
@pytest.mark.parametrize(("words", "call"), TABLE, ids=[words for words, _ in TABLE])
def test_calls(words, call):
    with pytest.raises(InputError, match=words):
        call()
    plt.close("all")


WITHOUT = {
    "matplotlib.pyplot": ("pip install", lambda: plot_matrix(K, SCALAR)),
    "pyvista": ("pip install", lambda: to_pyvista(SCALAR, ZERO)),
    "pyamg": (r"pip install 'skfem-adini\[amg\]'", lambda: with_amg(near_null_space(SCALAR))),
}


@pytest.mark.parametrize("package", WITHOUT)
def test_missing_packages_name_the_install_line(package, monkeypatch):
    words, call = WITHOUT[package]
    monkeypatch.setitem(sys.modules, package, None)
    with pytest.raises(MissingDependency, match=words):
        call()


def test_errors_share_one_base():
    assert issubclass(InputError, AdiniError)
    assert issubclass(InputError, ValueError)


@pytest.mark.parametrize("dtype", [np.int32, np.uint8, np.float32, bool])
def test_other_kinds_of_real_numbers_are_taken(dtype):
    x = (np.arange(SCALAR.N) % 2).astype(dtype)
    expected = to_pyvista(SCALAR, x.astype(float)).point_data["u"]
    np.testing.assert_allclose(to_pyvista(SCALAR, x).point_data["u"], expected, rtol=1e-6)
    if dtype is not bool:
        found = nodal_gradient(SCALAR, x)
        assert found.dtype == float
        np.testing.assert_array_equal(found, nodal_gradient(SCALAR, x.astype(float)))


def test_complex_loads_keep_their_imaginary_part():
    b = np.ones(STIFFNESS.shape[0])
    load = EXTENSION.load((1 + 2j) * b)
    np.testing.assert_allclose(load, (1 + 2j) * EXTENSION.load(b))
    np.testing.assert_allclose(EXTENSION.expand(load).imag, 2 * EXTENSION.expand(load).real)
    solver, f = UniformSolver((4, 4)), np.ones(75)
    assert np.array_equal(solver.solve(f + 0j), solver.solve(f))

"""Run by mpiexec: matrices, solutions and eigenvalues beside those of one process, as JSON."""

import json
from copy import deepcopy

import numpy as np
import skfem
from skfem.models.elasticity import linear_elasticity
from skfem.models.poisson import laplace, mass

import skfem_adini
from skfem_adini import ElementHexAdini, ElementQuadAdini
from skfem_adini.distributed import (
    DistributedBasis,
    DistributedSolver,
    MumpsSchur,
    TensorGrid,
    lowest_eigenpairs,
    world,
)
from tests.skfem_adini.distributed.spaces import spaces

COMM = world()


def matrices():
    """Largest difference of each matrix, relative to its largest entry."""
    found = {}
    for name, mesh, element, form in spaces():
        space = DistributedBasis(mesh, element)
        # Through PETSc and back: the product with a vector.
        K = space.assemble(form)
        x = space.extended(np.cos(space.numbers[space.owned].astype(float)))
        A = K.to_petsc()
        v, w = A.createVecs()
        v.setArray(x[space.owned])
        A.mult(v, w)
        off = np.abs(w.getArray() - (K @ x)[space.owned]).max(initial=0.0)
        whole, off = K.gather(), max(COMM.allgather(off))
        if whole is not None:
            exact = form.assemble(skfem.Basis(mesh, deepcopy(element)))
            found[name] = [abs(whole - exact).max() / abs(exact).max(), off / abs(exact).max()]
    return found


def solutions():
    """Differences to a serial solution, and iterations, by element and solver."""
    found = {}
    plane = TensorGrid(np.linspace(0, 2, 25), np.linspace(0, 1, 17))
    solid = TensorGrid(*[np.linspace(0, 1, 9)] * 3)
    load = skfem.LinearForm(lambda v, w: v[0] + 2 * v[1] * w.x[0])
    cases = [
        ("Adini", plane, ElementQuadAdini()),
        ("Q2", plane, skfem.ElementQuad2()),
        ("Hex1", solid, skfem.ElementHex1()),
        ("Adini brick", TensorGrid(*[np.linspace(0, 1, 6)] * 3), ElementHexAdini()),
    ]
    for name, grid, scalar in cases:
        element, form = skfem.ElementVector(scalar), linear_elasticity(1.0, 1.0)
        space = DistributedBasis(grid, element)
        K, b = space.assemble(form), space.assemble(load)
        # Values on the left side, and what they prescribe there along it.
        fixed = space.boundary_dofs("left")
        given = np.zeros(space.basis.N)
        given[fixed] = 0.1
        y = _serial(grid.mesh(), element, form, load) if COMM.rank == 0 else 0.0
        for method in ("mumps", "gamg", "hypre"):
            solver = DistributedSolver(K, fixed, method)
            x = space.gather(solver.solve(b, given))
            if x is not None:
                error = np.abs(x - y).max() / np.abs(y).max()
                found[f"{name} {method}"] = [error, solver.iterations]
    return found


def _serial(mesh, element, form, load):
    basis = skfem.Basis(mesh, deepcopy(element))
    A, f = skfem_adini.assemble(form, basis), load.assemble(basis)
    where = basis.get_dofs("left").flatten()
    y = np.zeros(basis.N)
    y[where] = 0.1
    return skfem.solve(*skfem.condense(A, f, x=y, D=where))


def eigenvalues():
    """Largest difference to SciPy's, and of the vectors' norms and residuals."""
    mesh = skfem.MeshQuad.init_tensor(np.linspace(0, 1, 25), np.linspace(0, 1, 21)).with_defaults()
    space = DistributedBasis(mesh, ElementQuadAdini())
    K, M = space.assemble(laplace), space.assemble(mass)
    sides = "left", "right", "bottom", "top"
    fixed = space.boundary_dofs(*sides, skip=["u_x", "u_y"])
    values, vectors = lowest_eigenpairs(K, M, 8, fixed)
    x = np.array([space.gather(v) for v in vectors.T]) if COMM.size else None
    if COMM.rank:
        return {}
    basis = skfem.Basis(mesh, ElementQuadAdini())
    A, B = laplace.assemble(basis), mass.assemble(basis)
    held = basis.get_dofs(list(sides), skip=["u_x", "u_y"]).flatten()
    exact, _ = skfem_adini.lowest_eigenpairs(A, B, 8, held)
    free = np.setdiff1d(np.arange(basis.N), held)
    left = (A @ x.T - B @ x.T * values)[free]
    return {
        "values": np.abs(values / exact - 1).max(),
        "norms": np.abs(np.diag(x @ (B @ x.T)) - 1).max(),
        "residual": np.abs(left).max() / np.abs(A @ x.T).max(),
    }


def complement():
    """MUMPS's Schur complement and its solves beside dense ones, of a matrix that is singular."""
    space = DistributedBasis(skfem.MeshQuad().refined(3).with_defaults(), skfem.ElementQuad1())
    K = space.assemble(laplace)
    chosen = np.sort(space.numbers[space.boundary_dofs("bottom")])
    chosen = np.unique(np.concatenate(COMM.allgather(chosen)))
    factor = MumpsSchur(K.rows, space.numbers, space.first, space.N, chosen, COMM)
    rows = np.zeros((space.owned.size, space.N))
    rows[:, space.numbers] = K.rows.toarray()
    A = np.vstack(COMM.allgather(rows))
    inner = np.setdiff1d(np.arange(space.N), chosen)
    X = np.linalg.solve(A[np.ix_(inner, inner)], A[np.ix_(inner, chosen)])
    S = A[np.ix_(chosen, chosen)] - A[np.ix_(chosen, inner)] @ X
    f, z = np.cos(np.arange(space.N)), np.sin(np.arange(chosen.size))
    own = slice(space.first, space.first + space.owned.size)
    reduced = f[chosen] - X.T @ f[inner]
    x = np.zeros(space.N)
    x[chosen] = z
    right = f[inner] - A[np.ix_(inner, chosen)] @ z
    x[inner] = np.linalg.solve(A[np.ix_(inner, inner)], right)
    return {
        "schur": np.abs(factor.schur - S).max() / np.abs(S).max(),
        "reduce": np.abs(factor.reduce(f[own]) - reduced).max() / np.abs(reduced).max(),
        "expand": max(COMM.allgather(np.abs(factor.expand(f[own], z) - x[own]).max(initial=0))),
    }


if __name__ == "__main__":
    parts = {f.__name__: f() for f in (matrices, solutions, eigenvalues, complement)}
    if COMM.rank == 0:
        print(json.dumps({"size": COMM.size, **parts}))

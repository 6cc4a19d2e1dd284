"""A keyword that a function has not: the error names the one that is meant."""

import pytest
from skfem import MeshQuad

from cip import Grid, Solver
from contact import (
    ContactProblem,
    ElasticBody,
    HalfSpace,
    LayeredBlock,
    LoadStepper,
    PeriodicLayers,
)
from gpu import eigs, eigsh, solve_qp

MESH = MeshQuad().with_defaults()
BODY = ElasticBody.from_mesh(MESH, E=1.0, nu=0.3)
PROBLEM = ContactProblem(BODY, "bottom", 0.0)


@pytest.mark.parametrize(
    ("function", "wrong", "meant"),
    [
        (ElasticBody.from_mesh, "young", "'E'"),
        (ElasticBody.from_mesh, "Nu", "'nu'"),
        (ElasticBody.from_mesh, "poisson", "'nu'"),
        (ElasticBody.from_mesh, "lam", "E = mu"),
        (ElasticBody.from_mesh, "mu", "E = mu"),
        (ElasticBody, "poisson_ratio", "'nu'"),
        (LayeredBlock, "frictoin", "it takes"),
        (HalfSpace, "youngs_modulus", "'E'"),
        (PeriodicLayers, "elemnt", "'element'"),
        (ContactProblem, "mu", "'friction'"),
        (ContactProblem, "frictoin", "'friction'"),
        (PROBLEM.solve, "tolerance", "'tol'"),
        (PROBLEM.solve, "maxiter", "'max_iterations'"),
        (LoadStepper, "max_iter", "'max_iterations'"),
        (Grid, "n", "'shape'"),
        (Solver, "limitor", "'limiter'"),
        (Solver, "bc", "'boundary'"),
        (solve_qp, "A_eq", "'A'"),
        (solve_qp, "lower", "'lb'"),
        (eigs, "tolerance", "'tol'"),
        (eigsh, "wich", "'which'"),
    ],
)
def test_the_one_that_is_meant_is_named(function, wrong, meant):
    with pytest.raises(TypeError, match=f"no argument '{wrong}'") as caught:
        function(**{wrong: 1})
    assert meant in str(caught.value)

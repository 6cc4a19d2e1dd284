"""Conditions on the dofs: essential ones on the boundary, conformity at hanging vertices.

In: a Basis, boundaries and the data on them.
Out: fixed dofs, or an affine map u = T z + u0 of the free unknowns.
Start: `essential_dofs`, then `essential_constraints`; `boundary_edges` samples the data.
"""

"""Quadratic programs as data: checked, in one form, scaled, and what proves a solution.

In: the arguments of `solve_qp`.
Out: a checked problem, a `StandardQP`, residuals (`KKT`), the `QPResult`.
Start: `qp_problem`, then `standard_qp` and `qp_result`.
"""

"""Regulators, estimators and Riccati equations.

In: matrices A and B of a linear system (and E), weights of its cost.
Out: `LQRResult`: gain, poles and value with residuals and a proof of stability.
Start: `lqr`; `choice` picks one of `methods`, and `proof` certifies what it finds.
"""

"""Multi-moment semi-Lagrangian (CIP) schemes for transport and advection.

No scheme has landed yet: this release reserves the package so that the four import names stay
together in one distribution.
"""

"""Contact on a grid of points whose compliance is a product in Fourier space.

In: a compliance (`grid_compliance`) and a gap on its grid, friction, motions or forces.
Out: a `GridResult` with its certificate, contact area, spectrum and histogram of the pressure.
Start: `grid_contact`, then `frictionless` and `friction_newton`. Compliances: `half_space` and
`periodic_layers`, with the waves of its sides in `lateral_waves`.
"""

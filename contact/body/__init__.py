"""What is elastic: mesh, element, material, supports, loads and rigid motions.

In: a mesh with named boundaries, E and nu, what holds the body and what loads it.
Out: a `Solid`: stiffness, load, the supports' map u = P z + u0, its trace.
Start: `solid` says what contact asks of a body; `elastic_body` and `cut_body` answer.
"""

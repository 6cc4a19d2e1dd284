"""Elastic bodies: mesh, element, material, supports, loads and rigid motions.

In: a mesh with named boundaries, E and nu, prescribed displacements and loads.
Out: a `Solid` with its stiffness, load, supports u = P z + u0 and trace.
Start: `solid`, the interface that contact uses; `elastic_body` and `cut_body` implement it.
"""

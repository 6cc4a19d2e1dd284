"""A body without a mesh: a rectangle of layers of equal cells.

In: layers with their thickness, material and cells. Out: `LayeredBlock`, whose stiffness is
applied cell by cell. Start: `layered_block`, then `layers` and `block_vectors`.
"""

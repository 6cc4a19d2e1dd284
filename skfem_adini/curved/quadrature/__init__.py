"""Quadrature on the parts of cells inside a level set, and on its zero line.

In: a level set or polygon, and rectangles.
Out: `CutQuadrature`: points, weights and normals.
Start: `cut_quadrature`: `level_set`, `polynomial_boxes`, `graph_boxes`, `graph_rules` in turn.
"""

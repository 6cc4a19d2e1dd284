"""The elements, the geometry of their cells, and the log message about distorted cells.

In: the mapping of a cell and reference points in it.
Out: shape functions with their derivatives, for a Basis of scikit-fem.
Start: `element_quad_adini`; what the elements share is in `closed_form_element`.
"""

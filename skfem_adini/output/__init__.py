"""Output of fields: values at the vertices, VTK data.

In: a Basis and the dofs of a field.
Out: nodal gradients and stresses, PyVista grids, VTK files.
Start: `vtk_fields` for `save` and `to_pyvista`; `nodal_fields` for stresses.
"""

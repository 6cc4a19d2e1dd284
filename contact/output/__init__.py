"""What leaves the package: VTK data, arrays in archives, runs of the boundary for plots.

In: the fields of a result.
Out: PyVista grids, and archives that show whether they are whole.
Start: `vtk` for pictures, `archive` for bytes.
"""

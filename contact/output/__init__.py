"""VTK data, archives of arrays, connected runs of the boundary for plots.

In: the fields of a result.
Out: PyVista grids, which can be saved as VTK files, and archives with a checksum.
Start: `vtk` for ParaView and PyVista, `archive` for files of results.
"""

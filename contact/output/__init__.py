"""VTK data, archives of arrays, connected runs of the boundary for plots.

Input: the fields of a result.
Output: PyVista grids, which can be saved as VTK files, and archives with a checksum.
Start: `vtk` for ParaView and PyVista, `archive` for files of results.
"""

"""Load histories: successive steps of a problem whose friction depends on the path.

In: a problem, and loads and motions that vary in time.
Out: `LoadHistory`: finished steps in memory, in a folder, as VTK files for ParaView (`to_pvd`).
Start: `load_stepper`, then `load_history`.
"""

"""Load histories: successive steps of a problem with friction, which depends on the path.

In: a problem, and loads and motions that vary in time; for bodies with inertia their density.
Out: `LoadHistory`, `DynamicHistory`: finished steps in memory, in a folder, as VTK (`to_pvd`).
Start: `load_stepper`, then `load_history`; with inertia `inertial_step`, then `dynamic_stepper`.
"""

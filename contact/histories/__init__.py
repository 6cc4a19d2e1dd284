"""Load histories: successive steps of a problem whose friction depends on the path.

In: a problem, and loads and motions that vary in time.
Out: `LoadHistory`: finished steps in memory, in a folder, as an animation.
Start: `load_stepper`, then `load_history`.
"""

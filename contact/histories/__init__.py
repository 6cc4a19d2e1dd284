"""Load histories: steps that follow each other, because friction remembers the path.

In: a problem, and loads and motions that vary in time.
Out: `LoadHistory`: finished steps in memory, in a folder, as an animation.
Start: `load_stepper`, then `load_history`.
"""

"""A velocity, a profile and a limiter on a grid, stepped through time.

In: a grid, a velocity, the names of profile and limiter, data on the walls.
Out: the `State` after a step, or the `Trajectory` of a run.
Start: `solver`, then `time_loop`.
"""

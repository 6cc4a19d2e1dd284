"""Execution of a stage: by compiled loops on the CPU, or by kernels on a CUDA device.

In: a stage and the moments before it.
Out: the moments after it.
Start: `engine` for the order of a stage, then `cpu_engine` or `cuda_engine`.
"""

"""All CUDA sources of the package, one in each file.

In: nothing.
Out: source texts for NVRTC, listed in `catalogue` for tests that compile them without a device.
Start: `catalogue`.
"""

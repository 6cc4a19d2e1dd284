"""All CUDA sources of the package.

In: nothing.
Out: source texts for NVRTC, listed in `catalogue` for tests that compile them without a device.
Start: `catalogue`.
"""

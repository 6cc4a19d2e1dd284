"""All CUDA sources of the package, one a file.

In: nothing: texts.
Out: texts for NVRTC, listed in `catalogue` for whoever compiles them without a device.
Start: `catalogue`.
"""

"""All CUDA sources of the package.

In: nothing.
Out: kernels to launch, from source texts that tests compile by NVRTC without a device.
Start: `catalogue`.
"""

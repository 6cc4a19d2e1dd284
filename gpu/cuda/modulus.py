"""CUDA source of the largest modulus among real numbers."""

SOURCE = r"""
// As whole numbers the moduli have the same order, and infinity and NaN come last. `largest` must
// be zero before.
extern "C" __global__ void modulus_largest(const double* __restrict__ a, long long size,
                                           unsigned long long* largest)
{
    unsigned long long most = 0;
    const long long step = (long long)gridDim.x * blockDim.x;
    #pragma unroll 8
    for (long long i = blockIdx.x * (long long)blockDim.x + threadIdx.x; i < size; i += step) {
        const unsigned long long bits = __double_as_longlong(fabs(a[i]));
        most = bits > most ? bits : most;
    }
    for (int apart = 16; apart; apart >>= 1) {
        const unsigned long long other = __shfl_xor_sync(0xffffffffu, most, apart);
        most = other > most ? other : most;
    }
    if ((threadIdx.x & 31) == 0)
        atomicMax(largest, most);
}
"""

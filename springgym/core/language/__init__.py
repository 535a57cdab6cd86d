"""A small language of SIMD values on Numba: numbers of many environments, vectors, blocks."""

"""Compilation of kernels with Numba, their caches on disk and in the package, and their threads."""

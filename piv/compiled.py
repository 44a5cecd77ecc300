"""Numba decorators of all compiled functions: their machine code is kept beside the module."""

from numba import njit

compiled = njit(cache=True, nogil=True)
fast = njit(cache=True, nogil=True, fastmath=True)
inlined = njit(cache=True, nogil=True, fastmath=True, forceinline=True)

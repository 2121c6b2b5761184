"""How kernels are compiled: once on a machine, and without what nobody calls."""

from functools import partial

import numba

kernel = partial(numba.njit, cache=True, no_cfunc_wrapper=True)
"""Decorator of a function that Python calls; numba keeps what it compiled beside the file."""

inner = partial(kernel, no_cpython_wrapper=True)
"""Decorator of one that only kernels call: a quarter less to compile."""

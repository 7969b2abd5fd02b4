"""Imports that nearly all workers and runs need, done once in the process from which they are forked.

It must not start a thread: a process with threads must not fork.
"""

import gc

import dask.array  # noqa: F401 - which xarray imports with the first cube
import netCDF4  # noqa: F401
from numba.core.registry import cpu_target

cpu_target.target_context.refresh()  # numba does this before it loads the first kernel
gc.collect()
gc.freeze()  # the collector then does not scan shared objects, which would copy their pages

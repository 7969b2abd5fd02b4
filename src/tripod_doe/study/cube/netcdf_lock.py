"""The one lock around netCDF4, held wherever a netCDF file is opened, read, written or closed.

Neither netCDF4 nor the HDF5 library below it may be used by two threads at once, also not on two files. xarray keeps a
lock of its own, but holds it for values only, not while it reads the names and attributes of a file that it opens, and
it cannot be taken twice by one thread.
"""

import sys
import threading
from typing import Any


class NetcdfLock:
    """A reentrant lock, which also holds xarray's lock if xarray is in use."""

    def __init__(self) -> None:
        self._own, self._depth = threading.RLock(), 0
        self._others: Any = None

    def acquire(self, blocking: bool = True) -> bool:
        """Take the lock (without `blocking` only if it is free); returns whether it is taken."""
        if not self._own.acquire(blocking):
            return False
        if self._depth == 0 and not self._acquire_others(blocking):
            self._own.release()
            return False
        self._depth += 1
        return True

    def _acquire_others(self, blocking: bool) -> bool:
        backend = sys.modules.get("xarray.backends.netCDF4_")  # not imported for a query, which does without
        self._others = getattr(backend, "NETCDF4_PYTHON_LOCK", None)
        return self._others is None or bool(self._others.acquire(blocking))

    def release(self) -> None:
        """Release the lock, once for each time that it was taken."""
        self._depth -= 1
        if self._depth == 0 and self._others is not None:
            self._others.release()
        self._own.release()

    def locked(self) -> bool:
        """Whether a thread holds it."""
        return self._depth > 0

    def __enter__(self) -> None:
        self.acquire()

    def __exit__(self, *exception: object) -> None:
        self.release()

    def __reduce__(self) -> str:  # a copy, which Dask makes of an open cube, is the same lock
        return "NETCDF_LOCK"


NETCDF_LOCK = NetcdfLock()
"""The lock of this process."""

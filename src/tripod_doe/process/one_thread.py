"""Linear algebra on one thread: on several, small matrices wait for each other, and results are rounded differently."""

from __future__ import annotations

from contextlib import AbstractContextManager
from functools import cache

from threadpoolctl import ThreadpoolController


def one_thread() -> AbstractContextManager[object]:
    """Keep NumPy's and SciPy's linear algebra to one thread within a ``with`` block."""
    return _libraries().limit(limits=1, user_api="blas")


@cache
def _libraries() -> ThreadpoolController:
    """The libraries of linear algebra, looked for once: that takes 2 ms, as long as some runs."""
    import scipy.linalg  # noqa: F401  a library that is not loaded yet is not found

    return ThreadpoolController()

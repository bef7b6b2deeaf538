"""Compilation by numba, kept on disk where there is a folder for it."""

from collections.abc import Callable
from typing import Any

import numba


def compiled(function: Callable) -> Any:  # noqa: ANN401 numba's dispatcher
    """Compiles a function on its first call; a later process finds it compiled.

    Where nothing can be kept, as in a read-only container, each process compiles anew. A division
    by zero gives infinity or NaN, as numpy's does.
    """
    try:
        return numba.njit(cache=True, error_model="numpy")(function)
    except RuntimeError:  # No folder for the cache.
        return numba.njit(error_model="numpy")(function)

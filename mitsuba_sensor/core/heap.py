"""Memory that was freed and that libraries keep for themselves."""

import ctypes
import sys
from functools import cache

from .llvm import drjit


def trim_heap() -> None:
    """Give back to the system what was freed: what Dr.Jit keeps for the next kernel, and the C library.

    glibc gives back the end of its heap only, unless it is asked (malloc_trim(3)): of a render of two million pixels
    it keeps some 300 MiB. That takes a few milliseconds; other C libraries are not asked.
    """
    if "drjit" in sys.modules:
        drjit().flush_malloc_cache()
    if (library := _glibc()) is not None:
        library.malloc_trim(0)


@cache
def _glibc() -> ctypes.CDLL | None:
    """The C library of this process, if it can be asked."""
    if sys.platform == "linux":
        library = ctypes.CDLL(None)
    else:
        library = None
    if hasattr(library, "malloc_trim"):
        return library
    return None

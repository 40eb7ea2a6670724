"""Arrays that can be put into a temporary file for as long as something else needs the memory."""

from __future__ import annotations

import math
import mmap
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from typing import TYPE_CHECKING

import numpy as np

from ...core.heap import trim_heap

if TYPE_CHECKING:
    from io import BufferedRandom

CAN_SPILL = hasattr(mmap, "MADV_DONTNEED") and hasattr(mmap, "MAP_ANONYMOUS")  # Linux and macOS
LEAST_BYTES = 2**27  # less is not worth the file


class Spillable:
    """A float32 array of zeros whose memory is its own, so that it can be given back and filled again in place.

    values : the array; views of it stay valid.
    """

    def __init__(self, shape: tuple[int, ...]) -> None:
        size = 4 * math.prod(shape)
        if not CAN_SPILL or not size:
            self.values = np.zeros(shape, np.float32)
            return
        self._memory = mmap.mmap(-1, size, flags=mmap.MAP_PRIVATE | mmap.MAP_ANONYMOUS)
        self.values = np.frombuffer(self._memory, np.float32).reshape(shape)

    def copy_to(self, file: BufferedRandom) -> None:
        """Write the values behind what is there."""
        file.write(self._memory)

    def give_back(self) -> None:
        """Give the memory back to the system; the values are 0 from now on."""
        self._memory.madvise(mmap.MADV_DONTNEED)

    def read_from(self, file: BufferedRandom) -> None:
        """The inverse of :meth:`copy_to`."""
        file.readinto(self._memory)


@contextmanager
def on_disk(arrays: Sequence[Spillable]) -> Iterator[None]:
    """In a temporary file meanwhile, if they are large; in memory still where the disk has no space for it.

    Nobody may read or write them until the end. Before they come back, what was freed is given back to the system.
    """
    with ExitStack() as stack:
        if CAN_SPILL and sum(array.values.nbytes for array in arrays) >= LEAST_BYTES:
            with suppress(OSError):  # a full disk
                file = stack.enter_context(tempfile.TemporaryFile())
                for array in arrays:
                    array.copy_to(file)
                file.flush()
                stack.callback(_read, arrays, file)
                for array in arrays:
                    array.give_back()
        yield


def _read(arrays: Sequence[Spillable], file: BufferedRandom) -> None:
    trim_heap()
    file.seek(0)
    for array in arrays:
        array.read_from(file)

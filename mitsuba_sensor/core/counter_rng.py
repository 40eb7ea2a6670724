"""Random words at named places: the same question always gets the same 32 bits.

Philox4x32-10 (Salmon et al., SC'11) is a function from a key and a counter to four words, without any state. The key is
the seed; the counter is (x, y, frame, block) in *sensor* coordinates. So a crop of a frame is the frame of the crop,
frame 12 can be made alone, and a noise source that is switched off takes no word from another.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from .arrays import mixed, wide_product

RandomBits = NDArray[np.uint32]

_M0, _M1 = 0xD2511F53, 0xCD9E8D57
_W0, _W1 = 0x9E3779B9, 0xBB67AE85
_ALL = 0xFFFF_FFFF

FIXED_PATTERN = 0x8000_0000
"""Bit of the block number that sets a camera's fixed patterns apart from the noise of its frames."""

STREAMS = {
    "photon_shot": (0, 0),
    "dark_shot": (0, 1),
    "source_follower": (0, 2),
    "reset": (0, 3),
    "prnu": (FIXED_PATTERN, 0),
    "dark_fpn": (FIXED_PATTERN, 1),
    "dsnu_col": (FIXED_PATTERN + 1, 0),
    "dsnu_row": (FIXED_PATTERN + 1, 1),
    "prnu_col": (FIXED_PATTERN + 1, 2),
    "dsnu_pixel": (FIXED_PATTERN + 1, 3),
    "dark_fpn_pick": (FIXED_PATTERN, 2),
    "dark_component": (FIXED_PATTERN, 3),
    "rts_site": (FIXED_PATTERN + 2, 0),
    "rts_switch": (1, 0),
    "rts_state": (1, 1),
    "quantum_yield": (1, 2),
    "compensation": (1, 3),
}
"""Noise source → (block, word). A place is for ever: adding a source adds a line and moves nothing."""


def philox(counter: tuple[Any, ...], key: tuple[Any, Any]) -> tuple[Any, Any, Any, Any]:
    """The four words at a counter of four 32-bit values, under a key of two; arrays broadcast together.

    NumPy carries 32-bit values in uint64, Dr.Jit in uint32.
    """
    x0, x1, x2, x3 = counter
    k0, k1 = key
    for _ in range(10):
        (high0, low0), (high1, low1) = wide_product(x0, _M0), wide_product(x2, _M1)
        x0, x1, x2, x3 = mixed(high1, x1, k0), low1, mixed(high0, x3, k1), low0
        k0, k1 = (k0 + _W0) & _ALL, (k1 + _W1) & _ALL
    return x0, x1, x2, x3


def key_halves(key: int) -> tuple[int, int]:
    """A 64-bit key as Philox takes it: lower and upper half."""
    return key & _ALL, key >> 32


def random_bits_at(
    number: int, rows: NDArray[Any], columns: NDArray[Any], frame: int, key: int
) -> tuple[RandomBits, RandomBits, RandomBits, RandomBits]:
    """The four words of block ``number`` at pixels (rows, columns), which broadcast together, on NumPy."""
    x, y = columns.astype(np.uint64) & np.uint64(_ALL), rows.astype(np.uint64) & np.uint64(_ALL)
    bits = philox((x, y, np.uint64(frame), np.uint64(number)), key_halves(key))
    shape = np.broadcast_shapes(x.shape, y.shape)
    w0, w1, w2, w3 = (np.broadcast_to(w, shape).astype(np.uint32) for w in bits)
    return w0, w1, w2, w3


def random_bits(
    number: int, rows: NDArray[np.int64], columns: NDArray[np.int64], frame: int, key: int
) -> tuple[RandomBits, RandomBits, RandomBits, RandomBits]:
    """The four words of block ``number`` for every pixel (rows[:, None], columns[None, :]) of a window, each (H, W)."""
    return random_bits_at(number, rows[:, None], columns[None, :], frame, key)

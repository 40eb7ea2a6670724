"""Random words at named places: the same question always gets the same 32 bits.

Philox4x32-10 (Salmon et al., SC'11) is a function from a key and a counter to four words, without any state. The key is
the seed; the counter is (x, y, frame, block) in *sensor* coordinates. So a crop of a frame is the frame of the crop,
frame 12 can be made alone, and a noise source that is switched off takes no word from another.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Words = NDArray[np.uint32]

_M0, _M1 = np.uint64(0xD2511F53), np.uint64(0xCD9E8D57)
_W0, _W1 = 0x9E3779B9, 0xBB67AE85
_LOW, _SHIFT = np.uint64(0xFFFFFFFF), np.uint64(32)

FIXED = 0x8000_0000
"""Bit of the block number that sets a camera's fixed patterns apart from the noise of its frames."""

PLACES = {
    "light_shot": (0, 0),
    "dark_shot": (0, 1),
    "source_follower": (0, 2),
    "reset": (0, 3),
    "prnu": (FIXED, 0),
    "dark_pattern": (FIXED, 1),
    "column_offset": (FIXED + 1, 0),
    "row_offset": (FIXED + 1, 1),
    "column_gain": (FIXED + 1, 2),
    "pixel_offset": (FIXED + 1, 3),
    "dark_pattern_pick": (FIXED, 2),
    "dark_part": (FIXED, 3),
    "blinking_site": (FIXED + 2, 0),
    "blinking_switch": (1, 0),
    "blinking_state": (1, 1),
    "quantum_yield": (1, 2),
}
"""Noise source → (block, word). A place is for ever: adding a source adds a line and moves nothing."""


def philox(counter: tuple[NDArray[np.uint64], ...], key: int) -> tuple[Words, Words, Words, Words]:
    """The four words at a counter of four uint64 arrays that hold 32-bit values (broadcast together); 64-bit key."""
    x0, x1, x2, x3 = counter
    k0, k1 = key & 0xFFFFFFFF, key >> 32
    for _ in range(10):
        p0, p1 = _M0 * x0, _M1 * x2
        x0, x1, x2, x3 = (
            (p1 >> _SHIFT) ^ x1 ^ np.uint64(k0),
            p1 & _LOW,
            (p0 >> _SHIFT) ^ x3 ^ np.uint64(k1),
            p0 & _LOW,
        )
        k0, k1 = (k0 + _W0) & 0xFFFFFFFF, (k1 + _W1) & 0xFFFFFFFF
    shape = np.broadcast_shapes(*(np.shape(x) for x in (x0, x1, x2, x3)))
    w0, w1, w2, w3 = (np.broadcast_to(x, shape).astype(np.uint32) for x in (x0, x1, x2, x3))
    return w0, w1, w2, w3


def block(
    number: int, rows: NDArray[np.int64], columns: NDArray[np.int64], frame: int, key: int
) -> tuple[Words, Words, Words, Words]:
    """The four words of block ``number`` for every pixel (rows[:, None], columns[None, :]) of a window, each (H, W)."""
    x = (columns.astype(np.uint64) & _LOW)[None, :]
    y = (rows.astype(np.uint64) & _LOW)[:, None]
    return philox((x, y, np.uint64(frame), np.uint64(number)), key)  # type: ignore[arg-type]

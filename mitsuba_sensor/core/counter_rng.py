"""Counter-based random number generator (RNG), Philox4x32-10: 32 random bits per noise source, pixel and frame.

Philox (Salmon et al., SC'11) maps a key and a counter to four 32-bit integers, without state. For FPN maps, the key is
a hash of the camera's name and serial number. For temporal noise, it also includes seed, gain setting and exposure.
The counter is (x, y, frame, block) in *sensor* coordinates. Therefore the crop of a frame equals the frame of the crop,
frame 12 needs no frames 0 to 11, and switching off one noise source does not change the random bits of the others.
"""

import hashlib
import json
import zlib
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from .arrays import wide_product, xor3
from .types import Array, RandomBits

Counter: TypeAlias = tuple[Array, Array, Array, Array]

_M0, _M1 = 0xD2511F53, 0xCD9E8D57
_W0, _W1 = 0x9E3779B9, 0xBB67AE85
_MASK = 0xFFFF_FFFF

# Bit of the block number: set for FPN maps, clear for temporal noise.
FIXED_PATTERN = 0x8000_0000
# Bit for sources outside STREAMS; the 30 bits below are a hash of the name.
FROM_NAME = 0x4000_0000

# Noise source → stream (block, slot 0 to 3). Never change a line: the frames of a seed depend on it.
_SLOTS = {
    0: ("photon_shot", "dark_shot", "source_follower", "reset"),
    1: ("rtn_pixels", "rts_state", "quantum_yield", "compensation"),
    2: ("radiation_hit", "radiation_charge"),
    FIXED_PATTERN: ("prnu", "dark_fpn", "dark_fpn_pick", "dark_component"),
    FIXED_PATTERN + 1: ("dsnu_col", "dsnu_row", "prnu_col", "dsnu_pixel"),
    FIXED_PATTERN + 2: ("rts_site", "rtn_site", "read_noise", "noisy_site"),
}
STREAMS = {
    source: (block, slot)
    for block, sources in _SLOTS.items()
    for slot, source in enumerate(sources)
}

CHARGE_SOURCES = frozenset(
    (
        *("photon_shot", "dark_shot", "quantum_yield", "compensation", "rts_state", "rts_site"),
        *("radiation_hit", "radiation_charge", "overflow_dark", "overflow"),
        *("shot_behind_reset_1", "shot_behind_reset_2", "shot_behind_reset_3"),
        *("prnu", "prnu_pick", "dark_fpn", "dark_fpn_pick", "dark_component"),
    )
)
"""Noise sources of the photodiode and its charge, shared by all readouts of the charge."""


def stream_of(source: str, fixed: bool = False) -> tuple[int, int]:
    """Return the stream (block, slot) of a noise source, ``fixed`` for an FPN map; unlisted names are hashed."""
    if source in STREAMS:
        return STREAMS[source]
    block = FROM_NAME | (zlib.crc32(source.encode()) & (FROM_NAME - 1))
    return (block | FIXED_PATTERN if fixed else block), 0


def key_of(*parts: str | int | float) -> int:
    """Return a 64-bit key, the BLAKE2b hash of these parts; floats enter with nine digits."""
    text = json.dumps([f"{x + 0.0:.9g}" if isinstance(x, float) else x for x in parts])
    return int.from_bytes(hashlib.blake2b(text.encode(), digest_size=8).digest(), "little")


def philox(counter: Counter, key: tuple[Array, Array]) -> Counter:
    """Return four random 32-bit integers for a counter and a key; uint64 on NumPy, uint32 on Dr.Jit."""
    x0, x1, x2, x3 = counter
    k0, k1 = key
    for _ in range(10):
        (high0, low0), (high1, low1) = wide_product(x0, _M0), wide_product(x2, _M1)
        x0, x1, x2, x3 = xor3(high1, x1, k0), low1, xor3(high0, x3, k1), low0
        k0, k1 = (k0 + _W0) & _MASK, (k1 + _W1) & _MASK
    return x0, x1, x2, x3


def split_key(key: int) -> tuple[int, int]:
    """Return the lower and upper 32 bits of a 64-bit key."""
    return key & _MASK, key >> 32


def random_bits_at(
    block: int,
    rows: NDArray[np.integer],
    columns: NDArray[np.integer],
    frame: int | NDArray[np.integer],
    key: int,
) -> tuple[RandomBits, RandomBits, RandomBits, RandomBits]:
    """Return four random 32-bit integers of ``block`` at (rows, columns, frame), broadcast together, on NumPy.

    frame : at most 2^32, which has the bits of frame 0 in a row outside every sensor.
    """
    x, y = (n.astype(np.uint64) & np.uint64(_MASK) for n in (columns, rows))
    z = np.asarray(frame).astype(np.uint64)
    drawn = philox((x, y, z, np.uint64(block)), split_key(key))
    shape = np.broadcast_shapes(x.shape, y.shape, z.shape)
    b0, b1, b2, b3 = (np.broadcast_to(b, shape).astype(np.uint32) for b in drawn)
    return b0, b1, b2, b3

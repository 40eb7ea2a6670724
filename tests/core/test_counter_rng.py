"""The counter-based RNG: Philox4x32-10 in sensor coordinates."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from mitsuba_sensor.core.counter_rng import (
    FIXED_PATTERN,
    STREAMS,
    philox,
    random_bits_at,
    split_key,
)

ONES = 0xFFFFFFFF
KNOWN_ANSWERS = [
    ((0, 0, 0, 0), 0, "6627e8d5 e169c58d bc57ac4c 9b00dbd8"),
    ((ONES,) * 4, (ONES << 32) | ONES, "408f276d 41c83b0e a20bc7c6 6d5451fd"),
    (
        (0x243F6A88, 0x85A308D3, 0x13198A2E, 0x03707344),
        (0x299F31D0 << 32) | 0xA4093822,
        "d16cfe09 94fdcceb 5001e420 24126ea1",
    ),
]
"""Counter, key (lower 32 bits first) → output: the kat_vectors file of Random123 (Salmon et al., SC'11)."""


@pytest.mark.parametrize(
    ("counter", "key", "answer"), KNOWN_ANSWERS, ids=["zeros", "ones", "pi"]
)
def test_philox_gives_the_known_answers_of_random123(
    counter: tuple[int, ...], key: int, answer: str
) -> None:
    integers = philox(tuple(np.array([c], dtype=np.uint64) for c in counter), split_key(key))
    assert " ".join(f"{int(integer[0]):08x}" for integer in integers) == answer


def test_a_window_has_the_random_bits_of_its_sensor_pixels() -> None:
    """The counter is (x, y, frame, block), so each pixel's random bits can be computed alone."""
    rows, columns = np.array([3, 4]), np.array([-3, 8, 9])  # the margin of a filter wraps
    window = random_bits_at(5, rows[:, None], columns, frame=12, key=99)
    for (i, y), (j, x) in itertools.product(enumerate(rows), enumerate(columns)):
        alone = philox(
            tuple(np.array([c], dtype=np.uint64) for c in (x % 2**32, y, 12, 5)), split_key(99)
        )
        assert [int(integer[i, j]) for integer in window] == [
            int(integer[0]) for integer in alone
        ]


def test_every_part_of_at_changes_all_four_integers() -> None:
    """x, y, frame, block, low key, high key: a changed bit in any of them changes all four integers."""
    base = [0, 0, 0, 0, 0]
    results = set()
    changes = [
        (0, 1),
        (1, 1),
        (2, 1),
        (3, 1),
        (3, FIXED_PATTERN),
        (4, 1),
        (4, 1 << 32),
        (4, 1 << 63),
    ]
    for place, change in [(0, 0), *changes]:
        at = [value + change * (place == i) for i, value in enumerate(base)]
        integers = philox(
            tuple(np.array([c], dtype=np.uint64) for c in at[:4]), split_key(at[4])
        )
        results.update(int(integer[0]) for integer in integers)
    assert len(results) == 4 * (len(changes) + 1)


def test_no_two_sources_share_random_bits() -> None:
    assert len(set(STREAMS.values())) == len(STREAMS)


def test_every_random_bit_is_set_in_half_of_the_integers() -> None:
    """|z| < 5 for 128 bits of 2^16 integers; chance alone fails with 7e-5 of the seeds."""
    integers = np.array(
        random_bits_at(0, np.arange(256)[:, None], np.arange(256), frame=0, key=1)
    )
    bits = (integers[..., None] >> np.arange(32, dtype=np.uint32)) & 1
    z = (bits.mean(axis=(1, 2)) - 0.5) * 2 * 256
    assert np.abs(z).max() < 5

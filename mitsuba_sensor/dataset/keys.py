"""Keys: the hash of a configuration, which is the name of a sample or light on disk."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Mapping
from functools import cached_property
from json.encoder import encode_basestring
from typing import Any, TypeAlias

from .. import __version__
from ..core.versions import versions

Config: TypeAlias = Mapping[str, Any]
"""Plain values by name, ready for JSON."""
Facts: TypeAlias = dict[str, Any]

LARGEST_WHOLE = 2.0**53  # of which a float64 holds every whole number
DIGITS = 24  # hexadecimal: 96 bits, so that no two of 10^9 samples have the same


class Fixed(Facts):
    """Plain values that many configurations share and nobody changes: their canonical text is made once."""

    @cached_property
    def text(self) -> str:
        """See :func:`canonical`."""
        return canonical({**self})

    def __reduce__(self) -> tuple[object, ...]:
        """For other processes: without the text."""
        return Fixed, ({**self},)


def canonical(value: Any) -> str:
    """Strict JSON of plain values with sorted keys and no spaces: equal configurations have equal text.

    Floats that are whole numbers are integers, so 1.0 is 1 and −0.0 is 0.  Raises ValueError for other values.
    """
    kind = type(value)  # of a million samples this takes most of the time: usual types first
    if kind is str:
        return encode_basestring(value)
    if kind is int:
        return int.__repr__(value)
    if isinstance(value, float) and math.isfinite(value):
        is_whole = value.is_integer() and abs(value) < LARGEST_WHOLE
        return str(int(value)) if is_whole else float.__repr__(value)
    if isinstance(value, Fixed):
        return value.text
    if isinstance(value, dict):
        parts = [
            f"{encode_basestring(name)}:{canonical(value[name])}" for name in sorted(value)
        ]
        return f"{{{','.join(parts)}}}"
    if isinstance(value, list | tuple):
        return f"[{','.join(map(canonical, value))}]"
    if value is None or kind is bool:
        return {None: "null", True: "true", False: "false"}[value]
    raise ValueError(f"{value!r:.100} is no plain value")


def key_of(config: Config) -> str:
    """The first 24 hexadecimal digits of SHA-256 over the canonical text."""
    return key_of_text(canonical(config))


def key_of_text(text: str) -> str:
    """The same of a canonical text."""
    return hashlib.sha256(text.encode()).hexdigest()[:DIGITS]


def made_by() -> dict[str, str | None]:
    """Versions of what the pixels of a dataset depend on; None for what is not installed.

    All other libraries read, write and draw, or are known to give the same bits in every version.
    """
    return {
        "mitsuba-sensor": __version__,
        **{name: versions()[name] for name in ("mitsuba", "drjit", "pyoidn")},
    }


def seed_of(key: str) -> int:
    """A seed of 63 bits that belongs to a key."""
    return int.from_bytes(hashlib.blake2b(key.encode(), digest_size=8).digest(), "little") >> 1

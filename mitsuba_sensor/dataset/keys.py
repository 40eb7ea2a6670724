"""Keys: hashes of configurations, which name samples, lights and tasks on disk."""

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

WHOLE_FLOAT_END = 2.0**53  # float64 holds every whole number below
KEY_DIGITS = 24  # hexadecimal: 96 bits, so 10^9 samples have different keys


class Fixed(Facts):
    """Plain values that many configurations share unchanged: their canonical text is made once."""

    @cached_property
    def text(self) -> str:
        """Return the text of :func:`canonical`."""
        return canonical({**self})

    def __reduce__(self) -> tuple[object, ...]:
        """Pickle without the text."""
        return Fixed, ({**self},)


def canonical(value: Any) -> str:
    """Return strict JSON of plain values with sorted keys and no spaces: equal configurations have equal text.

    Whole floats are written as integers, so 1.0 is 1 and −0.0 is 0.  Raises ValueError for other values.
    """
    kind = type(
        value
    )  # the usual types first: a plan of a million samples spends most of its time here
    if kind is str:
        return encode_basestring(value)
    if kind is int:
        return int.__repr__(value)
    if isinstance(value, float) and math.isfinite(value):
        is_whole = value.is_integer() and abs(value) < WHOLE_FLOAT_END
        return str(int(value)) if is_whole else float.__repr__(value)
    if isinstance(value, Fixed):
        return value.text
    if isinstance(value, dict):
        entries = (f"{encode_basestring(x)}:{canonical(value[x])}" for x in sorted(value))
        return f"{{{','.join(entries)}}}"
    if isinstance(value, list | tuple):
        return f"[{','.join(map(canonical, value))}]"
    if value is None or kind is bool:
        return {None: "null", True: "true", False: "false"}[value]
    raise ValueError(f"{value!r:.100} is not a plain value")


def key_of(config: Config) -> str:
    """Return the key of a configuration."""
    return key_of_text(canonical(config))


def key_of_text(text: str) -> str:
    """Return the first 24 hexadecimal digits of the SHA-256 of a canonical text."""
    return hashlib.sha256(text.encode()).hexdigest()[:KEY_DIGITS]


def made_by() -> dict[str, str | None]:
    """Return the versions of the libraries that decide the pixels of a dataset; None for a missing library.

    Other libraries only read, write or draw, or give the same bits in every version.
    """
    names = ("mitsuba", "drjit", "pyoidn")
    return {"mitsuba-sensor": __version__, **{name: versions()[name] for name in names}}


def seed_of(key: str) -> int:
    """Return the 63-bit seed of a key."""
    return int.from_bytes(hashlib.blake2b(key.encode(), digest_size=8).digest(), "little") >> 1

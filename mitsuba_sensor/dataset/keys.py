"""Keys: the hash of a configuration, which is the name of a sample or view on disk."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from typing import Any, TypeAlias

from .. import __version__
from ..core.versions import versions

Config: TypeAlias = Mapping[str, Any]
"""Plain values by name, ready for JSON."""
Facts: TypeAlias = dict[str, Any]

LARGEST_WHOLE = 2.0**53  # of which a float64 holds every whole number
_AS_THEY_ARE = {str, int, bool, type(None)}
DIGITS = 24  # hexadecimal: 96 bits, so that no two of 10^9 samples have the same


_STRICT = json.JSONEncoder(
    sort_keys=True, separators=(",", ":"), ensure_ascii=False, allow_nan=False
)


def canonical(config: Config) -> str:
    """Strict JSON of plain values with sorted keys and no spaces: equal configurations, equal text; 1.0 is 1."""
    return _STRICT.encode(_plain(config))


def _plain(value: object) -> object:
    """The same with floats that are whole numbers as integers; −0.0 is 0.

    Each sample has three such texts: most of what a plan takes. So the usual types are asked for before any other.
    """
    if type(value) in _AS_THEY_ARE:
        return value
    if isinstance(value, dict | Mapping):
        found = dict(value)
        for name, one in found.items():
            if type(one) not in _AS_THEY_ARE:
                found[name] = _plain(one)
        return found
    if isinstance(value, float) and value.is_integer() and abs(value) < LARGEST_WHOLE:
        return int(value)
    if isinstance(value, list | tuple):
        return [_plain(one) for one in value]
    return value


def key_of(config: Config) -> str:
    """The first 24 hexadecimal digits of SHA-256 over the canonical text."""
    return key_of_text(canonical(config))


def key_of_text(text: str) -> str:
    """The same of a canonical text."""
    return hashlib.sha256(text.encode()).hexdigest()[:DIGITS]


def identity(config: Config, camera_key: str | None = None) -> str:
    """The key of what decides the pixels of a sample, whatever its files.  camera_key : of its datasheet, if known."""
    own = {name: value for name, value in config.items() if name != "outputs"}
    return key_of({**own, "camera": camera_key or key_of(config["camera"])})


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

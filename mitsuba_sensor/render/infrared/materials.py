"""Measured near-infrared reflectance of materials, and the option that says what RGB colours reflect there."""

from __future__ import annotations

import re
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Final, Literal, NamedTuple, TypeAlias

import numpy as np

from ...core import Float64Array, InputError, nearest
from ...files.texts import read_toml

HELD_FROM_NM = 700.0
"""From here on a colour has the value of its rule: an RGB colour says what is seen, and people see to here."""

SEEN_TO_NM = 720.0
"""Bands that end before have no rule: behind an infrared cut filter the colour is seen as Mitsuba has it."""

HOLD: Final = "hold"
REFUSE: Final = "refuse"
FILE = Path(__file__).parent / "materials.toml"
EXAMPLE = "'hold', 'refuse', or materials by BSDF or shape id, {'leaf_*': 'vegetation'}"

AskedInfrared: TypeAlias = Literal["refuse"] | Mapping[str, str]
"""Names of materials by patterns of ids, or "refuse"; no patterns: every colour is held."""


class Material(NamedTuple):
    """Reflectance at wavelengths from 700 nm on, linear in between, held beyond the last one."""

    name: str
    source: str
    wavelengths_nm: Float64Array
    reflectance: Float64Array

    def at(self, wavelengths_nm: Float64Array) -> Float64Array:
        """Reflectance at any wavelengths."""
        return np.interp(wavelengths_nm, self.wavelengths_nm, self.reflectance)


@cache
def materials() -> Mapping[str, Material]:
    """The measured materials by name."""
    return {
        name: Material(
            name,
            table["source"],
            np.array(table["wavelengths_nm"], dtype=np.float64),
            np.array(table["reflectance"], dtype=np.float64),
        )
        for name, table in read_toml(FILE).items()
    }


def checked_infrared(name: str, given: object) -> AskedInfrared:
    """The rule that is asked for.  given : "hold", "refuse", texts IDS=MATERIAL, or a dict. Raises
    InputError."""
    texts = [given] if isinstance(given, str) else given
    if isinstance(texts, list | tuple) and all(isinstance(text, str) for text in texts):
        if [*texts] == [REFUSE]:
            return REFUSE
        if [*texts] == [HOLD]:
            return {}
        given = dict(_pair(name, text) for text in texts)
    if not isinstance(given, Mapping):
        raise InputError(f"{name} is {given!r}; pass {EXAMPLE}.")
    for pattern, material in given.items():
        if material not in materials():
            known = ", ".join(materials())
            raise InputError(
                f"{name} of {pattern!r} is {material!r}; the materials are {known}."
                f"{nearest(str(material), materials())}"
            )
    return {str(pattern): str(material) for pattern, material in given.items()}


def _pair(name: str, text: str) -> tuple[str, str]:
    """``leaf_*=vegetation`` in two."""
    found = re.fullmatch(r"\s*([^=]+?)\s*=\s*([^=]*?)\s*", text)
    if found is None:
        raise InputError(f"{name} is {text!r}; pass {EXAMPLE}.")
    return found[1], found[2]

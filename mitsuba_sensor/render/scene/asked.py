"""Checks the options that change a scene: parameters by name, a pose, light groups, and RGB colours in the infrared."""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Final, Literal, NamedTuple, TypeAlias

import numpy as np
from pydantic import ValidationError

from ...camera.datasheet_errors import sentence
from ...core import Float64Array, InputError, nearest
from ...core.errors import shown
from ...core.id_groups import as_options, groups_of_ids
from ...files.texts import read_toml
from .motion import KeyPose

Numbers: TypeAlias = tuple[float, ...]
NUMBERS_MAX = 16  # of one parameter: a transform
NUMBER_MAX = float(np.finfo(np.float32).max)
POSE_FIELDS = ("origin_m", "target_m", "up")
POSE_EXAMPLE = "'0,1,4 0,1,0' or {'origin_m': [0, 1, 4], 'target_m': [0, 1, 0]}"


def checked_traverse(name: str, given: object) -> dict[str, Numbers]:
    """Return the numbers of each parameter named by the option ``traverse``. Raises InputError."""
    if not isinstance(given, Mapping):
        example = "{'lamp.emitter.radiance.value': 2.0}"
        raise InputError(f"{name} is {given!r}; pass names and numbers, e.g. {example}.")
    return {
        str(key): _numbers(f"{name} of {str(key)!r}", value) for key, value in given.items()
    }


def _numbers(what: str, given: object) -> Numbers:
    try:
        numbers = np.asarray(given)
    except ValueError:  # rows of different lengths
        numbers = np.asarray("")
    if numbers.dtype.kind not in "iuf" or not (np.abs(numbers) <= NUMBER_MAX).all():
        raise InputError(
            f"{what} is {shown(given)}; it must be a finite number, or a list of finite numbers."
        )
    if not 1 <= numbers.size <= NUMBERS_MAX:
        raise InputError(
            f"{what} has {numbers.size} numbers; a parameter has from 1 to {NUMBERS_MAX}."
        )
    return tuple(map(float, numbers.ravel()))


def checked_look_at(name: str, given: object) -> dict[str, Numbers]:
    """Return position, target and up direction of the camera by field, from a text such as "0,1,4 0,1,0" or a mapping.
    Raises InputError."""
    fields = given
    if isinstance(given, str):
        points = given.split()
        try:
            numbers = [[float(number) for number in point.split(",")] for point in points]
        except ValueError:
            numbers = []
        fields = dict(zip(POSE_FIELDS, numbers, strict=False)) if len(points) <= 3 else {}
    if not isinstance(fields, Mapping) or any(
        fields.get(key) is None for key in POSE_FIELDS[:2]
    ):
        raise InputError(
            f"{name} is {given!r}; pass origin, target and, if needed, up: {POSE_EXAMPLE}."
        )
    try:
        pose = KeyPose.model_validate({"time_s": 0, **fields})
    except ValidationError as error:
        raise InputError(sentence(error, KeyPose, name, "pose")) from None
    return {key: getattr(pose, key) for key in POSE_FIELDS}


# Light groups: patterns of emitter ids by the name of their group, or "auto".

GROUPS_MAX = 16
GROUP_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_-]*")
PATTERN_EXAMPLE = "`--light-groups lamps=lamp_* --light-groups sky=sky,moon` ({'lamps': 'lamp_*', 'sky': 'sky,moon'})"
GROUP_EXAMPLE = "'auto', or {'sky': 'env', 'lamps': 'lamp_*'}"

AskedGroups: TypeAlias = Literal["auto"] | Mapping[str, tuple[str, ...]]
"""Patterns of emitter ids by the name of their group, or "auto"."""


def checked_light_groups(name: str, given: object) -> AskedGroups:
    """Return the patterns of each group, or "auto".  given : "auto", texts NAME=PATTERN,PATTERN, or a dict. Raises
    InputError."""
    if (texts := _texts(given)) == ["auto"]:
        return "auto"
    if texts is not None:
        by_group = dict[str, tuple[str, ...]]()
        for text in texts:
            group, _, ids = (half.strip() for half in text.partition("="))
            by_group[group] = (*by_group.get(group, ()), *_patterns(ids))
        given = by_group
    if not isinstance(given, Mapping) or not given:
        raise InputError(f"{name} is {given!r}; pass {GROUP_EXAMPLE}.")
    groups = {str(group): _patterns(patterns) for group, patterns in given.items()}
    for group, patterns in groups.items():
        if not GROUP_NAME.fullmatch(group) or not patterns:
            raise InputError(
                f"{name} has {group!r}: {','.join(patterns)!r}; give a name of letters, digits, _ and -, and the ids "
                f"of the group's emitters, e.g. {GROUP_EXAMPLE}."
            )
    refuse_many(name, groups)
    return groups


def _texts(given: object) -> list[str] | None:
    """Return the texts of an option that is a text or a list of texts; else None."""
    texts = [given] if isinstance(given, str) else given
    is_text = isinstance(texts, list | tuple) and all(isinstance(text, str) for text in texts)
    return [*texts] if is_text else None  # type: ignore[misc]


def _patterns(given: object) -> tuple[str, ...]:
    listed = given if isinstance(given, list | tuple) else str(given).split(",")
    return tuple(pattern for pattern in (str(item).strip() for item in listed) if pattern)


def refuse_many(name: str, groups: Collection[str], ids: Sequence[str] = ()) -> None:
    """Raise InputError for too many groups.  ids : of the emitters, from which fewer groups are suggested."""
    if len(groups) <= GROUPS_MAX:
        return
    suggested = groups_of_ids(dict.fromkeys(ids))
    example = f"e.g. {PATTERN_EXAMPLE} ({', '.join(groups)})"
    if 0 < len(suggested) <= GROUPS_MAX:
        example = f"as the ids of this scene suggest, `{as_options(suggested)}` ({suggested})"
    raise InputError(
        f"{name} makes {len(groups)} groups, each a separate render; at most {GROUPS_MAX} are allowed: put several "
        f"emitters into one group by patterns of their ids, {example}."
    )


# RGB colours beyond 700 nm: measured materials by patterns of ids, or "refuse".

HELD_FROM_NM = 700.0
"""Above this wavelength a colour follows its rule: RGB describes what people see, and they see up to here."""
HOLD: Final = "hold"
REFUSE: Final = "refuse"
FILE = Path(__file__).parent / "materials.toml"
EXAMPLE = "'hold', 'refuse', or materials by BSDF or shape id, {'leaf_*': 'vegetation'}"

AskedInfrared: TypeAlias = Literal["refuse"] | Mapping[str, str]
"""Names of materials by patterns of ids, or "refuse"; without patterns all colours keep their value at 700 nm."""


class Material(NamedTuple):
    """Measured reflectance from 700 nm, interpolated linearly; the last value is held."""

    name: str
    source: str
    wavelengths_nm: Float64Array
    reflectance: Float64Array

    def at(self, wavelengths_nm: Float64Array) -> Float64Array:
        """Return the reflectance at these wavelengths."""
        return np.interp(wavelengths_nm, self.wavelengths_nm, self.reflectance)


@cache
def materials() -> Mapping[str, Material]:
    """Return the measured materials by name."""
    return {
        name: Material(
            name,
            table["source"],
            *(np.array(table[key], np.float64) for key in Material._fields[2:]),
        )
        for name, table in read_toml(FILE).items()
    }


def checked_infrared(name: str, given: object) -> AskedInfrared:
    """Return the requested rule.  given : "hold", "refuse", texts IDS=MATERIAL, or a dict. Raises InputError."""
    if (texts := _texts(given)) == [REFUSE]:
        return REFUSE
    if texts is not None:
        pairs = [text.partition("=") for text in texts if text != HOLD]
        if all(sign for _, sign, _ in pairs):
            given = {pattern.strip(): material.strip() for pattern, _, material in pairs}
    if not isinstance(given, Mapping):
        raise InputError(f"{name} is {given!r}; pass {EXAMPLE}.")
    for pattern, material in given.items():
        if material not in materials():
            raise InputError(
                f"{name} of {pattern!r} is {material!r}; the materials are {', '.join(materials())}."
                f"{nearest(str(material), materials())}"
            )
    return {str(pattern): str(material) for pattern, material in given.items()}

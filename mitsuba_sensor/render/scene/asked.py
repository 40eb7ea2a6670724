"""Options that change a scene, checked: parameters by name, a pose, light groups, and what RGB is in the infrared."""

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
from ...core.id_groups import as_options, groups_of_ids
from ...files.texts import read_toml
from .motion import KeyPose

Numbers: TypeAlias = tuple[float, ...]
NUMBERS_MAX = 16  # of one parameter: a transform
LARGEST = float(np.finfo(np.float32).max)
POSE_FIELDS = ("origin_m", "target_m", "up")
POSE_EXAMPLE = "'0,1,4 0,1,0', or {'origin_m': [0, 1, 4], 'target_m': [0, 1, 0]}"


def checked_traverse(name: str, given: object) -> dict[str, Numbers]:
    """Return names and numbers of the option ``traverse``; a single number is a list of one. Raises InputError."""
    if not isinstance(given, Mapping):
        example = "{'lamp.emitter.radiance.value': 2.0}"
        raise InputError(f"{name} is {given!r}; pass names and numbers, e.g. {example}.")
    return {
        str(key): _numbers(f"{name} of {str(key)!r}", value) for key, value in given.items()
    }


def _numbers(what: str, given: object) -> Numbers:
    value = given.tolist() if hasattr(given, "tolist") else given
    rows: Sequence[object] = value if isinstance(value, list | tuple) else (value,)
    flat = [x for row in rows for x in (row if isinstance(row, list | tuple) else (row,))]
    for number in flat:
        if (
            isinstance(number, bool)
            or not isinstance(number, int | float)
            or not abs(number) <= LARGEST
        ):
            raise InputError(
                f"{what} is {given!r}; it must be a finite number, or a list of them."
            )
    if not 1 <= len(flat) <= NUMBERS_MAX:
        raise InputError(
            f"{what} has {len(flat)} numbers; a parameter has from 1 to {NUMBERS_MAX}."
        )
    return tuple(map(float, flat))


def checked_look_at(name: str, given: object) -> dict[str, Numbers]:
    """Return the fields of the option ``look_at``: where the camera is, what it looks at [m], and what is up; of a text
    such as "0,1,4 0,1,0", or a mapping. Raises InputError."""
    if isinstance(given, str):
        points = given.split()
        try:
            numbers = [[float(number) for number in point.split(",")] for point in points]
        except ValueError:
            numbers = []
        if len(numbers) not in (2, 3):
            raise InputError(
                f"{name} is {given!r}; write origin, target and, if needed, up, e.g. '0,1,4 0,1,0'."
            )
        given = dict(zip(POSE_FIELDS, numbers, strict=False))
    if not isinstance(given, Mapping):
        raise InputError(f"{name} is {given!r}; pass {POSE_EXAMPLE}.")
    for key in given:
        if key not in POSE_FIELDS:
            hint = nearest(str(key), POSE_FIELDS)
            raise InputError(f"{name} has {key!r}; it has {', '.join(POSE_FIELDS)}.{hint}")
    for key in POSE_FIELDS[:2]:
        if given.get(key) is None:
            raise InputError(f"{name} has no {key}; pass {POSE_EXAMPLE}.")
    try:
        pose = KeyPose(time_s=0, **given)
    except ValidationError as error:
        raise InputError(sentence(error, KeyPose, name, "pose")) from None
    return {key: getattr(pose, key) for key in POSE_FIELDS}


# Light groups: patterns of emitter ids by the name of their group, or "auto".

MOST_GROUPS = 16
GROUP_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_-]*")
PATTERN_EXAMPLE = "`--light-groups lamps=lamp_* --light-groups sky=sky,moon` ({'lamps': 'lamp_*', 'sky': 'sky,moon'})"
GROUP_EXAMPLE = "'auto', or {'sky': 'env', 'lamps': 'lamp_*'}"

AskedGroups: TypeAlias = Literal["auto"] | Mapping[str, tuple[str, ...]]
"""Patterns of emitter ids by the name of their group, or "auto"."""


def checked_light_groups(name: str, given: object) -> AskedGroups:
    """Patterns by group, or "auto".  given : "auto", texts NAME=PATTERN,PATTERN, or a dict. Raises
    InputError."""
    if (texts := _texts(given)) == ["auto"]:
        return "auto"
    if texts is not None:
        by_group = dict[str, tuple[str, ...]]()
        for text in texts:
            name_of_group, _, ids = (part.strip() for part in text.partition("="))
            by_group[name_of_group] = (*by_group.get(name_of_group, ()), *_patterns(ids))
        given = by_group
    if not isinstance(given, Mapping) or not given:
        raise InputError(f"{name} is {given!r}; pass {GROUP_EXAMPLE}.")
    groups = {str(group): _patterns(patterns) for group, patterns in given.items()}
    for group, patterns in groups.items():
        if not GROUP_NAME.fullmatch(group) or not patterns:
            raise InputError(
                f"{name} has {group!r}: {','.join(patterns)!r}; a group is a name of letters, digits, _ and -, and "
                f"the ids of its emitters, e.g. {GROUP_EXAMPLE}."
            )
    refuse_many(name, groups)
    return groups


def _texts(given: object) -> list[str] | None:
    """The texts of an option that is a text, or a list of them; else None."""
    texts = [given] if isinstance(given, str) else given
    is_text = isinstance(texts, list | tuple) and all(isinstance(text, str) for text in texts)
    return [*texts] if is_text else None  # type: ignore[misc]


def _patterns(given: object) -> tuple[str, ...]:
    listed: Sequence[object] = (
        given if isinstance(given, list | tuple) else str(given).split(",")
    )
    return tuple(pattern for pattern in (str(part).strip() for part in listed) if pattern)


def refuse_many(name: str, groups: Collection[str], ids: Sequence[str] = ()) -> None:
    """Raise InputError for more groups than there may be.  ids : of the emitters, for those that the scene suggests."""
    if len(groups) <= MOST_GROUPS:
        return
    suggested = groups_of_ids(dict.fromkeys(ids))
    example = f"e.g. {PATTERN_EXAMPLE} ({', '.join(groups)})"
    if 0 < len(suggested) <= MOST_GROUPS:
        example = f"as the ids of this scene suggest, `{as_options(suggested)}` ({suggested})"
    raise InputError(
        f"{name} makes {len(groups)} groups, each a separate render; at most {MOST_GROUPS}: put several emitters "
        f"into one by patterns of their ids, {example}."
    )


# What RGB colours are beyond 700 nm: measured materials by patterns of ids, or "refuse".

HELD_FROM_NM = 700.0
"""From here on a colour has the value of its rule: an RGB colour says what is seen, and people see to here."""
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
            known = ", ".join(materials())
            raise InputError(
                f"{name} of {pattern!r} is {material!r}; the materials are {known}."
                f"{nearest(str(material), materials())}"
            )
    return {str(pattern): str(material) for pattern, material in given.items()}

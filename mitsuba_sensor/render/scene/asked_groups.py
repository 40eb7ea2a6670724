"""Light groups as they are asked for: patterns of emitter ids by the name of their group, or "auto"."""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping, Sequence
from typing import Literal, TypeAlias

from ...core import InputError
from ...core.id_groups import as_options, groups_of_ids

MOST_GROUPS = 16
GROUP_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_-]*")
PATTERN_EXAMPLE = "`--light-groups lamps=lamp_* --light-groups sky=sky,moon` ({'lamps': 'lamp_*', 'sky': 'sky,moon'})"
EXAMPLE = "'auto', or {'sky': 'env', 'lamps': 'lamp_*'}"

AskedGroups: TypeAlias = Literal["auto"] | Mapping[str, tuple[str, ...]]
"""Patterns of emitter ids by the name of their group, or "auto"."""


def checked_light_groups(name: str, given: object) -> AskedGroups:
    """Patterns by group, or "auto".  given : "auto", texts NAME=PATTERN,PATTERN, or a dict. Raises
    InputError."""
    texts = [given] if isinstance(given, str) else given
    if isinstance(texts, list | tuple) and [*texts] == ["auto"]:
        return "auto"
    if isinstance(texts, list | tuple) and all(isinstance(text, str) for text in texts):
        given = _patterns_of_texts(texts)
    if not isinstance(given, Mapping) or not given:
        raise InputError(f"{name} is {given!r}; pass {EXAMPLE}.")
    groups = {str(group): _patterns(patterns) for group, patterns in given.items()}
    for group, patterns in groups.items():
        if not GROUP_NAME.fullmatch(group) or not patterns:
            raise InputError(
                f"{name} has {group!r}: {','.join(patterns)!r}; a group is a name of letters, digits, _ and -, and "
                f"the ids of its emitters, e.g. {EXAMPLE}."
            )
    refuse_many(name, groups)
    return groups


def _patterns_of_texts(texts: Sequence[str]) -> dict[str, tuple[str, ...]]:
    """["lamps=lamp_1", "lamps=lamp_2"] as {"lamps": ("lamp_1", "lamp_2")}."""
    groups = dict[str, tuple[str, ...]]()
    for text in texts:
        group, _, patterns = text.partition("=")
        name = group.strip()
        groups[name] = (*groups.get(name, ()), *_patterns(patterns))
    return groups


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
        f"{name} makes {len(groups)} groups, each a render of its own; at most {MOST_GROUPS}: put several emitters "
        f"into one by patterns of their ids, {example}."
    )

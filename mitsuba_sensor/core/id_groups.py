"""Names that begin alike, put into groups: lamp_1, lamp_2 and sky are lamp=lamp_* and sky=sky."""

from __future__ import annotations

from collections.abc import Iterable


def groups_of_ids(ids: Iterable[str]) -> dict[str, str]:
    """Group → pattern of the ids in it. Ids that are alike up to their first _ are a group."""
    members: dict[str, list[str]] = {}
    for one in ids:
        members.setdefault(one.partition("_")[0], []).append(one)
    return {
        beginning if len(names) > 1 else names[0]: _pattern(beginning, names)
        for beginning, names in members.items()
    }


def _pattern(beginning: str, names: list[str]) -> str:
    if len(names) == 1:
        return names[0]
    pattern = f"{beginning}_*"
    if beginning in names:
        return f"{beginning},{pattern}"
    return pattern


def as_options(groups: dict[str, str]) -> str:
    """How the groups are written on the command line."""
    return " ".join(f"--light-groups {name}={pattern}" for name, pattern in groups.items())

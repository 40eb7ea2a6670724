"""Groups of ids with equal beginnings: lamp_1, lamp_2 and sky become lamp=lamp_* and sky=sky."""

from __future__ import annotations

from collections.abc import Iterable


def groups_of_ids(ids: Iterable[str]) -> dict[str, str]:
    """Return group → pattern of its ids. Ids that agree up to their first _ form a group."""
    members: dict[str, list[str]] = {}
    for name in ids:
        members.setdefault(name.partition("_")[0], []).append(name)
    groups = {}
    for beginning, names in members.items():
        if len(names) == 1:
            groups[names[0]] = names[0]
        else:
            groups[beginning] = f"{beginning}," * (beginning in names) + f"{beginning}_*"
    return groups


def as_options(groups: dict[str, str]) -> str:
    """Return the groups as command-line flags."""
    return " ".join(f"--light-groups {name}={pattern}" for name, pattern in groups.items())

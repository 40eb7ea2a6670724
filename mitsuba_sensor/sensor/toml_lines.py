"""Line numbers of the keys of a TOML text, which the parser of the standard library does not give."""

from __future__ import annotations

import tomllib
from collections.abc import Iterator
from typing import Any, TypeAlias

KeyPath: TypeAlias = tuple[str | int, ...]

ENDS = ("]", '"""', "'''")
"""One of these stands in the last line of whatever goes over several lines."""


class TomlLines:
    """Where the tables and keys of a valid TOML text stand: the number of the first line of each, from 1."""

    def __init__(self, text: str) -> None:
        self._lines: dict[KeyPath, int] = {}
        self._lengths: dict[KeyPath, int] = {}  # of the lists of tables
        table: KeyPath = ()
        for number, statement in _statements(text):
            paths = list(_paths(tomllib.loads(statement)))
            if statement.lstrip().startswith("["):
                table = self._header(paths[-1], of_list=statement.lstrip().startswith("[["))
                paths = [()]
            for path in paths:
                for end in range(len(table) + len(path)):
                    self._lines.setdefault((*table, *path)[: end + 1], number)

    def __call__(self, path: KeyPath) -> int | None:
        """The line of a key, or of the innermost table or list around it that has one."""
        return next((self._lines[path[:end]] for end in range(len(path), 0, -1) if path[:end] in self._lines), None)

    def rename(self, old: KeyPath, new: KeyPath) -> None:
        """Find what has one name under another one too."""
        for path, number in list(self._lines.items()):
            if path[: len(old)] == old:
                self._lines[(*new, *path[len(old) :])] = number

    def _header(self, keys: KeyPath, of_list: bool) -> KeyPath:
        """The path of the table that a header begins; one of a list has its number behind the list's name."""
        path: KeyPath = ()
        for key in keys:
            path = (*path, key)
            if of_list and len(path) - sum(isinstance(x, int) for x in path) == len(keys):
                self._lengths[path] = self._lengths.get(path, 0) + 1
            if path in self._lengths:
                path = (*path, self._lengths[path] - 1)
        return path


def _statements(text: str) -> Iterator[tuple[int, str]]:
    """Headers and assignments, each with the number of its first line; one may go over several lines."""
    begun, first = "", 0
    for number, line in enumerate(text.split("\n"), start=1):
        if not begun and line.strip()[:1] in ("", "#"):
            continue
        first, goes_on, begun = first if begun else number, bool(begun), f"{begun}{line}\n"
        if goes_on and not any(end in line for end in ENDS):
            continue
        try:
            tomllib.loads(begun)
        except tomllib.TOMLDecodeError:
            continue
        yield first, begun
        begun = ""


def _paths(data: dict[str, Any], path: KeyPath = ()) -> Iterator[KeyPath]:
    """The keys of nested tables, each behind the tables around it."""
    for key, value in data.items():
        yield (*path, key)
        if isinstance(value, dict):
            yield from _paths(value, (*path, key))

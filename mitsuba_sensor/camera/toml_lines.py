"""Line numbers of the keys of a TOML text, which the parser of the standard library does not give."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, TypeAlias

from ..core.small_files import toml_tables, without_strings

KeyPath: TypeAlias = tuple[str | int, ...]


class TomlLines:
    """Where the tables and keys of a valid TOML text stand: the number of the first line of each, from 1."""

    def __init__(self, text: str) -> None:
        self._lines: dict[KeyPath, int] = {}
        self._lengths: dict[KeyPath, int] = {}  # of the lists of tables
        table: KeyPath = ()
        for number, statement in _statements(text):
            paths = list(_paths(toml_tables(statement)))
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
    """Headers and assignments, each with the number of its first line; one goes on while a bracket is open."""
    start, first, number, open_brackets = 0, 1, 1, 0
    position = 0
    for line in without_strings(text).split("\n"):  # a string of several lines is in one of these
        end = position + len(line)
        number += text.count("\n", position, end) + 1
        open_brackets += sum(map(line.count, "[{")) - sum(map(line.count, "]}"))
        position = end + 1
        if open_brackets:
            continue
        if line.strip():
            yield first, text[start:end]
        start, first = position, number


def _paths(data: dict[str, Any], path: KeyPath = ()) -> Iterator[KeyPath]:
    """The keys of nested tables, each behind the tables around it."""
    for key, value in data.items():
        yield (*path, key)
        if isinstance(value, dict):
            yield from _paths(value, (*path, key))

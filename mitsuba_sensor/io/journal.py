"""Measurements that outlive the process that made them: a line of JSON each, written as they come."""

from __future__ import annotations

import json
from collections.abc import Iterator, MutableMapping
from pathlib import Path
from typing import Any

from ..core.errors import InputError
from .files import disk_sentences, plain_values


class Journal(MutableMapping[str, Any]):
    """A dict of measurements by name that is also a file; a study that was stopped finds there what it had done.

    path : the file; made, or changed, with the first measurement.
    question : all that decides what is measured. A file that answers another question is refused, so that measurements
        of two cameras never stand in one table.
    again : forget what the file holds.
    Raises InputError for a file that answers another question or is none of ours.
    """

    def __init__(self, path: Path, question: dict[str, Any], again: bool = False) -> None:
        self.path = path
        asked = _line({"question": question})
        kept = [] if again else _lines(path)
        if kept and kept[0] != json.loads(asked):
            raise InputError(
                f"{path} holds measurements of another question ({_difference(kept[0], json.loads(asked))}); "
                "give another folder (-o), or --force to measure anew."
            )
        self._known: dict[str, Any] = {line["name"]: line["value"] for line in kept[1:]}
        self._start: str | None = "".join(_line(line) for line in kept) or asked

    def __getitem__(self, name: str) -> Any:
        return self._known[name]

    def __setitem__(self, name: str, value: Any) -> None:
        text = _line({"name": name, "value": value})
        with disk_sentences(self.path):
            if self._start is not None:  # without a last line that was cut short, or anew
                self.path.parent.mkdir(parents=True, exist_ok=True)
                self.path.write_text(self._start, encoding="utf-8")
                self._start = None
            with self.path.open("a", encoding="utf-8") as file:
                file.write(text)
        self._known[name] = json.loads(text)["value"]  # what a later process will read, nothing finer

    def __delitem__(self, name: str) -> None:
        raise TypeError("a journal forgets nothing")

    def __iter__(self) -> Iterator[str]:
        return iter(self._known)

    def __len__(self) -> int:
        return len(self._known)


def _line(value: Any) -> str:
    return json.dumps(plain_values(value, finite=False), ensure_ascii=False) + "\n"


def _lines(path: Path) -> list[dict[str, Any]]:
    """What the file holds; a last line that was cut short is not there."""
    if not path.exists():
        return []
    try:
        whole, _, _ = path.read_text(encoding="utf-8").rpartition("\n")
        found = [json.loads(line) for line in whole.splitlines()]
        if found and not ("question" in found[0] and all({"name", "value"} <= set(line) for line in found[1:])):
            raise ValueError("it has other lines")
    except (OSError, ValueError, TypeError) as error:
        raise InputError(f"{path} is no journal of a study ({error}); give another folder (-o), or --force.") from None
    return found


def _difference(one: dict[str, Any], other: dict[str, Any]) -> str:
    """Names of what differs between two questions, innermost first."""
    return ", ".join(_differing(one["question"], other["question"])) or "other words"


def _differing(one: Any, other: Any, name: str = "") -> Iterator[str]:
    if isinstance(one, dict) and isinstance(other, dict):
        for key in sorted(one.keys() | other.keys()):
            yield from _differing(one.get(key), other.get(key), f"{name}.{key}" if name else key)
    elif one != other:
        yield name

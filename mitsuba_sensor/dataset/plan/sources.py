"""The files that a dataset is made from, with their digests: scenes and all that they read, motions, cameras.

A lens that ships with the package, which a camera names, is none of them: its version stands for it.
"""

from __future__ import annotations

import os
from collections.abc import Container, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple, TypeAlias

from ...camera.shipped import SHIPPED
from ...core import InputError
from ...files import durable
from ...files.scene_references import check_below
from ...files.shipped_scenes import scenes_folder
from ..store.faults import Fault, what_is_wrong
from .roots import find_below

if TYPE_CHECKING:
    from .planned import DatasetPlan

PACKAGE = "mitsuba_sensor:"
"""Before the names of files that ship with the package."""


class Source(NamedTuple):
    """A file that a dataset is made from.  use : what is made from it, e.g. "scene cornell"."""

    bytes: int
    sha256: str
    use: str


Sources: TypeAlias = Mapping[str, Source]
"""Name below the roots → the file."""


def sources_of(plan: DatasetPlan) -> dict[str, Source]:
    """All files that the samples of a plan are made from. Raises InputError for one outside of the roots."""
    uses = dict[Path, str]()
    for path, use in plan.files():
        uses.setdefault(path, use)
    found = dict[str, Source]()
    for path, use in uses.items():
        name = _printable(_name_of(path, plan.roots))
        found[name] = Source(*durable.size_and_hash(path), _printable(use))
    return dict(sorted(found.items()))


def read_sources(said: object) -> dict[str, Source]:
    """The sources that JSON has of them. Raises TypeError, ValueError and AttributeError for what is none."""
    found = dict[str, Source]()
    for name, (size, digest, use) in said.items():  # type: ignore[attr-defined]
        if not (isinstance(size, int) and all(map(_is_line, (name, digest, use)))):
            raise ValueError(name)
        found[name] = Source(size, digest, use)
    return found


def changed_sources(old: Sources, new: Sources) -> list[str]:
    """Names of the files that both have, with another content."""
    return [name for name, file in old.items() if name in new and new[name][:2] != file[:2]]


def uses_of(plan: DatasetPlan, names: Container[str]) -> set[str]:
    """All that is made from the files with these names."""
    files = plan.files()
    return {use for path, use in files if _printable(_name_of(path, plan.roots)) in names}


def source_faults(
    sources: Sources, roots: Sequence[Path], same_package: bool
) -> Iterator[Fault]:
    """The files that are not below the roots as they were.

    same_package : whether those that ship with the package should be the same as well.
    """
    for name, file in sources.items():
        if name.startswith(PACKAGE) and not same_package:
            continue
        place = _place_of(name, roots)
        if place is None:
            yield Fault("source", file.use, name, "missing")
        elif what := what_is_wrong(place.resolve(), file.bytes, file.sha256):
            yield Fault("source", file.use, name, what)


def _packaged() -> dict[str, Path]:
    """Beginning of the names of files that ship with the package → their folder."""
    folders = {"scenes": scenes_folder(), "cameras": SHIPPED}
    return {f"{PACKAGE}{name}": Path(str(folder)) for name, folder in folders.items()}


def _name_of(path: Path, roots: Sequence[Path]) -> str:
    """The name of a file below the first folder that has it, as it was asked for: links are not followed."""
    whole = Path(os.path.abspath(path))
    for label, folder in (*_packaged().items(), *(("", root) for root in roots)):
        if whole.is_relative_to(top := os.path.abspath(folder)):
            return f"{label}/{whole.relative_to(top).as_posix()}".removeprefix("/")
    ((name, _),) = check_below([path], roots)
    return name


def _place_of(name: str, roots: Sequence[Path]) -> Path | None:
    """The file of this name on this machine; None where it is not there."""
    folders = [*roots]
    for label, folder in _packaged().items():
        if name.startswith(f"{label}/"):
            name, folders = name.removeprefix(f"{label}/"), [folder]
    try:
        return find_below(name, folders, "a file")
    except InputError:
        return None


def _printable(text: str) -> str:
    """The same, with an escape in the place of each character that would not be seen."""
    return "".join(x if x.isprintable() else ascii(x)[1:-1] for x in text)


def _is_line(text: object) -> bool:
    return isinstance(text, str) and text.isprintable()

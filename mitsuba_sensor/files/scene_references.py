"""All files that a Mitsuba scene file reads, found without Mitsuba; whether they lie below folders; their digest.

These are files that it includes, meshes, textures, volumes and spectra, the camera file of its film, and the lens and
the curves that this one names. Whatever Mitsuba could read under a name is found, in any of the folders where it looks,
so that what is checked and digested here is at least what is read later.
"""

from __future__ import annotations

import hashlib
import os
import re
import tomllib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from functools import lru_cache
from pathlib import Path
from typing import Any

from ..core import InputError
from ..core.small_files import require_small, toml_tables
from .scene_xml import LONGEST_NAME, Element, Expansion, elements_of

MOST_FILES = 10_000
CACHED = 4096  # files whose elements or digests are kept
CODE = (".so", ".dylib", ".dll", ".pyd")
CURVES, MAY_BE_FILES = (
    "quantum_efficiency.file",
    ("camera", "lens.prescription"),
)  # of a film; else a shipped name
Stamp = tuple[int, int, int, int]
Parameters = Mapping[str, object]


def files_digest(
    paths: Sequence[Path], roots: Sequence[Path], beside: Path | None = None
) -> str:
    """SHA-256 over names, below the roots, and contents. Raises InputError for a file outside of them.

    beside : where it is given, files may be anywhere; outside of the roots their names are those from this folder.
    """
    named = sorted(
        (name, content_digest(path)) for name, path in check_below(paths, roots, beside)
    )
    return hashlib.sha256(
        "\n".join(f"{digest} {name}" for name, digest in named).encode()
    ).hexdigest()


def content_digest(path: Path) -> str:
    """SHA-256 of a file, which is read again where it was changed."""
    return _content_digest(path, _stamp(path))


def folder_names(folders: Iterable[Path]) -> str:
    """The folders as a sentence names them: by their whole paths, each once."""
    return ", ".join(dict.fromkeys(str(folder.absolute()) for folder in folders))


def check_below(
    paths: Sequence[Path], roots: Sequence[Path], beside: Path | None = None
) -> list[tuple[str, Path]]:
    """Names of the files below the first root that has each of them, and the files.

    beside : as of :func:`files_digest`.

    Raises InputError for a file that is in none of them: by an absolute name, by ``..`` or through a link.
    """
    places, found = [root.resolve() for root in roots], []
    for path in paths:
        real = path.resolve()
        root = next((one for one in places if real.is_relative_to(one)), None)
        if root is None and beside is not None:
            found.append((os.path.relpath(real, beside.resolve()).replace(os.sep, "/"), path))
            continue
        if root is None:
            through = f", which is {real}," if real != Path(os.path.abspath(path)) else ""
            folders = folder_names(roots)
            raise InputError(
                f"{path}{through} is outside of the folders that may be read ({folders}); move it into one of them, or "
                f"name its folder with --root."
            )
        found.append((real.relative_to(root).as_posix(), path))
    return found


def scene_references(
    path: str | os.PathLike[str], parameters: Parameters, roots: Sequence[Path] | None = None
) -> list[Path]:
    """The scene file and all files that it reads, each once, in no particular order.

    roots : where they are given, no file outside of them is opened, and InputError is raised as by
        :func:`check_below`.
    Raises InputError for a scene that cannot be read or has a value that is not known, for a file that is not where
    the scene looks for it, and where native code lies beside it, which Mitsuba would load and run.
    """
    return references_of(Path(path), parameters, roots)[0]


def references_of(
    path: Path, parameters: Parameters, roots: Sequence[Path] | None = None
) -> tuple[list[Path], set[str]]:
    """The same, and the names of all parameters that other values of may lead to other files."""
    values = {str(name): str(value) for name, value in parameters.items()}
    search = _Search(path, values, roots)
    return list(search.found), search.expansion.used


def camera_references(path: str | os.PathLike[str]) -> list[Path]:
    """A camera file and the files that it names: lens, curves."""
    return [Path(path), *_named_by_camera(Path(path))]


class _Search:
    """The elements of a scene and its includes, one after the other, with the parameters known so far.

    found : the files.  folders : where Mitsuba looks for them.
    """

    def __init__(
        self, scene: Path, values: dict[str, str], roots: Sequence[Path] | None
    ) -> None:
        self.expansion, self.folders = Expansion(values), [scene.parent]
        self.found, self.roots = dict[Path, None](), roots
        self._refuse_code(scene.parent)
        self._read(scene, 0)

    def _read(self, file: Path, depth: int) -> None:
        """One file.  depth : of includes."""
        self.expansion.include(file, depth)
        self._add(file)
        try:
            elements = _elements(file, _stamp(file))
        except OSError as error:
            raise InputError(
                f"the scene file {file} cannot be read: {error.strerror}."
            ) from None
        for one in elements:
            where = f"{file}, line {one.line}"
            if one.kind == "default":
                self.expansion.values.setdefault(one.name, self._value(one, where))
            else:
                self._follow(one, self._value(one, where), file, depth)

    def _follow(self, one: Element, value: str, file: Path, depth: int) -> None:
        where = f"{file}, line {one.line}"
        if one.kind == "type":
            if not re.fullmatch(r"[\w-]{0,64}", value):
                raise InputError(
                    f"{where}: type is {value[:80]!r}, which is no name of a plugin."
                )
        elif one.kind == "path":
            self._look_in(value, where)
        elif one.kind == "include":
            for inner in self._named(value, where, file.parent):
                self._read(inner, depth + 1)
        elif one.kind == "file":
            for inner in self._named(value, where):
                self._add(inner)
        else:
            needed = one.name == CURVES or (
                one.name in MAY_BE_FILES and re.search(r"[./\\]", value)
            )
            names = self._of_material(value, where) if one.name == "material" else [value]
            for inner in (
                self._named(value, where) if needed else _existing(names, self.folders)
            ):
                self._add(inner)

    def _of_material(self, value: str, where: str) -> list[str]:
        """Files that Mitsuba reads for the name of a metal."""
        if not re.fullmatch(r"[\w-]*", value):
            raise InputError(
                f"{where}: material is {value[:80]!r}, which is no name of a metal, e.g. Au."
            )
        return [f"data/ior/{value}.{kind}.spd" for kind in ("eta", "k")]

    def _value(self, one: Element, where: str) -> str:
        """With the parameters in place. Raises InputError for one without a value."""
        value = self.expansion.put_in(one.value, where)
        if "$" in value:
            raise InputError(
                f"{where}: {one.value[:200]!r} has a parameter without a value; give it one (-D name=value)."
            )
        return value

    def _look_in(self, value: str, where: str) -> None:
        """One more folder in which files are sought."""
        folders = (
            [folder / value for folder in self.folders if (folder / value).is_dir()]
            if _usable(value)
            else []
        )
        if not folders:
            raise InputError(
                f"{where}: there is no folder {value[:200]!r} beside the scene; correct the <path>."
            )
        for folder in folders:
            self._refuse_code(folder)
        self.folders += [folder for folder in folders if folder not in self.folders]

    def _named(self, value: str, where: str, *more: Path) -> list[Path]:
        """All files of this name where Mitsuba looks. Raises InputError where there is none."""
        found = _existing([value], [*self.folders, *more])
        if not found:
            folders = ", ".join(map(str, self.folders))
            said = f"there is no file {value[:200]!r} in {folders}"
            raise InputError(f"{where}: {said}; correct its name, or add a <path>.")
        return found

    def _add(self, file: Path) -> None:
        if file in self.found:
            return
        if self.roots is not None:
            check_below([file], self.roots)
        self.found[file] = None
        if len(self.found) > MOST_FILES:
            raise InputError(
                f"the scene reads more than {MOST_FILES} files; merge meshes or textures."
            )
        if file.suffix == ".toml":
            for inner in _named_by_camera(file):
                self._add(inner)

    def _refuse_code(self, folder: Path) -> None:
        """Mitsuba looks for plugins where it looks for files."""
        plugins = folder / "plugins"
        code = (
            sorted(one.name for one in plugins.iterdir() if one.suffix in CODE)
            if plugins.is_dir()
            else []
        )
        if code:
            raise InputError(
                f"{plugins / code[0]} is native code, which Mitsuba would run; move it away."
            )


def _usable(value: str) -> bool:
    """Whether it can be the name of a file."""
    return (
        bool(value)
        and "\0" not in value
        and "\n" not in value
        and len(value) <= 16 * LONGEST_NAME
    )


def _existing(names: Sequence[str], folders: Sequence[Path]) -> list[Path]:
    """The files of these names in the folders."""
    places = dict.fromkeys(
        folder / name for name in names if _usable(name) for folder in folders
    )
    try:
        return [place for place in places if place.is_file()]
    except OSError:  # a name that is too long, and therefore none
        return []


def _named_by_camera(file: Path) -> list[Path]:
    """Files that a camera file names; none of what is no TOML, which loading it will say."""
    try:
        require_small(file, "the camera file")
        tables = toml_tables(file.read_text("utf-8"))
    except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError):
        return []
    return [found for found in _existing(list(_texts(tables)), [file.parent]) if found != file]


def _texts(value: Any) -> Iterator[str]:
    """All texts in tables and lists that can be the name of a file."""
    if isinstance(value, str) and len(value) <= LONGEST_NAME:
        yield value
    inner = (
        value.values() if isinstance(value, dict) else value if isinstance(value, list) else ()
    )
    for one in inner:
        yield from _texts(one)


def _stamp(path: Path) -> Stamp:
    """What changes when a file does."""
    found = path.stat()
    return found.st_size, found.st_mtime_ns, found.st_ino, found.st_dev


@lru_cache(CACHED)
def _elements(file: Path, _: Stamp) -> tuple[Element, ...]:
    return elements_of(file)


@lru_cache(CACHED)
def _content_digest(path: Path, _: Stamp) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()

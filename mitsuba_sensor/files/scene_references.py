"""All files that a Mitsuba scene file reads, found without Mitsuba; their digest, and a check of their folders.

These are included files, meshes, textures, volumes and spectra, the camera file of the film, and the lens and curves
that the camera file names. A name matches in every folder in which Mitsuba looks, so the files that are checked and
digested here contain all files that Mitsuba reads later.
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

FILES_MAX = 10_000
CACHE_FILES = 4096
"""Files whose elements or digests are cached."""
CODE = (".so", ".dylib", ".dll", ".pyd")
CURVES = "quantum_efficiency.file"
"""Text of a film that names a file."""
NAMES_OR_FILES = ("camera", "lens.prescription")
"""Texts of a film that name a file or something included with the package."""
Stamp = tuple[int, int, int, int]
Parameters = Mapping[str, object]


def files_digest(
    paths: Sequence[Path], roots: Sequence[Path], beside: Path | None = None
) -> str:
    """Return the SHA-256 of names, relative to the roots, and contents. Raises InputError for a file outside the roots.

    beside : folder from which files outside the roots are named; with it, files may be anywhere.
    """
    named = sorted(
        (name, content_digest(path)) for name, path in check_below(paths, roots, beside)
    )
    return hashlib.sha256(
        "\n".join(f"{digest} {name}" for name, digest in named).encode()
    ).hexdigest()


def content_digest(path: Path) -> str:
    """Return the SHA-256 of a file, which is read again only if it has changed."""
    return _content_digest(path, _stamp(path))


def folder_names(folders: Iterable[Path]) -> str:
    """Return the folders for a message: absolute paths, each once."""
    return ", ".join(dict.fromkeys(str(folder.absolute()) for folder in folders))


def check_below(
    paths: Sequence[Path], roots: Sequence[Path], beside: Path | None = None
) -> list[tuple[str, Path]]:
    """Return pairs of the name of a file below the first root that contains it, and the file.

    beside : as in :func:`files_digest`.
    Raises InputError for a file outside all roots: by an absolute name, by ``..`` or through a link.
    """
    places, named = [root.resolve() for root in roots], list[tuple[str, Path]]()
    for path in paths:
        real = path.resolve()
        root = next((one for one in places if real.is_relative_to(one)), None)
        if root is not None:
            named.append((real.relative_to(root).as_posix(), path))
        elif beside is not None:
            named.append((os.path.relpath(real, beside.resolve()).replace(os.sep, "/"), path))
        else:
            link = f" (a link to {real})" if real != Path(os.path.abspath(path)) else ""
            raise InputError(
                f"{path}{link} is outside of the folders that may be read ({folder_names(roots)}); move it into one of "
                "them, or name its folder with roots=."
            )
    return named


def scene_references(
    path: str | os.PathLike[str], parameters: Parameters, roots: Sequence[Path] | None = None
) -> list[Path]:
    """Return the scene file and all files that it reads, each once, in no particular order.

    roots : if given, no file outside of them is opened, and InputError is raised as by :func:`check_below`.
    Raises InputError for an unreadable scene, for a parameter without a value, for a missing file, and for native code
    beside the scene, which Mitsuba would load and run.
    """
    return references_of(Path(path), parameters, roots)[0]


def references_of(
    path: Path, parameters: Parameters, roots: Sequence[Path] | None = None
) -> tuple[list[Path], set[str]]:
    """Return the same files, and the names of all parameters whose values affect which files are read."""
    values = {str(name): str(value) for name, value in parameters.items()}
    search = _Search(path, values, roots)
    return list(search.files), search.expansion.used


def camera_references(path: str | os.PathLike[str]) -> list[Path]:
    """Return a camera file and the files that it names: lens, curves."""
    return [Path(path), *_named_by_camera(Path(path))]


class _Search:
    """A pass through the elements of a scene and its includes, with the parameters so far.

    files : files that the scene reads.  folders : folders in which Mitsuba looks for files.
    """

    def __init__(
        self, scene: Path, values: dict[str, str], roots: Sequence[Path] | None
    ) -> None:
        self.expansion, self.folders = Expansion(values), [scene.parent]
        self.files, self.roots = dict[Path, None](), roots
        self._refuse_code(scene.parent)
        self._read(scene, 0)

    def _read(self, file: Path, depth: int) -> None:
        """Follow one scene file.  depth : depth of includes."""
        self.expansion.include(file, depth)
        self._add(file)
        try:
            elements = _elements(file, _stamp(file))
        except OSError as error:
            raise InputError(
                f"the scene file {file} cannot be read: {error.strerror}."
            ) from None
        for element in elements:
            where = f"{file}, line {element.line}"
            value = self._value(element, where)
            if element.kind == "default":
                self.expansion.values.setdefault(element.name, value)
            else:
                self._follow(element, value, where, file, depth)

    def _follow(self, element: Element, value: str, where: str, file: Path, depth: int) -> None:
        """Follow an element other than a default."""
        kind, name = element.kind, element.name
        if kind == "type":
            if not re.fullmatch(r"[\w-]{0,64}", value):
                raise InputError(
                    f"{where}: type is {value[:80]!r}; it must be the name of a plugin."
                )
            return
        if kind == "path":
            self._look_in(value, where)
            return
        if kind == "include":
            for inner in self._named(value, where, file.parent):
                self._read(inner, depth + 1)
            return
        if kind == "text" and name == "material":
            if not re.fullmatch(r"[\w-]*", value):
                raise InputError(
                    f"{where}: material is {value[:80]!r}; it must be the name of a metal, e.g. Au."
                )
            spectra = [f"data/ior/{value}.{part}.spd" for part in ("eta", "k")]
            files = _existing(spectra, self.folders)
        elif kind == "file" or (
            name == CURVES or (name in NAMES_OR_FILES and re.search(r"[./\\]", value))
        ):
            files = self._named(value, where)
        else:
            files = _existing([value], self.folders)
        for inner in files:
            self._add(inner)

    def _value(self, element: Element, where: str) -> str:
        """Return the value of an element with its parameters replaced. Raises InputError for an unknown parameter."""
        value = self.expansion.put_in(element.value, where)
        if "$" in value:
            raise InputError(
                f"{where}: {element.value[:200]!r} has a parameter without a value; give -D name=value."
            )
        return value

    def _look_in(self, value: str, where: str) -> None:
        """Add a folder in which Mitsuba looks for files."""
        places = [folder / value for folder in self.folders] if _usable(value) else []
        folders = [place for place in places if place.is_dir()]
        if not folders:
            raise InputError(
                f"{where}: there is no folder {value[:200]!r} beside the scene; correct the <path>."
            )
        for folder in folders:
            self._refuse_code(folder)
        self.folders += [folder for folder in folders if folder not in self.folders]

    def _named(self, value: str, where: str, *more: Path) -> list[Path]:
        """Return all files of this name in the folders. Raises InputError if there is none."""
        files = _existing([value], [*self.folders, *more])
        if not files:
            folders = ", ".join(map(str, self.folders))
            raise InputError(
                f"{where}: there is no file {value[:200]!r} in {folders}; correct its name, or add a <path>."
            )
        return files

    def _add(self, file: Path) -> None:
        if file in self.files:
            return
        if self.roots is not None:
            check_below([file], self.roots)
        self.files[file] = None
        if len(self.files) > FILES_MAX:
            raise InputError(
                f"the scene reads more than {FILES_MAX} files; merge meshes or textures."
            )
        if file.suffix == ".toml":
            for inner in _named_by_camera(file):
                self._add(inner)

    def _refuse_code(self, folder: Path) -> None:
        """Raise InputError for native code where Mitsuba looks for plugins."""
        code = sorted(one for one in folder.glob("plugins/*") if one.suffix in CODE)
        if code:
            raise InputError(
                f"{code[0]} is native code, which Mitsuba would run; move it away."
            )


def _usable(value: str) -> bool:
    """Return True if a value can be the name of a file."""
    return 0 < len(value) <= 16 * LONGEST_NAME and not {"\0", "\n"} & {*value}


def _existing(names: Sequence[str], folders: Sequence[Path]) -> list[Path]:
    """Return the files of these names in the folders."""
    places = dict.fromkeys(
        folder / name for name in names if _usable(name) for folder in folders
    )
    try:
        return [place for place in places if place.is_file()]
    except OSError:  # a name that is too long
        return []


def _named_by_camera(file: Path) -> list[Path]:
    """Return the files that a camera file names; [] for invalid TOML, which loading reports."""
    try:
        require_small(file, "the camera file")
        tables = toml_tables(file.read_text("utf-8"))
    except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError):
        return []
    return [inner for inner in _existing(list(_texts(tables)), [file.parent]) if inner != file]


def _texts(value: Any) -> Iterator[str]:
    """Yield all texts in tables and lists that can be the name of a file."""
    if isinstance(value, str) and len(value) <= LONGEST_NAME:
        yield value
    elif isinstance(value, dict | list):
        for inner in value.values() if isinstance(value, dict) else value:
            yield from _texts(inner)


def _stamp(path: Path) -> Stamp:
    """Return numbers that change with a file."""
    status = path.stat()
    return status.st_size, status.st_mtime_ns, status.st_ino, status.st_dev


@lru_cache(CACHE_FILES)
def _elements(file: Path, _: Stamp) -> tuple[Element, ...]:
    return elements_of(file)


@lru_cache(CACHE_FILES)
def _content_digest(path: Path, _: Stamp) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()

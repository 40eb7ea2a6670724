"""Which files belong together and how they were taken: of a manifest, or of the names of files and folders."""

from __future__ import annotations

import sys
import tomllib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal, TypeAlias, get_args

from ...core import InputError, nearest
from ...core.errors import shown
from ...files.raw_files import RAW_FORMATS
from ...files.texts import read_toml

Kind: TypeAlias = Literal["bias", "dark", "flat", "scene"]
KINDS: tuple[Kind, ...] = get_args(Kind)
OF_LIGHT = "flat", "scene"
"""Kinds of which frames of equal settings may have other light."""
MANIFEST = "bench.toml"
OWN_RAW, OWN_METADATA = "frame.tiff", ("frame.json", "sample.json")
Check: TypeAlias = tuple[Callable[[Any], bool], str]


def is_number(value: object) -> bool:
    """Whether a value is a finite number of at least 0; True and False are none."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        return False
    return 0 <= value <= sys.float_info.max


def _is_texts(value: object) -> bool:
    """Whether a value is a list of texts, none of them empty."""
    if not isinstance(value, list) or not value:
        return False
    return all(isinstance(text, str) and text for text in value)


A_NUMBER: Check = (is_number, "a number of at least 0")
OF_BENCH: dict[str, Check] = {
    "bits": (
        lambda value: type(value) is int and 1 <= value <= 32,
        "a whole number from 1 to 32",
    ),
    "wavelength_nm": (lambda value: is_number(value) and value > 0, "a number above 0"),
    "tile": (
        lambda value: isinstance(value, list) and all(map(_is_texts, value)),
        'rows of names, e.g. [["R", "G"], …]',
    ),
    "stack": (lambda value: True, "tables [[stack]]"),
}
OF_STACK: dict[str, Check] = {
    "files": (
        lambda value: bool(value) and (isinstance(value, str) or _is_texts(value)),
        'a pattern, e.g. "dark/*.tiff"',
    ),
    "kind": (lambda value: value in KINDS, f"one of {', '.join(KINDS)}"),
    "exposure_s": A_NUMBER,
    "photons": A_NUMBER,
    "temperature_k": A_NUMBER,
    "gain": (
        lambda value: isinstance(value, str) or is_number(value),
        "a text or a number of at least 0",
    ),
}
WAY_OUT = f"write a {MANIFEST}; docs/lab.md shows one"


@dataclass(frozen=True)
class Group:
    """Files with what the manifest says of them.  where : for messages."""

    where: str
    files: list[Path]
    kind: Kind | None
    settings: Mapping[str, Any]

    def of_readout(self) -> Group:
        """The group of one read-out, whose exposure is its own and stands beside its frames."""
        settings = {name: x for name, x in self.settings.items() if name != "exposure_s"}
        return replace(self, settings=settings)


def read_manifest(path: Path) -> dict[str, Any]:
    """Tables of a manifest, every key and value of which is checked. Raises InputError."""
    try:
        facts = read_toml(path)
    except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError) as error:
        raise InputError(f"{path} is no manifest in TOML: {error}.") from None
    stacks = facts.get("stack")
    are_tables = isinstance(stacks, list) and all(isinstance(table, dict) for table in stacks)
    if not stacks or not are_tables:
        raise InputError(
            f"{path} has no [[stack]]; name the files of at least one, as docs/lab.md shows."
        )
    _check_table(path, facts, OF_BENCH)
    for table in stacks:
        _check_table(path, table, OF_STACK)
    return facts


def _check_table(path: Path, table: Mapping[str, object], checks: Mapping[str, Check]) -> None:
    """Raises InputError for a key that a table of the manifest cannot have, and for a value that it cannot have."""
    for key, value in table.items():
        if key not in checks:
            keys = ", ".join(checks)
            raise InputError(
                f"{path}: {key} is no key of a manifest ({keys}).{nearest(key, checks)}"
            )
        is_right, what_is_right = checks[key]
        if not is_right(value):
            raise InputError(f"{path}: {key} is {shown(value)}; it must be {what_is_right}.")


def groups(facts: Mapping[str, Any], manifest: Path) -> list[Group]:
    """The files of every stack of a manifest. Raises InputError."""
    file_groups: list[Group] = []
    for number, settings in enumerate(facts["stack"], start=1):
        where = f"{manifest}, stack {number}"
        for key in ("files", "kind"):
            if key not in settings:
                raise InputError(f"{where}: {key} is missing; it must be {OF_STACK[key][1]}.")
        patterns = settings["files"]
        if isinstance(patterns, str):
            patterns = [patterns]
        files: list[Path] = []
        try:
            for pattern in patterns:
                files += sorted(manifest.parent.glob(pattern))
        except (OSError, ValueError, NotImplementedError):
            files = []  # a pattern is too long, of another folder, or none
        if not files:
            raise InputError(
                f"{where}: no file in {manifest.parent} matches {shown(settings['files'])}."
            )
        file_groups.append(Group(where, files, settings["kind"], settings))
    return file_groups


def groups_of_names(folder: Path) -> list[Group]:
    """The files of each kind that a file's name or that of its folder says, None where neither says one.

    Bias and dark frames of all folders are one group; each folder of flat fields or of a scene is one of its own,
    because the light of another may be another. Beside a frame.json or sample.json of this package frame.tiff is the
    only raw file.
    """
    files = sorted(filter(_is_raw_frame, folder.rglob("*")))
    if not files:
        raise InputError(
            f"{folder} holds no raw frames ({', '.join(RAW_FORMATS)}); give a folder that does."
        )
    groups: dict[tuple[Kind | None, Path], list[Path]] = {}
    for file in files:
        kind, place = _kind_by_name(Path(folder.resolve().name) / file.relative_to(folder))
        if kind not in OF_LIGHT:
            place = Path()
        groups.setdefault((kind, place), []).append(file)
    return [
        Group(str(folder.parent / place), alike, kind, {})
        for (kind, place), alike in groups.items()
    ]


def _is_raw_frame(path: Path) -> bool:
    """Whether a path is a raw file, and not a preview or another file beside a raw frame of this package."""
    if path.suffix.lower() not in RAW_FORMATS or not path.is_file():
        return False
    return path.name == OWN_RAW or not any(path.with_name(x).exists() for x in OWN_METADATA)


def _kind_by_name(path: Path) -> tuple[Kind | None, Path]:
    """The kind with which the name of a file begins, or that of the nearest folder around it; and this folder."""
    for named in (path, *path.parents):
        for kind in KINDS:
            if named.name.lower().startswith(kind):
                if named == path:
                    return kind, path.parent
                return kind, named
    return None, Path()

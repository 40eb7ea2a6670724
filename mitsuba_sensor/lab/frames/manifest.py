"""Which files belong together and how they were taken: of a manifest, or of the names of files and folders."""

from __future__ import annotations

import sys
import tomllib
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, TypeAlias, get_args

from ...core import InputError, nearest
from ...core.errors import shown
from ...files.raw_files import RAW_FORMATS
from ...files.texts import read_toml

Kind: TypeAlias = Literal["bias", "dark", "flat", "scene"]
KINDS: tuple[Kind, ...] = get_args(Kind)
MANIFEST = "bench.toml"
OWN_RAW, OWN_METADATA = "frame.tiff", "frame.json"
Check: TypeAlias = tuple[Callable[[Any], bool], str]


def _number(value: object) -> bool:
    return (
        isinstance(value, int | float)
        and not isinstance(value, bool)
        and 0 <= value <= sys.float_info.max
    )


def _texts(value: object) -> bool:
    return (
        isinstance(value, list)
        and bool(value)
        and all(isinstance(one, str) and one for one in value)
    )


A_NUMBER: Check = (_number, "a number of at least 0")
OF_BENCH: dict[str, Check] = {
    "bits": (
        lambda value: type(value) is int and 1 <= value <= 32,
        "a whole number from 1 to 32",
    ),
    "wavelength_nm": (lambda value: _number(value) and value > 0, "a number above 0"),
    "tile": (
        lambda value: isinstance(value, list) and all(map(_texts, value)),
        'rows of names, e.g. [["R", "G"], …]',
    ),
    "stack": (lambda value: True, "tables [[stack]]"),
}
OF_STACK: dict[str, Check] = {
    "files": (
        lambda value: bool(value) and (isinstance(value, str) or _texts(value)),
        'a pattern, e.g. "dark/*.tiff"',
    ),
    "kind": (lambda value: value in KINDS, f"one of {', '.join(KINDS)}"),
    "exposure_s": A_NUMBER,
    "photons": A_NUMBER,
    "temperature_k": A_NUMBER,
    "gain": (
        lambda value: isinstance(value, str) or _number(value),
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


def read_manifest(path: Path) -> dict[str, Any]:
    """Its tables, every key and value checked. Raises InputError."""
    try:
        facts = read_toml(path)
    except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError) as error:
        raise InputError(f"{path} is no manifest in TOML: {error}.") from None
    stacks = facts.get("stack")
    if (
        not isinstance(stacks, list)
        or not stacks
        or not all(isinstance(one, dict) for one in stacks)
    ):
        raise InputError(
            f"{path} has no [[stack]]; name the files of at least one, as docs/lab.md shows."
        )
    for table, known in ((facts, OF_BENCH), *((one, OF_STACK) for one in stacks)):
        for key, value in table.items():
            if key not in known:
                raise InputError(
                    f"{path}: {key} is no key of a manifest ({', '.join(known)}).{nearest(key, known)}"
                )
            if not known[key][0](value):
                raise InputError(
                    f"{path}: {key} is {shown(value)}; it must be {known[key][1]}."
                )
    return facts


def groups(facts: Mapping[str, Any], manifest: Path) -> list[Group]:
    """The files of every stack of a manifest. Raises InputError."""
    found: list[Group] = []
    for number, settings in enumerate(facts["stack"], start=1):
        where = f"{manifest}, stack {number}"
        for key in ("files", "kind"):
            if key not in settings:
                raise InputError(f"{where}: {key} is missing; it must be {OF_STACK[key][1]}.")
        patterns = (
            settings["files"] if isinstance(settings["files"], list) else [settings["files"]]
        )
        try:
            files = [
                file for pattern in patterns for file in sorted(manifest.parent.glob(pattern))
            ]
        except (
            OSError,
            ValueError,
            NotImplementedError,
        ):  # too long, no pattern, or of another folder
            files = []
        if not files:
            raise InputError(
                f"{where}: no file in {manifest.parent} matches {shown(settings['files'])}."
            )
        found.append(Group(where, files, settings["kind"], settings))
    return found


def groups_of_names(folder: Path) -> list[Group]:
    """The files of each kind that a file's name or that of its folder says, None where neither says one.

    Beside a frame.json of this package frame.tiff is the only raw file.
    """
    files = sorted(
        one for one in folder.rglob("*") if one.suffix.lower() in RAW_FORMATS and one.is_file()
    )
    files = [
        one for one in files if one.name == OWN_RAW or not one.with_name(OWN_METADATA).exists()
    ]
    if not files:
        raise InputError(
            f"{folder} holds no raw frames ({', '.join(RAW_FORMATS)}); give a folder that does."
        )
    found: dict[Kind | None, list[Path]] = {}
    for file in files:
        names = [name.lower() for name in reversed(file.relative_to(folder).parts)]
        kind = next((kind for name in names for kind in KINDS if name.startswith(kind)), None)
        found.setdefault(kind, []).append(file)
    return [Group(str(folder), some, kind, {}) for kind, some in found.items()]

"""Which files belong together and how they were taken: of a manifest, of a descriptor of EMVA 1288, or of the names of
files and folders; and the frames of one read-out of a camera with several.

The descriptor is a text file of lines that begin with a letter: ``n bits width height``; ``b exposure photons`` and ``d
exposure`` begin the images of a flat field and of darkness, exposure in nanoseconds; ``i file`` names one image of it,
relative to the descriptor, with slashes of either kind. What follows a ``#`` is a comment.
"""

from __future__ import annotations

import math
import sys
import tomllib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal, TypeAlias, get_args

from ...core import InputError, nearest
from ...core.errors import shown
from ...files.raw_files import RAW_FORMATS, RawFile, read_raw
from ...files.texts import Facts, read_json, read_toml, text_of_file
from ...files.tiff import BOTH_HALVES, COMBINED, READOUTS, read_readouts

Kind: TypeAlias = Literal["bias", "dark", "flat", "scene"]
KINDS: tuple[Kind, ...] = get_args(Kind)
OF_LIGHT = "flat", "scene"
"""Kinds of which frames of equal settings may have other light."""
MANIFEST = "bench.toml"
OWN_RAW, OWN_METADATA = "frame.tiff", ("frame.json", "sample.json")
AGAIN = "write the frames again"
REMEDY = "give a folder of raw frames, a bench.toml or a descriptor of EMVA 1288"
SECONDS_PER_NS = 1e-9
ARGUMENTS = {"v": 1, "n": 3, "b": 2, "d": 1, "i": 1}
"""Numbers of arguments behind each letter of a descriptor."""
Check: TypeAlias = tuple[Callable[[Any], bool], str]


def is_number(value: object) -> bool:
    """Whether a value is a finite number of at least 0; True and False are none."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        return False
    return 0 <= value <= sys.float_info.max


def _is_texts(value: object) -> bool:
    """Whether a value is a list of texts, none of them empty."""
    is_list = isinstance(value, list) and bool(value)
    return is_list and all(isinstance(text, str) and text for text in value)  # type: ignore[attr-defined]


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
    for table, checks in ((facts, OF_BENCH), *((stack, OF_STACK) for stack in stacks)):
        for key, value in table.items():
            if key not in checks:
                raise InputError(
                    f"{path}: {key} is no key of a manifest ({', '.join(checks)}).{nearest(key, checks)}"
                )
            is_right, what_is_right = checks[key]
            if not is_right(value):
                raise InputError(
                    f"{path}: {key} is {shown(value)}; it must be {what_is_right}."
                )
    return facts


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


def read_descriptor(path: Path) -> tuple[Facts, list[Group]]:
    """What a descriptor says of all images, and the images of each stack. Raises InputError with file and line."""
    facts: Facts = {}
    stacks: list[Group] = []
    for number, line in enumerate(text_of_file(path, REMEDY).splitlines(), start=1):
        letter, *rest = line.split("#")[0].split(maxsplit=1) or [""]
        if not letter:
            continue
        where = f"{path}, line {number}"
        if letter not in ARGUMENTS:
            letters = ", ".join(ARGUMENTS)
            raise InputError(
                f"{where} begins with {shown(letter)}; a line begins with {letters}."
            )
        text = "".join(rest).strip()
        values = (
            [text] if letter == "i" else text.split()
        )  # the name of an image may have spaces
        if len(values) != ARGUMENTS[letter] or not all(values):
            raise InputError(
                f"{where}: {letter} has {len(values)} arguments; it must have {ARGUMENTS[letter]}."
            )
        if letter == "n":
            facts["bits"] = int(_number(where, values[0]))
        elif letter in ("b", "d"):
            numbers = [_number(where, value) for value in values]
            settings = {"exposure_s": SECONDS_PER_NS * numbers[0]}
            if letter == "b":
                settings["photons"] = numbers[1]
            stacks.append(Group(where, [], "flat" if letter == "b" else "dark", settings))
        elif letter == "i":
            file = path.parent / values[0].replace("\\", "/")
            if not stacks:
                raise InputError(f"{where}: the first image is before a line b or d.")
            if not file.is_file():
                raise InputError(
                    f"{where}: there is no {file}; correct the name, or add the image."
                )
            stacks[-1].files.append(file)
    stacks = [stack for stack in stacks if stack.files]
    if not stacks:
        raise InputError(
            f"{path} is no descriptor of EMVA 1288: no line b or d with images (i file); {REMEDY}."
        )
    return {**facts, "stack": [stack.settings for stack in stacks]}, stacks


def _number(where: str, text: str) -> float:
    """A number of at least 0, with a point or a comma. Raises InputError."""
    try:
        value = float(text.replace(",", "."))
    except ValueError:
        value = -1.0
    if not is_number(value):
        raise InputError(f"{where}: {shown(text)} must be a number of at least 0.")
    return value


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
    found: dict[tuple[Kind | None, Path], list[Path]] = {}
    for file in files:
        kind, place = _kind_by_name(Path(folder.resolve().name) / file.relative_to(folder))
        if kind not in OF_LIGHT:
            place = Path()
        found.setdefault((kind, place), []).append(file)
    return [
        Group(str(folder.parent / place), alike, kind, {})
        for (kind, place), alike in found.items()
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
                return kind, path.parent if named == path else named
    return None, Path()


def names_of_readouts(file: Path) -> tuple[str, ...]:
    """Of the read-outs that a raw file was combined from, the most sensitive first; none of any other file, and of the
    halves of dual pixels. Raises InputError where they are not beside it."""
    pages = file.with_name(READOUTS)
    if pages.is_file():
        names = tuple(read_readouts(pages))
        if BOTH_HALVES in names:
            return ()
        return tuple(name for name in names if name not in COMBINED)
    facts = _facts_of_readouts(file)
    combined = [name for name, one in facts.items() if "electrons_per_dn" in one]
    if combined:
        raise InputError(
            f"{file} is the linear code of the read-outs {', '.join(combined)}, whose noise it shows mixed, and their "
            f'frames are not beside it; write {READOUTS} with it (of a dataset: outputs = ["raw", "readouts"]).'
        )
    return ()


def read_readout(file: Path, name: str) -> RawFile:
    """The frames of a read-out, and what is known of them. Raises InputError for a file that has none of this name."""
    raw, known = read_raw(file), names_of_readouts(file)
    if name not in known:
        raise InputError(
            f"{file} has no frames of a read-out {name!r} beside it ({', '.join(known) or 'none at all'}); write "
            f"{READOUTS} with it, or leave the file out.{nearest(name, known)}"
        )
    frames = read_readouts(file.with_name(READOUTS))[name]
    if frames.shape != raw.frames.shape:
        raise InputError(
            f"{file} has {raw.frames.shape} pixels and {READOUTS} beside it {frames.shape}; {AGAIN}."
        )
    facts = _facts_of_readouts(file).get(name)
    if facts is None:
        raise InputError(
            f"neither {' nor '.join(OWN_METADATA)} beside {file} says how the read-out {name!r} was exposed; {AGAIN}."
        )
    bits = math.ceil(math.log2(facts["white_level_dn"] + 1))
    return replace(raw, frames=frames, exposure_s=float(facts["exposure_s"]), bits=bits)


def _facts_of_readouts(file: Path) -> dict[str, Facts]:
    """What the metadata beside a raw file of this package say of its read-outs, by name; nothing of other files."""
    for path in map(file.with_name, OWN_METADATA):
        if file.name == OWN_RAW and path.is_file():
            listed = read_json(path, AGAIN).get("readouts") or ()
            return {
                one["name"]: one for one in listed if isinstance(one, dict) and "name" in one
            }
    return {}

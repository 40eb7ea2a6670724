"""Groups of files and their settings from a manifest, an EMVA 1288 descriptor, or the names of files and folders; and
the frames of one readout of a camera with several readouts.

The descriptor is a text file of lines that begin with a letter: ``n bits width height``; ``b exposure photons`` and ``d
exposure`` begin the images of a flat field and of a dark stack, exposure in nanoseconds; ``i file`` names one of its
images relative to the descriptor, with slashes of either kind. A ``#`` begins a comment.
"""

from __future__ import annotations

import math
import sys
import tomllib
from collections.abc import Callable, Mapping, Sequence
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
LIT_KINDS = "flat", "scene"
"""Kinds whose frames may have different light at equal settings."""
MANIFEST = "bench.toml"
OWN_RAW, OWN_METADATA = "frame.tiff", ("frame.json", "sample.json")
AGAIN = "write the frames again"
REMEDY = "give a folder of raw frames, a bench.toml or a descriptor of EMVA 1288"
SECONDS_PER_NS = 1e-9
PHOTONS_RANGE_MAX = 0.1
"""Largest relative range of the photons of a flat field, over its pixels and files; mean and median then agree."""
ARGUMENTS = {"v": 1, "n": 3, "b": 2, "d": 1, "i": 1}
"""Number of arguments after each letter of a descriptor."""
Check: TypeAlias = tuple[Callable[[Any], bool], str]


def is_number(value: object) -> bool:
    """Return True if a value is a finite number of at least 0; True and False are not."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        return False
    return 0 <= value <= sys.float_info.max


def _is_texts(value: object) -> bool:
    """Return True if a value is a list of texts that are not empty."""
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
    """Files with the settings that the manifest states for them.  where : for messages."""

    where: str
    files: list[Path]
    kind: Kind | None
    settings: Mapping[str, Any]

    def of_readout(self) -> Group:
        """Return the group for one readout, whose exposure time is in the metadata of its frames."""
        settings = {name: x for name, x in self.settings.items() if name != "exposure_s"}
        return replace(self, settings=settings)


def read_manifest(path: Path) -> dict[str, Any]:
    """Return the tables of a manifest, with every key and value checked. Raises InputError."""
    try:
        facts = read_toml(path)
    except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError) as error:
        raise InputError(f"{path} is not a manifest in TOML: {error}.") from None
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
                    f"{path}: unknown manifest key {key}; the keys are {', '.join(checks)}.{nearest(key, checks)}"
                )
            is_right, what_is_right = checks[key]
            if not is_right(value):
                raise InputError(
                    f"{path}: {key} is {shown(value)}; it must be {what_is_right}."
                )
    return facts


def groups(facts: Mapping[str, Any], manifest: Path) -> list[Group]:
    """Return the files of every stack of a manifest. Raises InputError."""
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
            files = []  # the pattern is too long, absolute or empty
        if not files:
            raise InputError(
                f"{where}: no file in {manifest.parent} matches {shown(settings['files'])}."
            )
        file_groups.append(Group(where, files, settings["kind"], settings))
    return file_groups


def read_descriptor(path: Path) -> tuple[Facts, list[Group]]:
    """Return the facts of a descriptor about all images, and the images of each stack.

    Raises InputError with file and line.
    """
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
                f"{where} begins with {shown(letter)}; a line begins with one of {letters}."
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
                raise InputError(f"{where}: the first image precedes the first line b or d.")
            if not file.is_file():
                raise InputError(
                    f"{where}: there is no {file}; correct the name, or add the image."
                )
            stacks[-1].files.append(file)
    stacks = [stack for stack in stacks if stack.files]
    if not stacks:
        raise InputError(
            f"{path} is not an EMVA 1288 descriptor: it has no line b or d with images (i file); {REMEDY}."
        )
    return {**facts, "stack": [stack.settings for stack in stacks]}, stacks


def _number(where: str, text: str) -> float:
    """Return a number of at least 0, written with a point or a comma. Raises InputError."""
    try:
        value = float(text.replace(",", "."))
    except ValueError:
        value = -1.0
    if not is_number(value):
        raise InputError(f"{where}: {shown(text)} must be a number of at least 0.")
    return value


def groups_of_names(folder: Path) -> list[Group]:
    """Return files grouped by the kind in the name of the file or its folder; None if neither states a kind.

    Bias and dark frames of all folders form one group each. Each folder of flat fields or scenes is a separate group,
    because its light may differ. Next to frame.json or sample.json of this package, only frame.tiff is a raw file.
    """
    files = sorted(filter(_is_raw_frame, folder.rglob("*")))
    if not files:
        raise InputError(
            f"{folder} holds no raw frames ({', '.join(RAW_FORMATS)}); give a folder that does."
        )
    by_kind: dict[tuple[Kind | None, Path], list[Path]] = {}
    for file in files:
        kind, place = _kind_by_name(Path(folder.resolve().name) / file.relative_to(folder))
        if kind not in LIT_KINDS:
            place = Path()
        by_kind.setdefault((kind, place), []).append(file)
    return [
        Group(str(folder.parent / place), alike, kind, {})
        for (kind, place), alike in by_kind.items()
    ]


def _is_raw_frame(path: Path) -> bool:
    """Return True if a path is a raw file, not a preview or another file next to a raw frame of this package."""
    if path.suffix.lower() not in RAW_FORMATS or not path.is_file():
        return False
    return path.name == OWN_RAW or not any(path.with_name(x).exists() for x in OWN_METADATA)


def _kind_by_name(path: Path) -> tuple[Kind | None, Path]:
    """Return the kind in the name of a file or the nearest folder around it, and this folder."""
    for named in (path, *path.parents):
        for kind in KINDS:
            if named.name.lower().startswith(kind):
                return kind, path.parent if named == path else named
    return None, Path()


def names_of_readouts(file: Path) -> tuple[str, ...]:
    """Return the names of the readouts that a raw file was combined from, the most sensitive first.

    Other files and the halves of dual pixels have none. Raises InputError if the readouts are not next to the file.
    """
    pages = file.with_name(READOUTS)
    if pages.is_file():
        names = tuple(read_readouts(pages))
        if BOTH_HALVES in names:
            return ()
        return tuple(name for name in names if name not in COMBINED)
    facts = _facts_of_readouts(file)
    combined = [name for name, readout in facts.items() if "electrons_per_dn" in readout]
    if combined:
        raise InputError(
            f"{file} combines the readouts {', '.join(combined)}, whose noise is mixed, and their frames are missing; "
            f'write {READOUTS} with it (in a dataset: outputs = ["raw", "readouts"]).'
        )
    return ()


def read_readout(file: Path, name: str) -> RawFile:
    """Return the frames of a readout with their metadata. Raises InputError for a file without this readout."""
    raw, names = read_raw(file), names_of_readouts(file)
    if name not in names:
        raise InputError(
            f"{file} has no frames of a readout {name!r} (but of {', '.join(names) or 'none'}); write {READOUTS} with "
            f"it, or leave the file out.{nearest(name, names)}"
        )
    frames = read_readouts(file.with_name(READOUTS))[name]
    if frames.shape != raw.frames.shape:
        raise InputError(
            f"{file} has shape {raw.frames.shape} and {READOUTS} next to it {frames.shape}; {AGAIN}."
        )
    facts = _facts_of_readouts(file).get(name)
    if facts is None:
        raise InputError(
            f"{' and '.join(OWN_METADATA)} next to {file} do not state the exposure of the readout {name!r}; {AGAIN}."
        )
    bits = math.ceil(math.log2(facts["white_level_dn"] + 1))
    return replace(raw, frames=frames, exposure_s=float(facts["exposure_s"]), bits=bits)


def stated_photons(file: Path) -> float | None:
    """Return the photons per pixel in the metadata of this package, NaN if they vary, None if unknown."""
    photons = _metadata(file).get("photons")
    if not isinstance(photons, dict) or photons.get("detected") is not False:
        return None
    counts = [photons.get(name) for name in ("min", "median", "max")]
    if not all(map(is_number, counts)) or not counts[1]:
        return None
    low, median, high = (float(count) for count in counts if count is not None)
    return median if high - low <= PHOTONS_RANGE_MAX * median else math.nan


def mean_photons(counts: Sequence[float | None]) -> float | None:
    """Return the mean photons of the files of a stack, or None if some are unknown or they differ too much."""
    known = [count for count in counts if count is not None and not math.isnan(count)]
    if len(known) < len(counts) or max(known) > (1 + PHOTONS_RANGE_MAX) * min(known):
        return None
    return known[0] if len(set(known)) == 1 else sum(known) / len(known)


def _facts_of_readouts(file: Path) -> dict[str, Facts]:
    """Return the metadata of the readouts of a raw file of this package by name; empty for other files."""
    readouts = _metadata(file).get("readouts") or ()
    return {x["name"]: x for x in readouts if isinstance(x, dict) and "name" in x}


def _metadata(file: Path) -> Facts:
    """Return the metadata next to a raw file of this package; empty for other files."""
    for path in map(file.with_name, OWN_METADATA):
        if file.name == OWN_RAW and path.is_file():
            return read_json(path, AGAIN)
    return {}

"""The frames of one read-out of a camera with several: pages of readouts.tiff beside frames of this package."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

from ...core import InputError, nearest
from ...files.raw_files import RawFile, read_raw
from ...files.texts import Facts, read_json
from ...files.tiff import BOTH_HALVES, COMBINED, READOUTS, read_readouts
from .manifest import OWN_METADATA, OWN_RAW

AGAIN = "write the frames again"


def names_of_readouts(file: Path) -> tuple[str, ...]:
    """Of the read-outs that a raw file was combined from, the most sensitive first; none of any other file, and of the
    halves of dual pixels. Raises InputError where they are not beside it."""
    pages = file.with_name(READOUTS)
    if pages.is_file():
        names = tuple(read_readouts(pages))
        if BOTH_HALVES in names:
            return ()
        return tuple(name for name in names if name not in COMBINED)
    combined = [facts["name"] for facts in _listed(file) if "electrons_per_dn" in facts]
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
    facts = _facts_of(file, name)
    bits = math.ceil(math.log2(facts["white_level_dn"] + 1))
    return replace(raw, frames=frames, exposure_s=float(facts["exposure_s"]), bits=bits)


def _facts_of(file: Path, name: str) -> Facts:
    """What the metadata beside a raw file say of a read-out. Raises InputError where they say nothing."""
    for facts in _listed(file):
        if facts["name"] == name:
            return facts
    raise InputError(
        f"neither {' nor '.join(OWN_METADATA)} beside {file} says how the read-out {name!r} was exposed; {AGAIN}."
    )


def _listed(file: Path) -> list[Facts]:
    """What the metadata beside a raw file of this package say of its read-outs; nothing of other files."""
    for path in map(file.with_name, OWN_METADATA):
        if file.name == OWN_RAW and path.is_file():
            listed = read_json(path, AGAIN).get("readouts")
            return [
                facts for facts in listed or () if isinstance(facts, dict) and "name" in facts
            ]
    return []

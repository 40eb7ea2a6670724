"""The frames of one read-out of a camera with several: pages of readouts.tiff beside frames of this package."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

from ...core import InputError, nearest
from ...files.raw_files import RawFile, read_raw
from ...files.readout_pages import BOTH_HALVES, COMBINED, READOUTS, read_readouts
from ...files.texts import Facts, read_json
from .manifest import OWN_METADATA

AGAIN = "write the frames again"


def names_of_readouts(file: Path) -> tuple[str, ...]:
    """Of the read-outs that a raw file was combined from, the most sensitive first; none of any other file, and of the
    halves of dual pixels."""
    pages = file.with_name(READOUTS)
    if not pages.is_file():
        return ()
    names = tuple(read_readouts(pages))
    if BOTH_HALVES in names:
        return ()
    return tuple(name for name in names if name not in COMBINED)


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
    metadata = next(
        (path for path in map(file.with_name, OWN_METADATA) if path.is_file()), None
    )
    if metadata is None:
        raise InputError(
            f"{file} has neither {' nor '.join(OWN_METADATA)} beside it, which say how its read-outs were exposed; "
            f"{AGAIN}."
        )
    listed = read_json(metadata, AGAIN).get("readouts")
    for facts in listed or ():
        if facts.get("name") == name:
            return facts  # type: ignore[no-any-return]
    raise InputError(f"{metadata} says nothing of the read-out {name!r}; {AGAIN}.")

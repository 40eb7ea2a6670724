"""Bias, dark and flat frames of a camera in a folder: which belong together, and how each of them was taken.

A manifest says so in a few lines, in ``bench.toml`` beside the files::

    bits = 12                     # optional, of the ADC
    wavelength_nm = 550           # optional, of the light: for the quantum efficiency

    [[stack]]
    files = "dark_10ms/*.tiff"    # a pattern or a list of names, relative to the manifest
    kind = "dark"                 # bias, dark, flat or scene
    exposure_s = 0.01             # from the metadata of the files if it is left out; so are temperature_k and gain
    temperature_k = 298.15
    gain = "800"                  # ISO speed, or the name of the setting
    photons = 0                   # mean photons per pixel and exposure, where it is known

Without one, the kind is that with which the name of the file or of its folder begins, or that of a FITS header;
exposure and gain are those of the metadata; files of equal kind, size, exposure, gain and temperature (within 1 K) are
one stack, flat fields and scenes those of one folder.
"""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...core import InputError
from ...core.checks import require_path
from ...files.raw_files import RawFile, read_raw
from ...files.texts import Facts
from .descriptor import read_descriptor
from .manifest import (
    KINDS,
    MANIFEST,
    WAY_OUT,
    Group,
    Kind,
    groups,
    groups_of_names,
    read_manifest,
)
from .readout_frames import names_of_readouts, read_readout
from .stack import Stack

SAME_TEMPERATURE_K = 1.0
"""Temperatures of metadata that differ by no more are taken as one: dark current differs by a tenth or less."""
MOST_DRIFT = 1.5
"""Mean of the brightest frame of a flat field over that of the darkest one, from which on the light is not one."""
SEEN = 64
"""Rows and columns, at most, that tell whether frames have the same light."""
SHORT_S = 1e-5
"""Longest exposure of a bench [s] below which its unit is likely to be another."""


@dataclass(frozen=True, eq=False)
class Bench:
    """The stacks of a camera by what is in front of it.

    ::

        bench = ms.lab.read_bench("bench/")
        print(len(bench.darks), bench.gains)

    biases, darks, flats, scenes : stacks, each in the order of gain, exposure and temperature.
    wavelength_nm : of the light [nm], or None.  notes : how the stacks were put together.
    """

    biases: tuple[Stack, ...]
    darks: tuple[Stack, ...]
    flats: tuple[Stack, ...]
    scenes: tuple[Stack, ...] = ()
    wavelength_nm: float | None = None
    notes: tuple[str, ...] = ()

    @property
    def stacks(self) -> tuple[Stack, ...]:
        """All stacks: bias, dark, flat and scene."""
        return (*self.biases, *self.darks, *self.flats, *self.scenes)

    @property
    def gains(self) -> tuple[str, ...]:
        """Names of the gain settings, numbers in their order."""
        names = {stack.gain for stack in self.stacks}
        return tuple(sorted(names, key=_order_of_gain))

    def at_gain(self, gain: str) -> Bench:
        """The stacks of one gain setting."""
        return self.change(lambda stacks: [stack for stack in stacks if stack.gain == gain])

    def of_filters(self) -> dict[str, Bench]:
        """A bench of the pixels behind each place of the tile, by the name of the filter, as :meth:`Stack.of_filters`.

        Raises InputError where some stacks have a mosaic and others have none, or another one.
        """
        sources = {stack.tile: stack.source for stack in self.stacks}
        if len(sources) > 1:
            tiles = "; ".join(
                f"{source} has {tile or 'none'}" for tile, source in sources.items()
            )
            raise InputError(
                f"the stacks have different mosaics: {tiles}. Give the tile in the manifest."
            )
        if not self.stacks:
            return {}
        names = self.stacks[0].of_filters()
        return {name: self.change(partial(_select_filter, name)) for name in names}

    def given(self, bits: int | None = None, wavelength_nm: float | None = None) -> Bench:
        """This bench with the bits and the wavelength that somebody knows better; None changes nothing."""
        bench = self
        if bits is not None:
            bench = bench.change(lambda stacks: [replace(stack, bits=bits) for stack in stacks])
        if wavelength_nm is not None:
            bench = replace(bench, wavelength_nm=wavelength_nm)
        return bench

    def change(self, change: Callable[[Sequence[Stack]], Sequence[Stack]]) -> Bench:
        """This bench with the stacks of each kind changed by a function."""
        return Bench(
            tuple(change(self.biases)),
            tuple(change(self.darks)),
            tuple(change(self.flats)),
            tuple(change(self.scenes)),
            self.wavelength_nm,
            self.notes,
        )


def _select_filter(name: str, stacks: Sequence[Stack]) -> list[Stack]:
    """The pixels of each stack behind one filter."""
    return [stack.of_filters()[name] for stack in stacks]


def read_bench(
    path: str | os.PathLike[str],
    report: Callable[[int, int], None] | None = None,
    readout: str = "",
) -> Bench:
    """The bench of a folder, of a manifest of another name (.toml), or of a descriptor of EMVA 1288 (any other name).

    ::

        bench = ms.lab.read_bench("bench/")
        twin = ms.lab.fit(bench)

    report : called with the files that are read, and all of them, after each.
    readout : of a camera with several, as this package writes them: the one whose frames are read.
    Raises InputError for what cannot be read or told apart, with the file and the way out.
    """
    facts, file_groups = _facts_and_groups(path)
    read: Callable[[Path], RawFile] = read_raw
    if readout:
        read = partial(read_readout, name=readout)
        facts = {name: value for name, value in facts.items() if name != "bits"}
        file_groups = [group.of_readout() for group in file_groups]
    total = sum(len(group.files) for group in file_groups)
    frame_files: list[_FrameFile] = []
    for group in file_groups:
        for file in group.files:
            frame_files.append(_FrameFile.describe(file, read(file), group))
            if report is not None:
                report(len(frame_files), total)
    frame_files, notes = _with_equal_temperatures(frame_files)
    notes = (*notes, *_note_short(frame_files))
    stacks: dict[Kind, list[Stack]] = {kind: [] for kind in KINDS}
    for kind, stack in _stacks(frame_files, facts):
        stacks[kind].append(stack)
    for of_kind in stacks.values():
        of_kind.sort(key=_order_of_settings)
    return Bench(
        tuple(stacks["bias"]),
        tuple(stacks["dark"]),
        tuple(stacks["flat"]),
        tuple(stacks["scene"]),
        facts.get("wavelength_nm"),
        notes,
    )


def readouts_of_bench(path: str | os.PathLike[str]) -> tuple[str, ...]:
    """Names of the read-outs that all frames of a folder or manifest were combined from, the most sensitive first;
    none of a camera with one. Raises InputError as :func:`read_bench`."""
    _, file_groups = _facts_and_groups(path)
    return names_of_readouts(file_groups[0].files[0])


def _facts_and_groups(path: str | os.PathLike[str]) -> tuple[Facts, list[Group]]:
    """What a manifest or descriptor says of all frames, and the files that belong together. Raises InputError."""
    asked = manifest = require_path("path", path, "bench/")
    if asked.is_dir():
        manifest = asked / MANIFEST
    elif not asked.exists():
        raise InputError(
            f"there is no {asked}; give a folder of raw frames, or a manifest in it."
        )
    if manifest.is_file() and manifest.suffix != ".toml":
        return read_descriptor(manifest)
    if manifest.exists():
        facts = read_manifest(manifest)
        return facts, groups(facts, manifest)
    return {}, groups_of_names(asked)


@dataclass(frozen=True, eq=False)
class _FrameFile:
    """The frames of one file with all that is known about them."""

    file: Path
    group: Group
    raw: RawFile
    kind: Kind
    settings: tuple[float, float | None, str]  # exposure_s, temperature_k, gain

    @classmethod
    def describe(cls, file: Path, raw: RawFile, group: Group) -> _FrameFile:
        """Combine what the group says of a file with what its metadata say. Raises InputError for what neither says."""
        settings = group.settings
        kind = group.kind or _known_kind(raw)
        if kind is None:
            which = f"is it one of {', '.join(KINDS)}? Begin its name or its folder's with that, or {WAY_OUT}"
            raise InputError(f"{file}: {which}.")
        exposure_s = raw.exposure_s
        if kind == "bias":
            exposure_s = 0.0
        exposure_s = settings.get("exposure_s", exposure_s)
        if exposure_s is None:
            raise InputError(
                f"{file} does not say how long it was exposed; {WAY_OUT}, with exposure_s in it."
            )
        temperature_k = settings.get("temperature_k", raw.temperature_k)
        gain = str(settings.get("gain", raw.gain))
        return cls(file, group, raw, kind, (float(exposure_s), temperature_k, gain))


def _with_equal_temperatures(
    files: list[_FrameFile],
) -> tuple[list[_FrameFile], tuple[str, ...]]:
    """The files with one temperature for all that metadata say are within 1 K, their mean, and a note about it.

    A cooled sensor is not kept at a temperature more exactly, and headers say it to a hundredth of a kelvin.
    """
    kelvins: list[float] = []
    for file in files:
        temperature_k = file.settings[1]
        if temperature_k is not None and "temperature_k" not in file.group.settings:
            kelvins.append(temperature_k)
    groups: list[list[float]] = []
    for kelvin in sorted(kelvins):
        if not groups or kelvin - groups[-1][0] > SAME_TEMPERATURE_K:
            groups.append([])
        groups[-1].append(kelvin)
    mean_of: dict[float, float] = {}
    notes: list[str] = []
    for group in groups:
        mean = round(sum(group) / len(group), 3)
        mean_of |= dict.fromkeys(group, mean)
        if group[0] < group[-1]:
            notes.append(
                f"temperatures from {group[0]:.2f} to {group[-1]:.2f} K are taken as {mean:.2f} K "
                f"(within {SAME_TEMPERATURE_K:g} K)"
            )
    equal: list[_FrameFile] = []
    for file in files:
        exposure_s, temperature_k, gain = file.settings
        if temperature_k is not None and "temperature_k" not in file.group.settings:
            temperature_k = mean_of[temperature_k]
        equal.append(replace(file, settings=(exposure_s, temperature_k, gain)))
    files.clear()
    return equal, tuple(notes)


def _note_short(files: Sequence[_FrameFile]) -> Iterator[str]:
    """A note where all exposures are so short that their unit is likely to be another."""
    longest_s = max(file.settings[0] for file in files)
    if 0 < longest_s < SHORT_S:
        yield (
            f"the longest exposure is {1e6 * longest_s:.3g} µs, as stated, which few cameras have: if these are "
            "microseconds where nanoseconds are meant (EMVA 1288), times are 1000 times as long and dark currents as "
            "much smaller"
        )


def _known_kind(raw: RawFile) -> Kind | None:
    """The kind that the header of a file says, if it is one of ours."""
    for kind in KINDS:
        if kind == raw.kind:
            return kind
    return None


def _stacks(
    frame_files: list[_FrameFile], facts: Mapping[str, Any]
) -> Iterator[tuple[Kind, Stack]]:
    """One stack of each group of the manifest; without a manifest, one of equal group, size and settings.

    The list of files is emptied, so that each file's frames are let go when they are joined to a stack.
    """
    together: dict[object, list[_FrameFile]] = {}
    while frame_files:
        file = frame_files.pop(0)
        key: object = file.group.where
        if not facts:
            key = file.kind, file.group.where, file.raw.frames.shape[1:], file.settings
        together.setdefault(key, []).append(file)
    for alike in together.values():
        kind, stack = alike[0].kind, _stack(alike, facts)
        if kind == "flat":
            _require_equal_light(stack)
        yield kind, stack


def _stack(files: list[_FrameFile], facts: Mapping[str, Any]) -> Stack:
    """The stack of files that belong together. Raises InputError where their frames are not alike."""
    first, last = files[0], files[-1]
    for other in files:
        _require_alike(first, other)
    exposure_s, temperature_k, gain = first.settings
    photons: float | None = 0.0
    if first.kind not in ("bias", "dark"):
        photons = first.group.settings.get("photons")
    bits = facts.get("bits", first.raw.bits)
    tile = tuple(map(tuple, facts.get("tile", first.raw.tile)))
    source = str(first.file)
    if len(files) > 1:
        source = f"{first.file} … {last.file.name}"
    return Stack(_join(files), exposure_s, photons, temperature_k, gain, bits, tile, source)


def _require_equal_light(flat: Stack) -> None:
    """Raises InputError where frames of a flat field have different light, by some pixels of every part of them."""
    _, rows, columns = flat.frames.shape
    some = flat.frames[:, :: -(-rows // SEEN), :: -(-columns // SEEN)]
    means = some.mean(axis=(1, 2), dtype=float)
    if means.max() > MOST_DRIFT * means.min():
        raise InputError(
            f"{flat.source}: the {len(means)} frames of this flat field have means from {means.min():.4g} to "
            f"{means.max():.4g} DN, of several levels of light; put each level into a folder of its own (flat_1/, "
            f"flat_2/, …), or {WAY_OUT}, with a [[stack]] for each level."
        )


def _require_alike(first: _FrameFile, other: _FrameFile) -> None:
    """Raises InputError where two files of one stack differ in size, type or settings of their frames."""
    for what, expected, actual in (
        ("shape", first.raw.frames.shape[1:], other.raw.frames.shape[1:]),
        ("type", first.raw.frames.dtype, other.raw.frames.dtype),
        ("exposure_s, temperature_k and gain", first.settings, other.settings),
    ):
        if expected != actual:
            raise InputError(
                f"{first.group.where}: {what} of {first.file.name} is {expected} and of {other.file.name} {actual}; "
                "frames of one stack must be alike: name them in stacks of their own."
            )


def _join(files: list[_FrameFile]) -> NDArray[Any]:
    """All frames as one array; each file's own array is let go as soon as it is copied."""
    first = files[0].raw.frames
    if len(files) == 1:
        return first
    number = sum(len(file.raw.frames) for file in files)
    frames = np.empty((number, *first.shape[1:]), first.dtype)
    position = 0
    while files:
        part = files.pop(0).raw.frames
        frames[position : position + len(part)] = part
        position += len(part)
    return frames


def _order_of_settings(stack: Stack) -> tuple[tuple[float, str], float, float]:
    """Sorts stacks by gain, exposure time and temperature."""
    return _order_of_gain(stack.gain), stack.exposure_s, stack.temperature_k or 0.0


def _order_of_gain(gain: str) -> tuple[float, str]:
    """Sorts gains: numbers by value, before names."""
    try:
        return float(gain), ""
    except ValueError:
        return math.inf, gain

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
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from ...core import InputError
from ...core.checks import require_path
from ...files.raw_files import RawFile, read_raw
from ...files.texts import Facts
from .manifest import (
    KINDS,
    MANIFEST,
    WAY_OUT,
    Group,
    Kind,
    groups,
    groups_of_names,
    names_of_readouts,
    read_descriptor,
    read_manifest,
    read_readout,
)
from .stack import Stack, release

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

    def __repr__(self) -> str:
        kinds = (
            ("bias", self.biases),
            ("dark", self.darks),
            ("flat", self.flats),
            ("scene", self.scenes),
        )
        return f"<Bench: {', '.join(f'{len(stacks)} {kind}' for kind, stacks in kinds)} stacks>"

    @property
    def unlit(self) -> tuple[Stack, ...]:
        """Bias and dark stacks."""
        return (*self.biases, *self.darks)

    @property
    def stacks(self) -> tuple[Stack, ...]:
        """All stacks: bias, dark, flat and scene."""
        return (*self.unlit, *self.flats, *self.scenes)

    @property
    def gains(self) -> tuple[str, ...]:
        """Names of the gain settings, numbers in their order."""
        return tuple(sorted({stack.gain for stack in self.stacks}, key=_order_of_gain))

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

        def of_filter(name: str, stacks: Sequence[Stack]) -> list[Stack]:
            return [stack.of_filters()[name] for stack in stacks]

        names = self.stacks[0].of_filters() if self.stacks else ()
        return {name: self.change(partial(of_filter, name)) for name in names}

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
        kinds = self.biases, self.darks, self.flats, self.scenes
        biases, darks, flats, scenes = (tuple(change(kind)) for kind in kinds)
        return Bench(biases, darks, flats, scenes, self.wavelength_nm, self.notes)


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

    Frames stay on disk, those of several files in a temporary one: the memory is that of a few stacks.
    Raises InputError for what cannot be read or told apart, with the file and the way out.
    """
    facts, file_groups = _facts_and_groups(path)
    read: Callable[[Path], RawFile] = read_raw
    if readout:
        read = partial(read_readout, name=readout)
        facts = {name: value for name, value in facts.items() if name != "bits"}
        file_groups = [group.of_readout() for group in file_groups]
    files = [(group, file) for group in file_groups for file in group.files]
    frame_files: list[_FrameFile] = []
    with tempfile.TemporaryFile() as spool:
        for number, (group, file) in enumerate(files, start=1):
            raw = read(file)
            if not isinstance(raw.frames, np.memmap):
                raw = replace(raw, frames=_on_disk(spool, raw.frames))
            frame_files.append(_FrameFile.describe(file, raw, group))
            if report is not None:
                report(number, len(files))
        frame_files, notes = _with_equal_temperatures(frame_files)
        stacks: dict[Kind, list[Stack]] = {kind: [] for kind in KINDS}
        for kind, stack in _stacks(frame_files, facts, spool):
            stacks[kind].append(stack)
    biases, darks, flats, scenes = (
        tuple(sorted(of_kind, key=_order_of_settings)) for of_kind in stacks.values()
    )
    notes = (*notes, *_note_short(frame_files))
    return Bench(biases, darks, flats, scenes, facts.get("wavelength_nm"), notes)


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


def _on_disk(spool: IO[bytes], *parts: NDArray[Any]) -> NDArray[Any]:
    """Frames of equal size and type as one array, mapped from the end of a file. Raises InputError for a full disk."""
    begin = spool.seek(0, os.SEEK_END)
    try:
        for frames in parts:
            spool.write(np.ascontiguousarray(frames).data)
            release(frames)
        spool.flush()
    except OSError as error:
        raise InputError(
            f"the frames cannot be kept in {tempfile.gettempdir()}: {error.strerror}; set TMPDIR to a folder with room "
            "for twice their size."
        ) from None
    shape = (sum(map(len, parts)), *parts[0].shape[1:])
    return np.memmap(spool, parts[0].dtype, "r", begin, shape)


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
        kind = group.kind or next((kind for kind in KINDS if kind == raw.kind), None)
        if kind is None:
            which = f"is it one of {', '.join(KINDS)}? Begin its name or its folder's with that, or {WAY_OUT}"
            raise InputError(f"{file}: {which}.")
        exposure_s = settings.get("exposure_s", 0.0 if kind == "bias" else raw.exposure_s)
        if exposure_s is None:
            raise InputError(
                f"{file} does not say how long it was exposed; {WAY_OUT}, with exposure_s in it."
            )
        temperature_k = settings.get("temperature_k", raw.temperature_k)
        gain = str(settings.get("gain", raw.gain))
        return cls(file, group, raw, kind, (float(exposure_s), temperature_k, gain))

    @property
    def jittering_k(self) -> float | None:
        """The temperature, if it is that of the metadata."""
        return None if "temperature_k" in self.group.settings else self.settings[1]


def _with_equal_temperatures(
    files: list[_FrameFile],
) -> tuple[list[_FrameFile], tuple[str, ...]]:
    """The files with one temperature for all that metadata say are within 1 K, their mean, and a note about it.

    A cooled sensor is not kept at a temperature more exactly, and headers say it to a hundredth of a kelvin.
    """
    clusters: list[list[float]] = []
    for kelvin in sorted(file.jittering_k for file in files if file.jittering_k is not None):
        if not clusters or kelvin - clusters[-1][0] > SAME_TEMPERATURE_K:
            clusters.append([])
        clusters[-1].append(kelvin)
    mean_of: dict[float | None, float] = {}
    notes: list[str] = []
    for cluster in clusters:
        mean = round(sum(cluster) / len(cluster), 3)
        mean_of |= dict.fromkeys(cluster, mean)
        if cluster[0] < cluster[-1]:
            notes.append(
                f"temperatures from {cluster[0]:.2f} to {cluster[-1]:.2f} K are taken as {mean:.2f} K "
                f"(within {SAME_TEMPERATURE_K:g} K)"
            )
    equal: list[_FrameFile] = []
    for file in files:
        exposure_s, temperature_k, gain = file.settings
        temperature_k = mean_of.get(file.jittering_k, temperature_k)
        equal.append(replace(file, settings=(exposure_s, temperature_k, gain)))
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


def _stacks(
    frame_files: Sequence[_FrameFile], facts: Mapping[str, Any], spool: IO[bytes]
) -> Iterator[tuple[Kind, Stack]]:
    """One stack of each group of the manifest; without a manifest, one of equal group, size and settings."""
    together: dict[object, list[_FrameFile]] = {}
    for file in frame_files:
        key: object = file.group.where
        if not facts:
            key = file.kind, file.group.where, file.raw.frames.shape[1:], file.settings
        together.setdefault(key, []).append(file)
    for alike in together.values():
        kind, stack = alike[0].kind, _stack(alike, facts, spool)
        if kind == "flat":
            _require_equal_light(stack)
        yield kind, stack
        stack.release()


def _stack(files: list[_FrameFile], facts: Mapping[str, Any], spool: IO[bytes]) -> Stack:
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
    source, frames = str(first.file), first.raw.frames
    if len(files) > 1:
        source = f"{first.file} … {last.file.name}"
        frames = _on_disk(spool, *(file.raw.frames for file in files))
    return Stack(frames, exposure_s, photons, temperature_k, gain, bits, tile, source)


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


def _order_of_settings(stack: Stack) -> tuple[tuple[float, str], float, float]:
    """Sorts stacks by gain, exposure time and temperature."""
    return _order_of_gain(stack.gain), stack.exposure_s, stack.temperature_k or 0.0


def _order_of_gain(gain: str) -> tuple[float, str]:
    """Sorts gains: numbers by value, before names."""
    try:
        return float(gain), ""
    except ValueError:
        return math.inf, gain

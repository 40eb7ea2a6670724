"""Bias, dark and flat frames of a camera in a folder: which files form a stack, and how each stack was taken.

A manifest states it in ``bench.toml`` next to the files::

    bits = 12                     # optional, of the ADC
    wavelength_nm = 550           # optional, of the light: for the quantum efficiency

    [[stack]]
    files = "dark_10ms/*.tiff"    # a pattern or a list of names, relative to the manifest
    kind = "dark"                 # bias, dark, flat or scene
    exposure_s = 0.01             # default: from the metadata; so are temperature_k, gain and photons
    temperature_k = 298.15
    gain = "800"                  # ISO speed, or the name of the setting
    photons = 0                   # mean photons per pixel and exposure, if known

Without a manifest, the kind is the beginning of the name of the file or its folder, or comes from a FITS header.
Exposure, gain and photons come from the metadata. Files of equal kind, size and settings (temperatures within 1 K)
form a stack; flat fields and scenes form one stack per folder.
"""

from __future__ import annotations

import math
import os
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import IO, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...core import InputError
from ...core.checks import require_path
from ...files.raw_files import RawFile, read_raw
from ...files.texts import Facts
from .manifest import (
    KINDS,
    MANIFEST,
    PHOTONS_RANGE_MAX,
    WAY_OUT,
    Group,
    Kind,
    groups,
    groups_of_names,
    mean_photons,
    names_of_readouts,
    read_descriptor,
    read_manifest,
    read_readout,
    stated_photons,
)
from .stack import Stack, release

EQUAL_TEMPERATURE_K = 1.0
"""Largest difference of temperatures in metadata that count as equal; dark current differs by a tenth or less."""
LIGHT_RATIO_MAX = 1.5
"""Largest ratio of the means of two frames of a flat field; a larger one means several exposure levels."""
SAMPLED_LINES = 64
"""Largest number of rows and columns that are compared for equal light."""
SHORT_EXPOSURE_S = 1e-5
"""Longest exposure of a bench below which its unit is doubtful."""


@dataclass(frozen=True, eq=False)
class Bench:
    """Stacks of a camera by kind.

    ::

        bench = ms.lab.read_bench("bench/")
        print(len(bench.darks), bench.gains)

    biases, darks, flats, scenes : stacks in the order of gain, exposure and temperature.
    wavelength_nm : wavelength of the light [nm], or None.  notes : remarks on how the stacks were formed.
    """

    biases: tuple[Stack, ...]
    darks: tuple[Stack, ...]
    flats: tuple[Stack, ...]
    scenes: tuple[Stack, ...] = ()
    wavelength_nm: float | None = None
    notes: tuple[str, ...] = ()

    def __repr__(self) -> str:
        stacks = self.biases, self.darks, self.flats, self.scenes
        counts = (f"{len(of)} {kind}" for kind, of in zip(KINDS, stacks, strict=True))
        return f"<Bench: {', '.join(counts)} stacks>"

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
        """Names of the gain settings, numbers in ascending order."""
        return tuple(sorted({stack.gain for stack in self.stacks}, key=_order_of_gain))

    def at_gain(self, gain: str) -> Bench:
        """Return the stacks of one gain setting."""
        return self.change(lambda stacks: [stack for stack in stacks if stack.gain == gain])

    def of_filters(self) -> dict[str, Bench]:
        """Return one bench for each position of the tile, by the name of its filter, as :meth:`Stack.of_filters`.

        Raises InputError if the stacks have different mosaics.
        """
        sources = {stack.tile: stack.source for stack in self.stacks}
        if len(sources) > 1:
            tiles = "; ".join(
                f"{source} has {tile or 'none'}" for tile, source in sources.items()
            )
            raise InputError(
                f"the stacks have different mosaics: {tiles}; state the tile in the manifest."
            )

        def of_filter(name: str, stacks: Sequence[Stack]) -> list[Stack]:
            return [stack.of_filters()[name] for stack in stacks]

        names = self.stacks[0].of_filters() if self.stacks else ()
        return {name: self.change(partial(of_filter, name)) for name in names}

    def given(self, bits: int | None = None, wavelength_nm: float | None = None) -> Bench:
        """Return this bench with other bits and wavelength, if they are not None."""
        bench = self
        if bits is not None:
            bench = bench.change(lambda stacks: [replace(stack, bits=bits) for stack in stacks])
        if wavelength_nm is not None:
            bench = replace(bench, wavelength_nm=wavelength_nm)
        return bench

    def change(self, change: Callable[[Sequence[Stack]], Sequence[Stack]]) -> Bench:
        """Return this bench with the stacks of each kind changed by a function."""
        kinds = self.biases, self.darks, self.flats, self.scenes
        biases, darks, flats, scenes = (tuple(change(kind)) for kind in kinds)
        return Bench(biases, darks, flats, scenes, self.wavelength_nm, self.notes)


def read_bench(
    path: str | os.PathLike[str],
    report: Callable[[int, int], None] | None = None,
    readout: str = "",
) -> Bench:
    """Read a folder, a manifest of another name (.toml) or an EMVA 1288 descriptor (any other name).

    ::

        bench = ms.lab.read_bench("bench/")
        twin = ms.lab.fit(bench)

    report : called after each file with the number of read files and of all files.
    readout : name of the readout to read, for a camera with several readouts whose frames this package wrote.

    Frames stay on disk, in one temporary file if a stack has several files, so memory holds only a few stacks.
    Raises InputError for files that cannot be read or assigned, with the file and how to fix it.
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
            stated = None if readout else stated_photons(file)
            frame_files.append(_FrameFile.describe(file, raw, group, stated))
            if report is not None:
                report(number, len(files))
        frame_files, notes = _with_equal_temperatures(frame_files)
        stacks: dict[Kind, list[Stack]] = {kind: [] for kind in KINDS}
        for kind, stack in _stacks(frame_files, facts, spool):
            stacks[kind].append(stack)

    def settings_of(stack: Stack) -> tuple[tuple[float, str], float, float]:
        return _order_of_gain(stack.gain), stack.exposure_s, stack.temperature_k or 0.0

    biases, darks, flats, scenes = (tuple(sorted(x, key=settings_of)) for x in stacks.values())
    notes = (*notes, *_note_uneven(frame_files), *_note_short(frame_files))
    return Bench(biases, darks, flats, scenes, facts.get("wavelength_nm"), notes)


def readouts_of_bench(path: str | os.PathLike[str]) -> tuple[str, ...]:
    """Return the names of the readouts that the frames of a bench were combined from, the most sensitive first.

    A camera with one readout has none. Raises InputError as :func:`read_bench`.
    """
    _, file_groups = _facts_and_groups(path)
    return names_of_readouts(file_groups[0].files[0])


def _facts_and_groups(path: str | os.PathLike[str]) -> tuple[Facts, list[Group]]:
    """Return the facts of a manifest or descriptor about all frames, and groups of files. Raises InputError."""
    folder = manifest = require_path("path", path, "bench/")
    if folder.is_dir():
        manifest = folder / MANIFEST
    elif not folder.exists():
        raise InputError(
            f"there is no {folder}; give a folder of raw frames, or a manifest in it."
        )
    if manifest.is_file() and manifest.suffix != ".toml":
        return read_descriptor(manifest)
    if manifest.exists():
        facts = read_manifest(manifest)
        return facts, groups(facts, manifest)
    return {}, groups_of_names(folder)


def _on_disk(spool: IO[bytes], *parts: NDArray[Any]) -> NDArray[Any]:
    """Append frames of equal size and type to a file and return them as one mapped array.

    Raises InputError for a full disk.
    """
    begin = spool.seek(0, os.SEEK_END)
    try:
        for frames in parts:
            spool.write(np.ascontiguousarray(frames).data)
            release(frames)
        spool.flush()
    except OSError as error:
        raise InputError(
            f"the frames cannot be kept in {tempfile.gettempdir()}: {error.strerror}; set TMPDIR to a folder with "
            "space for twice their size."
        ) from None
    shape = (sum(map(len, parts)), *parts[0].shape[1:])
    return np.memmap(spool, parts[0].dtype, "r", begin, shape)


class _Settings(NamedTuple):
    """Settings that the frames of a stack share."""

    exposure_s: float
    temperature_k: float | None
    gain: str


@dataclass(frozen=True, eq=False)
class _FrameFile:
    """Frames of one file with all that is known about them.

    photons : mean photons per pixel; None if unknown, NaN if the metadata state photons that vary over the pixels.
    """

    file: Path
    group: Group
    raw: RawFile
    kind: Kind
    settings: _Settings
    photons: float | None

    @classmethod
    def describe(
        cls, file: Path, raw: RawFile, group: Group, stated: float | None
    ) -> _FrameFile:
        """Combine the manifest and the metadata of a file. Raises InputError if neither states what is needed.

        stated : photons per pixel in the metadata, or None.
        """
        settings = group.settings
        kind = group.kind or next((kind for kind in KINDS if kind == raw.kind), None)
        if kind is None:
            raise InputError(
                f"{file}: is it one of {', '.join(KINDS)}? Begin its name or its folder's name with one of them, or "
                f"{WAY_OUT}."
            )
        exposure_s = settings.get("exposure_s", 0.0 if kind == "bias" else raw.exposure_s)
        if exposure_s is None:
            raise InputError(
                f"{file} does not state its exposure time; {WAY_OUT}, with exposure_s in it."
            )
        photons = settings.get("photons")
        if kind in ("bias", "dark"):
            photons = 0.0
        elif kind == "flat" and photons is None:
            photons = stated
        temperature_k = settings.get("temperature_k", raw.temperature_k)
        shared = _Settings(
            float(exposure_s), temperature_k, str(settings.get("gain", raw.gain))
        )
        return cls(file, group, raw, kind, shared, photons)

    @property
    def jittering_k(self) -> float | None:
        """Temperature, if it comes from the metadata."""
        return None if "temperature_k" in self.group.settings else self.settings.temperature_k


def _with_equal_temperatures(
    files: list[_FrameFile],
) -> tuple[list[_FrameFile], tuple[str, ...]]:
    """Replace temperatures of metadata within 1 K, as a cooled sensor has, by their mean; return files and notes."""
    clusters: list[list[float]] = []
    for kelvin in sorted(file.jittering_k for file in files if file.jittering_k is not None):
        if not clusters or kelvin - clusters[-1][0] > EQUAL_TEMPERATURE_K:
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
                f"(within {EQUAL_TEMPERATURE_K:g} K)"
            )
    equal: list[_FrameFile] = []
    for file in files:
        kelvin_or_none = mean_of.get(file.jittering_k, file.settings.temperature_k)
        equal.append(
            replace(file, settings=file.settings._replace(temperature_k=kelvin_or_none))
        )
    return equal, tuple(notes)


def _note_uneven(files: Sequence[_FrameFile]) -> Iterator[str]:
    """Yield a note if the metadata of flat fields state photons that vary too much over the pixels."""
    uneven = [
        file.file for file in files if file.photons is not None and math.isnan(file.photons)
    ]
    if uneven:
        yield (
            f"photons vary by more than {100 * PHOTONS_RANGE_MAX:.0f} % over the pixels of {len(uneven)} flat fields "
            f"(first {uneven[0]}), so their mean is unknown; state photons in a {MANIFEST}"
        )


def _note_short(files: Sequence[_FrameFile]) -> Iterator[str]:
    """Yield a note if all exposures are so short that their unit is doubtful."""
    longest_s = max(file.settings.exposure_s for file in files)
    if 0 < longest_s < SHORT_EXPOSURE_S:
        yield (
            f"the longest exposure is {1e6 * longest_s:.3g} µs, which few cameras have: if the files state "
            "microseconds instead of nanoseconds (EMVA 1288), times are 1000 times as long"
        )


def _stacks(
    frame_files: Sequence[_FrameFile], facts: Mapping[str, Any], spool: IO[bytes]
) -> Iterator[tuple[Kind, Stack]]:
    """Yield a stack for each group of the manifest or, without one, for each size and set of settings."""
    together: dict[object, list[_FrameFile]] = {}
    for file in frame_files:
        key: object = file.group.where
        if not facts:
            key = file.kind, file.group.where, file.raw.frames.shape[1:], file.settings
        together.setdefault(key, []).append(file)
    for files in together.values():
        kind, stack = files[0].kind, _stack(files, facts, spool)
        if kind == "flat":
            _require_equal_light(stack)
        yield kind, stack
        stack.release()


def _stack(files: list[_FrameFile], facts: Mapping[str, Any], spool: IO[bytes]) -> Stack:
    """Return the stack of files that belong together. Raises InputError if their frames differ."""
    first, last = files[0], files[-1]
    for other in files:
        _require_alike(first, other)
    exposure_s, temperature_k, gain = first.settings
    photons = mean_photons([file.photons for file in files])
    bits = facts.get("bits", first.raw.bits)
    tile = tuple(map(tuple, facts.get("tile", first.raw.tile)))
    source, frames = str(first.file), first.raw.frames
    if len(files) > 1:
        source = f"{first.file} … {last.file.name}"
        frames = _on_disk(spool, *(file.raw.frames for file in files))
    return Stack(frames, exposure_s, photons, temperature_k, gain, bits, tile, source)


def _require_equal_light(flat: Stack) -> None:
    """Raise InputError if frames of a flat field have different light, judged by a grid of pixels."""
    _, rows, columns = flat.frames.shape
    grid = flat.frames[:, :: -(-rows // SAMPLED_LINES), :: -(-columns // SAMPLED_LINES)]
    means = grid.mean(axis=(1, 2), dtype=float)
    if means.max() > LIGHT_RATIO_MAX * means.min():
        raise InputError(
            f"{flat.source}: {len(means)} frames have means from {means.min():.4g} to {means.max():.4g} DN, several "
            f"exposure levels; put each level into a separate folder (flat_1/, flat_2/, …), or {WAY_OUT}."
        )


def _require_alike(first: _FrameFile, other: _FrameFile) -> None:
    """Raise InputError if two files of one stack differ in size, type or settings of their frames."""
    facts = (
        {
            "shape": file.raw.frames.shape[1:],
            "type": file.raw.frames.dtype,
            **file.settings._asdict(),
        }
        for file in (first, other)
    )
    for (what, expected), actual in zip(next(facts).items(), next(facts).values(), strict=True):
        if expected != actual:
            raise InputError(
                f"{first.group.where}: {what} of {first.file.name} is {expected} and of {other.file.name} {actual}; "
                "frames of one stack must be alike: put them into separate stacks."
            )


def _order_of_gain(gain: str) -> tuple[float, str]:
    """Return a key that sorts gains: numbers by value, before names."""
    try:
        return float(gain), ""
    except ValueError:
        return math.inf, gain

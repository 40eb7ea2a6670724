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
exposure and gain are those of the metadata; files of equal kind, size, exposure, gain and temperature are one stack.
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
from ...files.raw_files import RawFile, read_raw
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
from .stack import Stack


@dataclass(frozen=True, eq=False)
class Bench:
    """The stacks of a camera by what is in front of it.

    biases, darks, flats, scenes : stacks, each in the order of gain, exposure and temperature.
    wavelength_nm : of the light [nm], or None.
    """

    biases: tuple[Stack, ...]
    darks: tuple[Stack, ...]
    flats: tuple[Stack, ...]
    scenes: tuple[Stack, ...] = ()
    wavelength_nm: float | None = None

    @property
    def stacks(self) -> tuple[Stack, ...]:
        """All of them."""
        return (*self.biases, *self.darks, *self.flats, *self.scenes)

    @property
    def gains(self) -> tuple[str, ...]:
        """Names of the gain settings, numbers in their order."""
        return tuple(sorted({stack.gain for stack in self.stacks}, key=_in_order))

    def at_gain(self, gain: str) -> Bench:
        """The stacks of one gain setting."""
        return self._of(lambda stacks: [one for one in stacks if one.gain == gain])

    def of_filters(self) -> dict[str, Bench]:
        """The pixels behind each place of the tile apart, by the name of the filter, as :meth:`Stack.of_filters`.

        Raises InputError where some stacks have a mosaic and others have none, or another one.
        """
        tiles = {stack.tile: stack.source for stack in self.stacks}
        if len(tiles) > 1:
            found = "; ".join(
                f"{source} has {tile or 'none'}" for tile, source in tiles.items()
            )
            raise InputError(
                f"the stacks have different mosaics: {found}. Give the tile in the manifest."
            )
        names = list(self.stacks[0].of_filters()) if self.stacks else []
        return {name: self._of(partial(_behind, name)) for name in names}

    def given(self, bits: int | None = None, wavelength_nm: float | None = None) -> Bench:
        """The same where somebody knows better; None changes nothing."""
        bench = (
            self
            if bits is None
            else self._of(lambda stacks: [replace(one, bits=bits) for one in stacks])
        )
        return bench if wavelength_nm is None else replace(bench, wavelength_nm=wavelength_nm)

    def _of(self, some: Callable[[Sequence[Stack]], Sequence[Stack]]) -> Bench:
        kinds = (
            tuple(some(stacks)) for stacks in (self.biases, self.darks, self.flats, self.scenes)
        )
        biases, darks, flats, scenes = kinds
        return Bench(biases, darks, flats, scenes, self.wavelength_nm)


def _behind(name: str, stacks: Sequence[Stack]) -> list[Stack]:
    """The pixels of each stack behind one filter."""
    return [stack.of_filters()[name] for stack in stacks]


def read_bench(
    path: str | os.PathLike[str], report: Callable[[int, int], None] | None = None
) -> Bench:
    """The bench of a folder, or of a manifest of another name.

    report : called with the files that are read, and all of them, after each.
    Raises InputError for what cannot be read or told apart, with the file and the way out.
    """
    given = Path(path)
    manifest = given / MANIFEST if given.is_dir() else given
    if not manifest.exists() and not given.is_dir():
        raise InputError(
            f"there is no {given}; give a folder of raw frames, or a manifest in it."
        )
    facts = read_manifest(manifest) if manifest.exists() else {}
    found = groups(facts, manifest) if facts else groups_of_names(given)
    total, taken = sum(len(group.files) for group in found), list[_Taken]()
    for group in found:
        for file in group.files:
            taken.append(_Taken.of(file, read_raw(file), group))
            if report is not None:
                report(len(taken), total)
    stacks = sorted(
        _stacks(taken, facts), key=lambda one: (_in_order(one[1].gain), *_settings(one[1]))
    )
    kinds = {kind: tuple(stack for k, stack in stacks if k == kind) for kind in KINDS}
    return Bench(
        kinds["bias"], kinds["dark"], kinds["flat"], kinds["scene"], facts.get("wavelength_nm")
    )


@dataclass(frozen=True, eq=False)
class _Taken:
    """The frames of one file with all that is known about them."""

    file: Path
    group: Group
    raw: RawFile
    kind: Kind
    settings: tuple[float, float | None, str]  # exposure_s, temperature_k, gain

    @classmethod
    def of(cls, file: Path, raw: RawFile, group: Group) -> _Taken:
        given, kind = (
            group.settings,
            group.kind or next((one for one in KINDS if one == raw.kind), None),
        )
        if kind is None:
            which = f"is it one of {', '.join(KINDS)}? Begin its name or its folder's with that, or {WAY_OUT}"
            raise InputError(f"{file}: {which}.")
        exposure_s = given.get("exposure_s", 0.0 if kind == "bias" else raw.exposure_s)
        if exposure_s is None:
            raise InputError(
                f"{file} does not say how long it was exposed; {WAY_OUT}, with exposure_s in it."
            )
        temperature_k = given.get("temperature_k", raw.temperature_k)
        return cls(
            file,
            group,
            raw,
            kind,
            (float(exposure_s), temperature_k, str(given.get("gain", raw.gain))),
        )


def _stacks(taken: list[_Taken], facts: Mapping[str, Any]) -> Iterator[tuple[Kind, Stack]]:
    """One of each group of the manifest; without a manifest, one of equal kind, size and settings."""
    together: dict[object, list[_Taken]] = {}
    while taken:
        one = taken.pop(0)
        key = one.group.where if facts else (one.kind, one.raw.frames.shape[1:], one.settings)
        together.setdefault(key, []).append(one)
    for some in together.values():
        yield some[0].kind, _stack(some, facts)


def _stack(some: list[_Taken], facts: Mapping[str, Any]) -> Stack:
    first = some[0]
    for other in some:
        for what, one, two in (
            ("shape", first.raw.frames.shape[1:], other.raw.frames.shape[1:]),
            ("type", first.raw.frames.dtype, other.raw.frames.dtype),
            ("exposure_s, temperature_k and gain", first.settings, other.settings),
        ):
            if one != two:
                raise InputError(
                    f"{first.group.where}: {what} of {first.file.name} is {one} and of {other.file.name} {two}; "
                    "frames of one stack must be alike: name them in stacks of their own."
                )
    exposure_s, temperature_k, gain = first.settings
    photons = 0.0 if first.kind in ("bias", "dark") else first.group.settings.get("photons")
    bits, tile = (
        facts.get("bits", first.raw.bits),
        tuple(map(tuple, facts.get("tile", first.raw.tile))),
    )
    source = str(first.file) if len(some) == 1 else f"{first.file} … {some[-1].file.name}"
    return Stack(_joined(some), exposure_s, photons, temperature_k, gain, bits, tile, source)


def _joined(some: list[_Taken]) -> NDArray[Any]:
    """All frames as one array; each file's own array is let go as soon as it is copied."""
    if len(some) == 1:
        return some[0].raw.frames
    first, number = some[0].raw.frames, sum(len(one.raw.frames) for one in some)
    frames, at = np.empty((number, *first.shape[1:]), first.dtype), 0
    while some:
        part = some.pop(0).raw.frames
        frames[at : at + len(part)] = part
        at += len(part)
    return frames


def _settings(stack: Stack) -> tuple[float, float]:
    return stack.exposure_s, stack.temperature_k or 0.0


def _in_order(gain: str) -> tuple[float, str]:
    """Numbers by value, before names."""
    try:
        return float(gain), ""
    except ValueError:
        return math.inf, gain

"""The twin of a camera: what its frames show, as the tables of a camera file and measured maps."""

from __future__ import annotations

import copy
import math
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from ...core import InputError
from ...core.types import Float64Array
from ..frames.bench import Bench, read_bench
from ..frames.stack import Stack
from .evidence import Fitted
from .fields import Value, fields_of, full_well
from .maps import maps_of
from .noise_law import of_one_family
from .setting import Setting, fit_setting

NAME = "twin"
ASSUMED: dict[str, Any] = {
    "name": NAME,
    "sensor": {"technology": "cmos"},
    "pixel": {"pitch_x_um": 5.0, "pitch_y_um": 5.0, "fill_factor": 1.0},
    "quantum_efficiency": {},
    "dark_current": {},
    "source_follower": {},
    "readout": {},
    "adc": {},
    "lens": {"f_number": 2.8},
}
"""What no frame shows, without a camera that it is taken from."""
ASSUMED_SOURCES = {
    "sensor.technology": "assumed: cmos, which has row and column offsets",
    "pixel.pitch_x_um": "assumed: 5 µm; frames do not show it",
    "pixel.pitch_y_um": "assumed: 5 µm; frames do not show it",
    "pixel.fill_factor": "assumed: 1, so that the quantum efficiency is that of the whole pixel (EMVA 1288)",
    "lens.f_number": "assumed: f/2.8; frames do not show it",
}
QE, BAND_NM, ANY_NM = 0.6, (300.0, 1100.0), 550.0
FULL_SWING_V = 1.0
"""Swing of a full well, where no camera says its conversion gain [V]."""
SHARE, FEWEST = 0.25, 8
"""Of the frames of a stack that are held out, and of how many at least: 2 stay out and 6 in."""


@dataclass(eq=False)
class Twin:
    """Fitted from the frames of one camera.

    settings : what was measured at each gain setting, lowest K first; the first one's numbers are those of the file.
    wavelength_nm : of the light, or None.
    """

    settings: tuple[Setting, ...]
    wavelength_nm: float | None

    @property
    def base(self) -> Setting:
        """The setting of the lowest K."""
        return self.settings[0]

    @property
    def maps(self) -> dict[str, Float64Array]:
        """Measured maps of the base setting, for ``ms.expose(…, maps=twin.maps)``."""
        return maps_of(self.base)

    @property
    def notes(self) -> tuple[str, ...]:
        """What restricts the figures, and what could not be measured."""
        several = len(self.settings) > 1
        found = [
            f"gain {one.name}: {text}" if several else text
            for one in self.settings
            for text in one.notes
        ]
        return tuple(dict.fromkeys([*found, *step_notes(self.settings)]))

    def figures(self) -> dict[str, Fitted]:
        """All figures with intervals, by symbol, of the base setting."""
        one = self.base
        noise = {
            f.quantity.symbol: one.electrons(f)
            for f in (one.noise.read, one.noise.row, one.noise.column)
        }
        prnu = {f"PRNU_{part}": one.prnu(part) for part in ("pixel", "row", "column")}
        rate = one.electrons(one.dark.rate, "e-/s")
        found = {
            "K": one.gain,
            "black": one.dark.black,
            **noise,
            "cv_read": one.noise.cv,
            **prnu,
        }
        found |= {
            one.noise.law.shape.symbol: one.noise.shape,
            "µ_I": rate,
            "D_N": one.dark.cv,
            "µ_e.end": one.electrons(one.brightest.end),
        }
        return {name: figure for name, figure in found.items() if figure.known}

    def tables(self, like: Mapping[str, Any] | None = None) -> dict[str, Any]:
        """The tables of a camera file, for ``ms.load_camera(twin.tables())``.

        like : tables of a camera (``camera.model_dump()``) that give what frames do not show: pitch, quantum
            efficiency, lens, conversion gain. Without one these are assumed, and the sources say so.
        Raises InputError for a camera of another mosaic.
        """
        data = copy.deepcopy(dict(like) if like is not None else ASSUMED)
        sources = _sources_of(like)
        values = [*fields_of(self.base), *self._light(like), *self._gain(data)]
        for name, value, source in values:
            table, _, key = name.partition(".")
            data.setdefault(table, {})
            data[table] = dict(data[table] or {})
            data[table].pop(key, None)
            if value is not None:
                data[table][key] = value
            sources.pop(name, None)
            if source:
                sources[name] = source
        if len(self.settings) > 1:
            data["gains"] = gains_of(self.settings)
        else:
            data.pop("gains", None)
        data.pop("gain", None)
        return {**data, "sources": sources}

    def _light(self, like: Mapping[str, Any] | None) -> Iterator[Value]:
        """Quantum efficiency: measured where photons are known; else that of the other camera, or assumed."""
        tile = self.base.tile
        if like is not None:
            _check_tile(tile, like)
            return
        found = {name: one.efficiency for name, one in self.base.responses.items()}
        known = {
            name: q
            for name, q in found.items()
            if q is not None and math.isfinite(q.value) and 0 < q.value <= 1
        }
        where = (
            f" at {self.wavelength_nm:g} nm"
            if self.wavelength_nm
            else ", at an unknown wavelength"
        )
        if len(known) == len(found):
            each = [
                f"{name} {q.value:.3g} ({q.low:.3g} to {q.high:.3g})".strip()
                for name, q in known.items()
            ]
            source = f"fit: {', '.join(each)}{where}"
        else:
            source = f"assumed: {QE:g}; the photons of the flat fields are not known"
        values = {name: known[name].value if len(known) == len(found) else QE for name in found}
        yield Value(
            "quantum_efficiency.wavelengths_nm",
            list(BAND_NM),
            "assumed: one quantum efficiency for all light",
        )
        if tile:
            filters = {name: value for name, value in values.items() if " (" not in name}
            yield Value(
                "quantum_efficiency.curves",
                {name: [one, one] for name, one in filters.items()},
                source,
            )
            yield Value(
                "quantum_efficiency.tile",
                [list(row) for row in tile],
                "fit: the mosaic of the frames",
            )
        else:
            yield Value("quantum_efficiency.value", values[""], source)
        light = (
            "fit: the light of the flat fields"
            if self.wavelength_nm
            else f"assumed: {ANY_NM:g} nm"
        )
        yield Value("quantum_efficiency.reference_nm", self.wavelength_nm or ANY_NM, light)

    def _gain(self, data: Mapping[str, Any]) -> Iterator[Value]:
        """A_SN and V_FS, so that K = A_SN·A_SF·A_CDS·2^bits/V_FS."""
        one, readout = self.base, data["readout"]
        sense_uv = readout.get("sense_gain_uv_per_e")
        if sense_uv is None:
            sense_uv = float(f"{1e6 * FULL_SWING_V / full_well(one).value:.4g}")
            yield Value("readout.ve_k1_c", None)
            yield Value(
                "readout.sense_gain_uv_per_e",
                sense_uv,
                f"assumed: a full well is {FULL_SWING_V:g} V",
            )
        amplified = (data["source_follower"].get("gain") or 1.0) * (
            readout.get("cds_gain") or 1.0
        )
        swing = sense_uv * 1e-6 * amplified * 2.0**one.bits / one.gain.quantity.value
        yield Value(
            "adc.full_scale_v", swing, f"{one.gain.source}: V_FS = A_SN·A_SF·A_CDS·2^bits/K"
        )


def _sources_of(like: Mapping[str, Any] | None) -> dict[str, str]:
    if like is None:
        return dict(ASSUMED_SOURCES)
    return {
        name: f"of {like['name']}: {text}" for name, text in (like.get("sources") or {}).items()
    }


def _check_tile(tile: tuple[tuple[str, ...], ...], like: Mapping[str, Any]) -> None:
    given = like.get("quantum_efficiency", {}).get("tile")
    other = tuple(tuple(row) for row in given) if given else ()
    if tile != other:
        has = "no mosaic" if not other else " / ".join("".join(row) for row in other)
        have = "none" if not tile else " / ".join("".join(row) for row in tile)
        raise InputError(
            f"{like['name']} has {has}, the frames have {have}; give a camera of the same mosaic, or none."
        )


def fit(
    frames: str | os.PathLike[str] | Bench, report: Callable[[int, int], None] | None = None
) -> Twin:
    """The twin of the camera that took these bias, dark and flat frames.

    frames : a folder with a bench.toml or with names that tell bias, dark and flat frames apart; or a bench.
    report : called with the files that are read, and all of them, after each.

    At least one dark stack and flat fields of several levels with 2 frames each are needed; at each gain setting.
    Raises InputError where frames cannot be read or do not show K or the dark level.
    """
    bench = frames if isinstance(frames, Bench) else read_bench(frames, report)
    if not bench.stacks:
        raise InputError("the bench has no stacks; a twin needs dark frames and flat fields.")
    found = [fit_setting(bench.at_gain(gain)) for gain in bench.gains]
    found.sort(key=lambda one: one.gain.quantity.value)
    for one, law in zip(found, of_one_family([one.noise.law for one in found]), strict=True):
        one.noise = replace(one.noise, law=law)
    return Twin(tuple(found), bench.wavelength_nm)


def held_out(bench: Bench) -> tuple[Bench, Bench]:
    """(the frames to fit, the frames to compare with): the last quarter of each stack of 8 frames or more is held out.

    Both are views of the same frames.
    """
    return _part(bench, True), _part(bench, False)


def _part(bench: Bench, first: bool) -> Bench:
    biases, darks, flats = (
        _parts(some, first) for some in (bench.biases, bench.darks, bench.flats)
    )
    return Bench(biases, darks, flats, (), bench.wavelength_nm)


def _parts(stacks: Sequence[Stack], first: bool) -> tuple[Stack, ...]:
    return tuple(found for stack in stacks if (found := _of(stack, first)) is not None)


def _of(stack: Stack, first: bool) -> Stack | None:
    count = int(SHARE * len(stack)) if len(stack) >= FEWEST else 0
    if first:
        return replace(stack, frames=stack.frames[: len(stack) - count]) if count else stack
    return replace(stack, frames=stack.frames[len(stack) - count :]) if count else None


def gains_of(settings: Sequence[Setting]) -> list[dict[str, Any]]:
    """K, read noise with the shape of its law, black level, row and column noise of each setting.

    Full wells too, where all settings show one.
    """
    wells = all(one.brightest.limited_by == "well" for one in settings)
    return [_rung(one, wells) for one in settings]


def _rung(one: Setting, well: bool) -> dict[str, Any]:
    numbers = {
        "gain_dn_per_e": one.gain.quantity.value,
        "read_noise_e": one.electrons(one.noise.read).quantity.value,
        "black_level_dn": max(one.dark.black.quantity.value, 0.0),
        "row_noise_e": one.electrons(one.noise.row).quantity.value,
        "column_noise_e": one.electrons(one.noise.column).quantity.value,
    }
    if one.noise.shape.known:
        numbers["read_noise_shape"] = one.noise.shape.quantity.value
    if well:
        numbers["full_well_e"] = one.electrons(one.brightest.end).quantity.value
    return {**_label(one.name), **numbers}


def _label(name: str) -> dict[str, Any]:
    try:
        return {"iso": float(name)} if float(name) > 0 else {"name": name}
    except ValueError:
        return {"name": name or "unnamed"}


def step_notes(settings: Sequence[Setting]) -> list[str]:
    """Where read noise falls in DN while K rises, which one conversion gain cannot do.

    With σ² = a²K² + b² (noise before and behind the amplifier) it never falls.
    """
    found = []
    for low, high in zip(settings, settings[1:], strict=False):
        before, after = low.noise.read.quantity, high.noise.read.quantity
        if after.high < before.low:
            k = [f"{one.gain.quantity.value:.3g}" for one in (low, high)]
            found.append(
                f"conversion gain changes from {low.name} to {high.name}: K rises from {k[0]} to {k[1]} DN/e- while "
                f"the read noise falls from {before.value:.3g} to {after.value:.3g} DN"
            )
    return found

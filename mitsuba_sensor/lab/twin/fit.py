"""The twin of a camera: the parameters that its frames show, as tables of a camera file and measured maps."""

from __future__ import annotations

import copy
import math
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

from ...camera.camera_file import camera_of
from ...camera.field_catalogue import copied_source
from ...core import InputError
from ...core.progress import automatic_progress, is_asked
from ...core.types import Float64Array
from ...optics.spectra import SILICON_NM, silicon_qe
from ..frames.bench import Bench, read_bench
from ..frames.stack import Stack, merged
from .datasheet import DatasheetRow, datasheet_figures
from .evidence import Fitted
from .fields import ASSUMED_K, NORMAL_SHAPE, Value, fields_of, full_well, read_noise_e
from .setting import Setting, fit_setting

if TYPE_CHECKING:
    from ...camera.camera_file import AnyCamera

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
"""Tables for parameters that frames do not show, if no camera gives them."""
ASSUMED_SOURCES = {
    "sensor.technology": "assumed: cmos, which has row and column offsets",
    "pixel.pitch_x_um": "assumed: 5 µm; frames do not show it",
    "pixel.pitch_y_um": "assumed: 5 µm; frames do not show it",
    "pixel.fill_factor": "assumed: 1, so the quantum efficiency applies to the whole pixel (EMVA 1288)",
    "lens.f_number": "assumed: f/2.8; frames do not show it",
}
QE, BAND_NM, ANY_NM = 0.6, (300.0, 1100.0), 550.0
FULL_SWING_V = 1.0
"""Assumed swing of a full well [V], if no camera gives a conversion gain."""
HELD_OUT, HELD_OUT_OF_MIN = 0.25, 8
"""Fraction of the frames of a stack that are held out, and the least number of frames of such a stack."""


@dataclass(eq=False)
class Twin:
    """Twin of a camera, fitted to its frames.

    ::

        twin = ms.lab.fit("bench/")
        print(twin.figures(), twin.notes)

    settings : measurement at each gain setting, lowest K first; the first setting gives the numbers of the file.
    wavelength_nm : wavelength of the light [nm], or None.
    """

    settings: tuple[Setting, ...]
    wavelength_nm: float | None

    def __repr__(self) -> str:
        return f"<Twin: {len(self.settings)} gain settings, {len(self.figures())} figures>"

    @property
    def base(self) -> Setting:
        """Setting of the lowest K."""
        return self.settings[0]

    @property
    def maps(self) -> dict[str, Float64Array]:
        """Measured maps of the base setting, for ``ms.expose(…, maps=twin.maps)``."""
        return self.base.maps

    @property
    def notes(self) -> tuple[str, ...]:
        """Remarks on the figures, and on what could not be measured."""
        several = len(self.settings) > 1
        notes = [
            f"gain {setting.name}: {note}" if several else note
            for setting in self.settings
            for note in setting.notes
        ]
        return tuple(merged([*notes, *step_notes(self.settings)]))

    def figures(self) -> dict[str, Fitted]:
        """Return all figures of the base setting with intervals, by symbol."""
        setting = self.base
        dark, end = setting.dark, setting.brightest.end
        in_dn = [setting.read, setting.row, setting.column, setting.frame, dark.rate]
        in_dn += [dark.dsnu(part) for part in ("pixel", "row", "col")]
        if math.isfinite(end.quantity.high):
            in_dn.append(end.known_as(replace(end.quantity, symbol="µ_e.end")))
        figures = [setting.gain, dark.black, dark.cv, setting.read.known_as(setting.law)]
        figures += map(setting.electrons, in_dn)
        figures += map(setting.prnu, ("pixel", "row", "col"))
        for name, response in setting.responses.items():
            symbol = f"η {name}".rstrip()
            figures.append(response.end.known_as(replace(response.linear["η"], symbol=symbol)))
        return {figure.quantity.symbol: figure for figure in figures if figure.known}

    def beside(self, camera: AnyCamera) -> tuple[DatasheetRow, ...]:
        """Return the figures of the twin next to those of a datasheet, with differences in standard errors.

        ::

            print(*twin.beside("konnik_table1"), sep="\\n")

        camera : a camera with one readout, its name or its file, at the gain setting of the twin's base setting.
        A single sensor unit may differ from its datasheet in K, black level, dark current and PRNU by more than the
        standard error.
        """
        kelvin = self.base.dark.quiet.temperature_k or ASSUMED_K
        values = dict(datasheet_figures(camera_of(camera), kelvin, self.wavelength_nm))
        figures = {
            symbol.partition(" (")[0]: figure for symbol, figure in self.figures().items()
        }
        return tuple(
            DatasheetRow(figures[symbol].quantity, value)
            for symbol, value in values.items()
            if symbol in figures
        )

    def tables(self, like: Mapping[str, Any] | None = None) -> dict[str, Any]:
        """Return the tables of a camera file, for ``ms.load_camera(twin.tables())``.

        like : tables of a camera (``camera.model_dump()``) that give what frames do not show: pitch, quantum
            efficiency, lens, conversion gain. None assumes them, and the sources report it.
        Raises InputError for a camera with another mosaic.
        """
        data = copy.deepcopy(dict(like) if like is not None else ASSUMED)
        sources = _sources_of(like)
        tails = any(math.isfinite(setting.law.value) for setting in self.settings)
        values = [*fields_of(self.base, tails)]
        if like is None:
            values += self._quantum_efficiency()
        else:
            _check_tile(self.base.tile, like)
        values += self._conversion_gain(data)
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
        self._check_technology(data)
        for name in ("gain", "gains"):
            data.pop(name, None)
        if len(self.settings) > 1:
            data["gains"] = gains_of(self.settings)
        return {**data, "sources": sources}

    def _check_technology(self, data: Mapping[str, Any]) -> None:
        """Raise InputError for a CCD whose frames show patterns that only CMOS sensors have."""
        lines = ("dsnu_row", "dsnu_col", "prnu_col")
        given = [f"readout.{key}" for key in lines if data["readout"].get(key)]
        given += ["pixel.dsnu_e"] if data["pixel"].get("dsnu_e") else []
        if given and data["sensor"]["technology"] == "ccd":
            raise InputError(
                f"the frames have {', '.join(given)}, but {data['name']} is a CCD, which has none; pass as like= its "
                "copy of `cameras new COPY.toml --like NAME --set sensor.technology=cmos`."
            )

    def _quantum_efficiency(self) -> Iterator[Value]:
        """Yield the quantum efficiency of each filter: measured if photons are known, else assumed."""
        values, source = self._efficiencies()
        band_nm, assumed = list(BAND_NM), "one quantum efficiency for all light"
        at_nm, curve = self.wavelength_nm, [values.get("", QE)] * 2
        if not self.base.tile and at_nm and SILICON_NM[0] <= at_nm <= SILICON_NM[-1]:
            band_nm, curve = silicon_qe(curve[0], at_nm)
            assumed = f"typical silicon but at {at_nm:g} nm"
        yield Value("quantum_efficiency.wavelengths_nm", band_nm, f"assumed: {assumed}")
        if self.base.tile:
            first = {name: q for name, q in values.items() if " (" not in name}  # of its places
            curves = {name: [value, value] for name, value in first.items()}
            yield Value("quantum_efficiency.curves", curves, source)
            tile = [list(row) for row in self.base.tile]
            yield Value("quantum_efficiency.tile", tile, "fit: the mosaic of the frames")
        else:
            yield Value("quantum_efficiency.curves", {"mono": curve}, source)
        reference_nm, source = ANY_NM, f"assumed: {ANY_NM:g} nm"
        if self.wavelength_nm:
            reference_nm, source = self.wavelength_nm, "fit: the light of the flat fields"
        yield Value("quantum_efficiency.reference_nm", reference_nm, source)

    def _efficiencies(self) -> tuple[dict[str, float], str]:
        """Return the quantum efficiency by filter and its source; assumed if it is unknown for any filter."""
        values: dict[str, float] = {}
        texts: list[str] = []
        for name, response in self.base.responses.items():
            q = response.linear["η"]
            if not 0 < q.value <= 1:
                source = f"assumed: {QE:g}; the photons of the flat fields are unknown"
                return dict.fromkeys(self.base.responses, QE), source
            values[name] = q.value
            texts.append(f"{name} {q.value:.3g} ({q.low:.3g} to {q.high:.3g})".strip())
        at_nm = self.wavelength_nm
        where = f" at {at_nm:g} nm" if at_nm else ", at an unknown wavelength"
        return values, f"fit: {', '.join(texts)}{where}"

    def _conversion_gain(self, data: Mapping[str, Any]) -> Iterator[Value]:
        """Yield K if the other camera gives K, else A_SN and V_FS for K = A_SN·A_SF·A_CDS·2^bits/V_FS."""
        setting, readout = self.base, data["readout"]
        gain = setting.gain
        if readout.get("gain_dn_per_e") is not None:
            yield Value("readout.gain_dn_per_e", gain.quantity.value, gain.source)
            return
        sense_uv = readout.get("sense_gain_uv_per_e")
        if sense_uv is None:
            sense_uv = float(f"{1e6 * FULL_SWING_V / full_well(setting).value:.4g}")
            source = f"assumed: a full well is {FULL_SWING_V:g} V"
            yield Value("readout.ve_k1_c", None)
            yield Value("readout.sense_gain_uv_per_e", sense_uv, source)
        follower_gain = data["source_follower"].get("gain") or 1.0
        amplified = follower_gain * (readout.get("cds_gain") or 1.0)
        swing_v = sense_uv * 1e-6 * amplified * 2.0**setting.bits / gain.quantity.value
        yield Value(
            "adc.full_scale_v", swing_v, f"{gain.source}: V_FS = A_SN·A_SF·A_CDS·2^bits/K"
        )


def _sources_of(like: Mapping[str, Any] | None) -> dict[str, str]:
    """Return the sources of fields that frames do not show."""
    if like is None:
        return dict(ASSUMED_SOURCES)
    sources = like.get("sources") or {}
    return {name: copied_source(text, str(like["name"])) for name, text in sources.items()}


def _check_tile(tile: tuple[tuple[str, ...], ...], like: Mapping[str, Any]) -> None:
    """Raise InputError if a camera has another mosaic than the frames."""
    other = tuple(map(tuple, like.get("quantum_efficiency", {}).get("tile") or ()))
    if tile != other:
        has, have = (" / ".join(map("".join, mosaic)) for mosaic in (other, tile))
        raise InputError(
            f"{like['name']} has the mosaic {has or 'none'}, the frames have {have or 'none'}; give a camera with the "
            "same mosaic, or none."
        )


def fit(frames: str | os.PathLike[str] | Bench, *, progress: bool | None = None) -> Twin:
    """Fit the twin of the camera that took these bias, dark and flat frames.

    ::

        twin = ms.lab.fit("bench/")
        camera = ms.load_camera(twin.tables())

    frames : a bench, or a folder with a bench.toml or with names that distinguish bias, dark and flat frames.
    progress : None reports progress on stderr every ten seconds; False does not.

    Each gain setting needs a dark stack and flat fields at several levels, with 2 frames each.
    Raises InputError if frames cannot be read or do not show K or the dark level.
    """
    if not is_asked(progress):
        return _fitted(frames, lambda doing, share: None)
    with automatic_progress("fit", "reading frames") as teller:

        def tell(doing: str, share: float) -> None:
            if teller is not None:
                teller.tell(doing, share=share)

        return _fitted(frames, tell)


def _fitted(frames: str | os.PathLike[str] | Bench, tell: Callable[[str, float], None]) -> Twin:
    """Return the twin.  tell : called with the present step and the fraction of it that is done."""
    if isinstance(frames, Bench):
        bench = frames
    else:
        bench = read_bench(frames, lambda done, all: tell("reading frames", done / all))
    if not bench.stacks:
        raise InputError("the bench has no stacks; give dark frames and flat fields.")
    settings = []
    for number, gain in enumerate(bench.gains):
        tell("fitting", number / len(bench.gains))
        settings.append(fit_setting(bench.at_gain(gain)))
    settings.sort(key=lambda setting: setting.gain.quantity.value)
    return Twin(tuple(settings), bench.wavelength_nm)


def held_out(bench: Bench) -> tuple[Bench, Bench]:
    """Return views of the frames to fit and of those to compare: the last quarter of stacks of at least 8 frames."""

    def count(stack: Stack) -> int:
        return int(HELD_OUT * len(stack)) if len(stack) >= HELD_OUT_OF_MIN else 0

    def fitted(stacks: Sequence[Stack]) -> list[Stack]:
        return [replace(s, frames=s.frames[: len(s) - count(s)]) for s in stacks]

    def compared(stacks: Sequence[Stack]) -> list[Stack]:
        return [replace(s, frames=s.frames[-count(s) :]) for s in stacks if count(s)]

    bench = replace(bench, scenes=(), notes=())
    return bench.change(fitted), bench.change(compared)


def gains_of(settings: Sequence[Setting]) -> list[dict[str, Any]]:
    """Return tables with K, black level and noise of each gain setting, and full wells if all settings show one."""
    wells = all(setting.brightest.limited_by == "well" for setting in settings)
    tails = any(math.isfinite(setting.law.value) for setting in settings)
    tables: list[dict[str, Any]] = []
    for setting in settings:
        table = _label(setting.name) | {
            "gain_dn_per_e": setting.gain.quantity.value,
            "read_noise_e": read_noise_e(setting).value,
            "black_level_dn": max(setting.dark.black.quantity.value, 0.0),
        }
        noises = {"row": setting.row, "column": setting.column, "frame": setting.frame}
        for name, noise in noises.items():
            value = setting.electrons(noise).quantity.value
            table[f"{name}_noise_e"] = max(value, 0.0) if math.isfinite(value) else 0.0
        if tails:
            shape = setting.law.value
            table["read_noise_shape"] = shape if math.isfinite(shape) else NORMAL_SHAPE
        if wells:
            table["full_well_e"] = setting.electrons(setting.brightest.end).quantity.value
        tables.append(table)
    return tables


def _label(name: str) -> dict[str, Any]:
    """Return an ISO speed if the name is a positive number, else the name."""
    try:
        speed = float(name)
    except ValueError:
        return {"name": name or "unnamed"}
    if speed > 0:
        return {"iso": speed}
    return {"name": name}


def step_notes(settings: Sequence[Setting]) -> list[str]:
    """Return notes if read noise in DN falls while K rises, which needs another conversion gain.

    With one conversion gain, σ² = a²K² + b² (noise before and after the amplifier) never falls.
    """
    notes = []
    for low, high in zip(settings, settings[1:], strict=False):
        before, after = low.read.quantity, high.read.quantity
        if after.high < before.low:
            gain, higher_gain = low.gain.quantity.value, high.gain.quantity.value
            notes.append(
                f"the conversion gain changes from {low.name} to {high.name}: K rises from {gain:.3g} to "
                f"{higher_gain:.3g} DN/e- while the read noise falls from {before.value:.3g} to {after.value:.3g} DN"
            )
    return notes

"""Define the cameras and levels of light with which benchmarks/theory.py compares the theory of frames with frames."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

import mitsuba_sensor as ms
from mitsuba_sensor.camera.figures import saturation_e
from mitsuba_sensor.core import Electrons, Frame
from mitsuba_sensor.core.types import Array

TABLE1, BAYER, RGBIR, CCD = (
    ms.load_camera(n) for n in ("konnik_table1", "bayer_2mp", "rgbir_2mp", "eev_44_82")
)
V_PER_E = 5e-6  # Table 1
SHAPE = (8, 1024)
EXPOSURE = ms.Exposure(0.1)

Light = Callable[[float, tuple[int, int]], ms.Photons]


@dataclass(frozen=True)
class Case:
    """One camera in one exposure at one level of light.

    level_e : mean photoelectrons, or photons per pixel where ``light`` makes photons of them.
    maps : measured maps.  tile : rows and columns after which the light of the pixels repeats.
    """

    name: str
    camera: ms.Camera
    level_e: float
    exposure: ms.Exposure = EXPOSURE
    light: Light | None = None
    maps: Mapping[str, NDArray[np.float64]] = field(default_factory=dict)
    tile: tuple[int, int] = (1, 1)

    def photons(self, shape: tuple[int, int]) -> ms.Photons:
        """Of all pixels of a window."""
        if self.light is not None:
            return self.light(self.level_e, shape)
        curves = len(self.camera.quantum_efficiency.curves)
        return ms.Photons(
            np.full((*shape, curves), self.level_e), np.arange(curves) + 500.0, detected=True
        )


@dataclass(frozen=True)
class SkewedGain(ms.Stage):
    """A user's stage in front of the count: half of the pixels see 10 % more light, half 10 % less."""

    share: float = 0.1
    domain = "electrons"

    def sample(self, electrons: Electrons, frame: Frame) -> Electrons:
        """Photoelectrons times the gain of the pixel."""
        z = frame.window.fixed_map("skewed_gain", lambda backend, bits: backend.normal(bits))
        number = frame.number
        sign = (z > number(0.0)) * number(2.0) - number(1.0)
        return replace(
            electrons, light=electrons.light * (number(1.0) + number(self.share) * sign)
        )


@dataclass(frozen=True)
class SupplyNoise(ms.Stage):
    """A user's stage behind the count: normal noise that is new in each pixel and frame.  sigma_v : [V]."""

    sigma_v: float = 5e-5
    domain = "volts"

    def sample(self, swing: Array, frame: Frame) -> Array:
        """Swing with the noise."""
        return swing + frame.number(self.sigma_v) * frame.normal("supply_noise")


def changed(camera: ms.Camera, **changes: Any) -> ms.Camera:
    """``pixel__prnu=0.1`` → ``pixel.prnu``."""
    return camera.replace(**{name.replace("__", "."): value for name, value in changes.items()})


def with_gain(
    camera: ms.Camera, dn_per_e: float, bits: int, full_well_e: float, **changes: Any
) -> ms.Camera:
    """An overall system gain K, at 5 µV/e-."""
    changes |= {
        "adc__full_scale_v": 2**bits / dn_per_e * V_PER_E,
        "adc__bits": bits,
        "pixel__full_well_e": full_well_e,
    }
    return changed(camera, **changes)


def with_read_noise(camera: ms.Camera, sigma_e: float, **changes: Any) -> ms.Camera:
    """Read noise as one number."""
    return changed(
        camera,
        source_follower__read_noise_e=sigma_e,
        source_follower__white_nv_per_rthz=None,
        **changes,
    )


def telegraph(**changes: Any) -> ms.Camera:
    """K 1 DN/e-, read noise 0.2 e-, steps of 1 e-: the noise hides no code."""
    step = {
        "source_follower__rtn_pixel_amplitude_e": 1.0,
        "adc__black_level_dn": 10.3,
        "readout__dsnu_col": 0.0,
    }
    return with_read_noise(with_gain(TABLE1, 1.0, 12, 4000.0), 0.2, **(step | changes))


def dark(seconds: float) -> ms.Exposure:
    """An exposure of so many seconds."""
    return ms.Exposure(seconds)


def hot(low: float, high: float, weight: float = 1e-3) -> ms.Camera:
    """Table 1 with a share of hot pixels of uniformly distributed dark electrons."""
    part = {"weight": weight, "family": "uniform", "low": low, "high": high, "unit": "e"}
    return changed(TABLE1, dark_current__components=[part])


def dnl_table(bits: int, rms_lsb: float) -> dict[str, float]:
    """Random widths of the codes."""
    widths = np.clip(np.random.default_rng(5).normal(0.0, rms_lsb, 2**bits), -1.0, None)
    return {str(code): float(widths[code]) for code in range(1, 2**bits - 1)}


def of_band(wavelength_nm: float) -> Light:
    """Photons of one wavelength."""
    return lambda level, shape: ms.Photons(
        np.full((*shape, 1), level), np.array([wavelength_nm])
    )


def cases() -> list[Case]:
    """All of them."""
    return [
        *_dark_currents(),
        *_clips(),
        *_converters(),
        *_few_electrons(),
        *_light(),
        *_own_stages(),
        *_once_wrong(),
    ]


def _dark_currents() -> list[Case]:
    log_normal = {cv: changed(TABLE1, dark_current__cv=cv) for cv in (0.4, 1.0)}
    found = [
        Case("log-normal cv 1, 5 s, dark", log_normal[1.0], 0.0, dark(5.0)),
        Case("log-normal cv 0.4, 9 s, dark", log_normal[0.4], 0.0, dark(9.0)),
        *(Case("hot 1e-3 of U[5e3, 3e4] e-", hot(5e3, 3e4), e) for e in (0.0, 2e4)),
        *(Case("hot 1e-3 of U[1e5, 1e6] e-", hot(1e5, 1e6), e) for e in (0.0, 2e4)),
    ]
    for family in ("lognormal", "gamma", "wald", "gaussian", "logistic", "ar"):
        for cv, seconds in ((0.4, 1.0), (2.0, 1.0), (10.0, 8.0)):
            camera = changed(TABLE1, dark_current__distribution=family, dark_current__cv=cv)
            found.append(
                Case(f"{family} cv {cv:g}, {seconds:g} s", camera, 3000.0, dark(seconds))
            )
    rts = {"rts_fraction": 0.01, "rts_amplitude_e_per_s": 9000.0, "rts_switching": 1.0}
    rts = {f"dark_current__{name}": value for name, value in rts.items()}
    found += [Case("RTS pixels, 900 e-", changed(TABLE1, **rts), e) for e in (0.0, 32_500.0)]
    fast = with_gain(with_read_noise(TABLE1, 0.3), 3.0, 14, 5000.0, **rts)
    return [*found, Case("RTS pixels, K 3, 0.3 e-", fast, 2.0, dark(0.001))]


def _clips() -> list[Case]:
    both = with_read_noise(
        with_gain(TABLE1, 0.02, 4, 600.0), 30.0, pixel__prnu=0.3, adc__black_level_dn=1.0
    )
    narrow = with_read_noise(
        with_gain(TABLE1, 0.12, 4, 33e3), 3.0, pixel__prnu=0.02, adc__black_level_dn=1.0
    )
    return [
        *(Case("Table 1", TABLE1, e) for e in (0.0, 3e3, 32_700.0, 33_000.0, 34_000.0, 1e6)),
        *(Case("PRNU 2 % between two clips", narrow, e) for e in (30.0, 65.0, 110.0)),
        *(Case("both clips at once", both, e) for e in (0.0, 100.0, 500.0)),
        Case("PRNU 20 % about the full well", changed(TABLE1, pixel__prnu=0.2), 33_000.0),
        Case("black level 0", changed(TABLE1, adc__black_level_dn=0.0), 0.0),
        Case(
            "full well below the converter", changed(TABLE1, adc__full_scale_v=0.25), 33_000.0
        ),
        *(
            Case(
                "full well 1 e-, 1 bit",
                changed(TABLE1, pixel__full_well_e=1.0, adc__bits=1),
                e,
                dark(1e-4),
            )
            for e in (0.3, 2.0)
        ),
        Case("full well 33000 e-, 1 bit", changed(TABLE1, adc__bits=1), 16_300.0),
    ]


def _converters() -> list[Case]:
    dnl = changed(TABLE1, adc__bits=8, adc__dnl_lsb=dnl_table(8, 0.4), adc__black_level_dn=10.0)
    vv = {"source_follower__vv_nonlinearity": 1.05}
    ve = {"readout__ve_nonlinearity": 1.0}
    hot_curve = with_read_noise(
        with_gain(hot(200.0, 900.0, 0.02), 4.0, 2, 1700.0, adc__gamma=0.97), 3.7
    )
    hot_curve = changed(hot_curve, readout__prnu_col=0.04)
    curved = changed(TABLE1, **vv, **ve, adc__gamma=1.04, readout__sense_gain_uv_per_e=40.0)
    return [
        *(Case("8 bit, DNL 0.4 LSB rms", dnl, e) for e in (0.0, 700.0, 30_000.0)),
        *(Case("V/V 1.05", changed(TABLE1, **vv), e) for e in (5e3, 32_900.0)),
        *(
            Case(
                "V/e 1 at 40 µV/e-", changed(TABLE1, **ve, readout__sense_gain_uv_per_e=40.0), e
            )
            for e in (5e3, 3e4)
        ),
        *(Case("V/V, V/e and ADC non-linear", curved, e) for e in (5e3, 32_500.0)),
        Case("hot pixels far beyond a curve", hot_curve, 30.0, dark(1e-3)),
        Case("16 bit", changed(TABLE1, adc__bits=16), 30_000.0),
        Case("24 bit", changed(TABLE1, adc__bits=24), 1000.0),
        Case(
            "PRNU_col 1 %, DSNU 30 e-",
            changed(TABLE1, readout__prnu_col=0.01, pixel__dsnu_e=30.0),
            2e4,
        ),
        Case(
            "PRNU_col 2 % at the full well", changed(TABLE1, readout__prnu_col=0.02), 32_800.0
        ),
        Case(
            "row and column noise",
            changed(TABLE1, readout__row_noise_e=40.0, readout__column_noise_e=25.0),
            100.0,
        ),
        Case(
            "read noise of its own in every pixel",
            telegraph(source_follower__read_noise_cv=1.0),
            0.0,
            dark(1e-4),
        ),
        *(
            Case(
                f"RTN pixels, black level {level:g} DN",
                telegraph(source_follower__rtn_pixel_fraction=0.3, adc__black_level_dn=level),
                0.0,
                dark(1e-4),
            )
            for level in (10.0, 10.3, 10.5)
        ),
        Case("hard reset", changed(TABLE1, readout__reset="hard"), 500.0),
    ]


def _few_electrons() -> list[Case]:
    found = []
    quiet = {
        "readout__dsnu_col": 1e-4,
        "adc__black_level_dn": 10.3,
        "dark_current__fom_na_per_cm2": 1e-3,
    }
    for gain, sigma, bits, well in (
        (0.5, 0.15, 12, 7000.0),
        (7.3, 0.27, 16, 7000.0),
        (1.0003, 0.2, 14, 9000.0),
    ):
        camera = with_read_noise(with_gain(TABLE1, gain, bits, well, **quiet), sigma)
        found += [Case(f"qCMOS K {gain:g}, {sigma:g} e-", camera, e) for e in (0.3, 4.0, 300.0)]
    edge = with_read_noise(
        with_gain(TABLE1, 0.125, 12, 30_000.0, **quiet), 0.05, adc__black_level_dn=16.0
    )
    return [*found, *(Case("4 e- at a code edge", edge, e) for e in (4.0, 40.0))]


def _light() -> list[Case]:
    ultraviolet = changed(TABLE1, quantum_efficiency__quantum_yield=[2.3, 1.2])
    traps = {"dark_current__rts_fraction": 0.02, "dark_current__rts_amplitude_e_per_s": 2e5}
    switching = changed(ultraviolet, **traps, dark_current__rts_switching=1.0)
    rng = np.random.default_rng(2)
    maps = {
        "prnu": 1 + 0.03 * rng.standard_normal(SHAPE),
        "dsnu_col_e": rng.normal(5.0, 60.0, (1, SHAPE[1])),
        "dark_fpn": rng.gamma(2.0, 0.5, SHAPE),
    }
    return [
        *(
            Case("900 nm on a mosaic", RGBIR, p, light=of_band(900.0), tile=(4, 4))
            for p in (100.0, 40_000.0)
        ),
        *(
            Case("620 nm on a mosaic", BAYER, p, light=of_band(620.0), tile=(2, 2))
            for p in (9.0, 90_000.0)
        ),
        *(Case("quantum yield", ultraviolet, p, light=of_band(450.0)) for p in (5.0, 4000.0)),
        Case("quantum yield, RTS pixels", switching, 300.0, light=of_band(450.0)),
        *(
            Case(f"measured {name}", TABLE1, 31_000.0, dark(0.5), maps={name: maps[name]})
            for name in maps
        ),
        *_measured(rng),
        Case("scientific CCD", CCD, 1e4, dark(1.0)),
    ]


def _measured(rng: np.random.Generator) -> list[Case]:
    """Maps of few values, of long tails, and several at once, next to both clips."""
    offsets = {
        "dsnu_col_e": rng.choice([-60.0, 10.0, 400.0], (1, SHAPE[1]), p=[0.6, 0.38, 0.02]),
        "dsnu_row_e": rng.normal(0.0, 50.0, (SHAPE[0], 1)),
        "dsnu_pixel_e": 40.0 * rng.standard_t(3, SHAPE),
        "prnu_col": rng.gamma(2500.0, 1 / 2500, (1, SHAPE[1])),
    }
    low = changed(TABLE1, adc__black_level_dn=5.0, dark_current__fom_na_per_cm2=0.0)
    sigma = {"read_noise": 8.0 * np.exp(rng.standard_normal(SHAPE))}
    coarse = with_read_noise(
        with_gain(TABLE1, 0.07, 2, 900.0), 8.0, source_follower__read_noise_cv=1.0
    )
    return [
        *(
            Case("measured maps, low clip", low, e, dark(1e-3), maps=offsets)
            for e in (10.0, 300.0)
        ),
        Case("measured maps, high clip", low, 32_900.0, dark(1e-3), maps=offsets),
        Case("measured read noise, 2 bit", coarse, 40.0, dark(1e-3), maps=sigma),
    ]


def _own_stages() -> list[Case]:
    before, behind = (
        TABLE1.with_stage(SkewedGain(), after="prnu"),
        TABLE1.with_stage(SupplyNoise(), after="cds_gain"),
    )
    return [
        *(Case("own stage before the count", before, e) for e in (500.0, 15_000.0)),
        *(Case("own stage behind the count", behind, e) for e in (0.0, 33_000.0)),
    ]


ONCE_WRONG = {
    1: "kTC 71 e- on a non-linear well of 3 e-",
    7: "curve far beyond its range",
    11: "cut logistic cv 4.9 on 2 e-",
    17: "full wells between two codes",
    23: "2 bit, DSNU 0.5 DN under little noise",
    33: "read noise 14 wells, non-linear",
    40: "1 bit, DSNU 7 DN, non-linear",
    226: "RTS pixels, DSNU of many code ranges",
    339: "2 bit, DSNU 2 DN on two curves",
    498: "7 bit, DSNU 16 DN on a curve",
    549: "a curve that falls again",
    1017: "RTS pixels of 6 full wells, DSNU 18 DN",
    2311: "4 bit, behind the peak of a curve that falls again",
}
"""Random cases that an earlier theory had wrong."""


def _once_wrong() -> list[Case]:
    return [replace(random_case(number), name=name) for number, name in ONCE_WRONG.items()]


def random_case(number: int) -> Case:
    """A camera, an exposure and a level of light out of wide ranges."""
    rng = np.random.default_rng([2024, number])

    def log(low: float, high: float) -> float:
        return float(np.exp(rng.uniform(math.log(low), math.log(high))))

    def maybe(chance: float, value: Any, other: Any) -> Any:
        return value if rng.random() < chance else other

    bits, well, gain, read = (
        int(rng.integers(1, 17)),
        log(1.0, 2e5),
        log(0.01, 20.0),
        log(0.05, 100.0),
    )
    changes: dict[str, Any] = {
        "pixel__prnu": maybe(0.7, log(1e-3, 0.3), 0.0),
        "pixel__prnu_distribution": str(rng.choice(["gaussian", "lognormal"])),
        "pixel__dsnu_e": maybe(0.5, log(0.01, 50.0) / gain, 0.0),
        "readout__dsnu_col": maybe(0.5, log(0.01, 50.0) / gain / well, 0.0),
        "readout__prnu_col": maybe(0.2, log(1e-3, 0.05), 0.0),
        "readout__row_noise_e": maybe(0.2, log(0.05, 30.0), 0.0),
        "readout__reset": maybe(0.1, "hard", "true_cds"),
        "adc__black_level_dn": maybe(0.4, 0.0, rng.uniform(0, 0.5 * 2**bits)),
        "dark_current__fom_na_per_cm2": None,
        "dark_current__rate_e_per_s": log(0.01, 1e5),
        "dark_current__at_temperature_k": 300.0,
        "dark_current__cv": maybe(0.8, log(0.01, 10.0), 0.0),
        "dark_current__distribution": str(
            rng.choice(["lognormal", "gamma", "wald", "gaussian", "logistic"])
        ),
        "source_follower__vv_nonlinearity": maybe(0.25, rng.uniform(0.8, 1.2), 1.0),
        "readout__ve_nonlinearity": maybe(0.25, rng.uniform(0.0, 1.0), 0.0),
        "adc__gamma": maybe(0.25, rng.uniform(0.8, 1.3), None),
    }
    if rng.random() < 0.3:
        low = log(1.0, 1e5)
        uniform = {
            "weight": log(1e-3, 0.3),
            "family": "uniform",
            "low": low,
            "high": low * log(1.1, 30),
            "unit": "e",
        }
        normal = {
            "weight": log(1e-2, 0.3),
            "family": "normal",
            "mean": low,
            "sigma": low * log(0.01, 2.0),
            "unit": "e",
        }
        changes["dark_current__components"] = [maybe(0.5, uniform, normal)]
    if rng.random() < 0.2:
        changes["dark_current__rts_fraction"] = log(1e-2, 1.0)
        changes["dark_current__rts_amplitude_e_per_s"] = log(1.0, 1e6)
        changes["dark_current__rts_duty"] = rng.uniform(0.05, 0.95)
        changes["dark_current__rts_switching"] = 1.0
    if rng.random() < 0.15 and 2 <= bits <= 10:
        changes["adc__dnl_lsb"] = dnl_table(bits, rng.uniform(0.05, 0.6))
    camera = with_read_noise(with_gain(TABLE1, gain, bits, well, **changes), read)
    temperature_k = float(rng.choice([300.0, 300.0, 320.0, 250.0, 77.0]))
    level = maybe(0.1, 0.0, log(min(0.01, well / 10), 3 * well))
    return Case(f"random {number}", camera, level, ms.Exposure(log(1e-4, 10.0), temperature_k))


def full_case(number: int) -> Case:
    """A random camera in light of 0.9 to 2 times what fills its well, or its converter if that is less."""
    case, rng = random_case(number), np.random.default_rng([2026, number])
    try:
        full_e = saturation_e(case.camera)
    except (ms.InputError, ValueError):  # no range of codes, or a curve beyond all numbers
        full_e = case.camera.pixel.full_well_e
    return replace(case, name=f"full {number}", level_e=float(rng.uniform(0.9, 2.0)) * full_e)

"""Three data sheets that every simulator of benchmarks/simulators.py is given, each with its sources."""

from __future__ import annotations

from dataclasses import dataclass

import mitsuba_sensor as ms
from mitsuba_sensor.camera.emva_sheet import EmvaSheet, camera_of_sheet

PITCH_UM, WAVELENGTH_NM, TEMPERATURE_K = 5.0, 550.0, 298.15
UNSAID = {
    "pitch_um": (PITCH_UM, PITCH_UM),
    "size": (1000, 1000),
    "wavelength_nm": WAVELENGTH_NM,
    "dsnu_e": 0.0,
    "prnu_percent": 0.0,
    "dark_e_per_s": 0.0,
}
"""Rows of ``cameras new --emva`` of which a sheet says nothing."""


@dataclass(frozen=True)
class Datasheet:
    """What a maker prints: the figures of EMVA 1288, the bits and the black level.

    read_noise_e : temporal dark noise σ_d.  dark_e_per_s : at 298.15 K.  prnu, qe : fractions.
    longest_s : exposure time of the series in which constant light reaches 1.1 times the saturation.
    """

    what: str
    qe: float
    gain_dn_per_e: float
    read_noise_e: float
    full_well_e: float
    dsnu_e: float
    prnu: float
    dark_e_per_s: float
    bits: int
    black_level_dn: float
    longest_s: float

    @property
    def saturation_e(self) -> float:
        """Full well, or the electrons with which the converter ends."""
        highest = (1 << self.bits) - 1
        return min(self.full_well_e, (highest - self.black_level_dn) / self.gain_dn_per_e)


SHEETS = {
    "industrial CMOS": Datasheet(
        what="an IMX174 camera (fhotolab.fherb.de, 2016); PRNU, DSNU, dark current and black level assumed",
        qe=0.77,
        gain_dn_per_e=1 / 8.16,
        read_noise_e=6.83,
        full_well_e=32691,
        dsnu_e=3.0,
        prnu=0.01,
        dark_e_per_s=5.0,
        bits=12,
        black_level_dn=20,
        longest_s=10.0,
    ),
    "scientific CCD": Datasheet(
        what="EEV 44-82 as ESO tested it (2000); full well, DSNU, dark current and black level assumed",
        qe=0.857,
        gain_dn_per_e=1 / 1.8586,
        read_noise_e=4.0441,
        full_well_e=110_000,
        dsnu_e=2.0,
        prnu=0.007,
        dark_e_per_s=1.0,
        bits=16,
        black_level_dn=500,
        longest_s=60.0,
    ),
    "mobile sensor": Datasheet(
        what="the Pixel 4a of Lyu et al. (arXiv 2201.07411): 76.5 µV/e-; quantum efficiency assumed",
        qe=0.6,
        gain_dn_per_e=0.1707,
        read_noise_e=2.95,
        full_well_e=5600,
        dsnu_e=0.497,
        prnu=0.005444,
        dark_e_per_s=0.274,
        bits=10,
        black_level_dn=64,
        longest_s=10.0,
    ),
}


def camera_of(sheet: Datasheet) -> ms.Camera:
    """Our camera, as ``mitsuba-sensor cameras new --emva`` makes it; the black level is the sheet's."""
    rows = UNSAID | {
        "bits": sheet.bits,
        "qe_percent": 100 * sheet.qe,
        "gain_dn_per_e": sheet.gain_dn_per_e,
        "read_noise_e": sheet.read_noise_e,
        "saturation_e": sheet.full_well_e,
        "dsnu_e": sheet.dsnu_e,
        "prnu_percent": 100 * sheet.prnu,
        "dark_e_per_s": sheet.dark_e_per_s,
        "dark_temperature_c": TEMPERATURE_K - 273.15,
    }
    camera = camera_of_sheet(EmvaSheet(**rows), "of_the_sheet", sheet.what)
    return camera.replace(**{"adc.black_level_dn": sheet.black_level_dn})

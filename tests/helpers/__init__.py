"""Where the tests find the repository, its scenes and the recorded data, and the cameras that the package ships."""

from __future__ import annotations

from pathlib import Path

import mitsuba_sensor

ROOT = Path(__file__).resolve().parents[2]
DATA = ROOT / "tests" / "data"
BENCHMARKS = ROOT / "benchmarks"
CAMERAS = Path(mitsuba_sensor.__file__).parent / "camera" / "cameras"

KEEP = (
    *("photons", "photoelectrons", "dark_electrons", "electrons", "volts"),
    "input_referred_electrons",
)
"""Signals that `expose(keep=…)` returns."""

EACH_KIND = ("konnik_table1", "bayer_2mp", "rgbir_2mp", "eev_44_82")
"""A shipped camera of each kind: monochrome CMOS, two mosaics, CCD. Tests that take long are of these."""

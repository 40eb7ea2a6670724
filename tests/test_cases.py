"""Small inputs on which strangers found the product wrong, each with its right value or the sentence that it gets.

tests/data/cases has the inputs; README.md there and README in each folder tell what happened and what is right.
"""

from __future__ import annotations

import math
import re
import subprocess
import sys
import tempfile
from collections.abc import Callable

import pytest
from helpers import DATA

import mitsuba_sensor as ms
from mitsuba_sensor.output.importers.import_camera import import_camera
from mitsuba_sensor.stages.gains import gain_dn_per_e

CASES = DATA / "cases"
Check = Callable[[], None]
CHECKS: dict[str, Check] = {}
"""Name of a case, the beginning of its file's or folder's name → what must hold."""

PENDING = {
    *("01", "02", "03", "04", "05", "07", "09", "11", "12", "13"),
    *("2026-11-29_03", "2026-11-29_04"),
    *("2026-11-29_08", "2026-11-29_09", "2026-11-29_10", "2026-11-29_11", "2026-11-29_12"),
    "2026-11-29_16",
}
"""Cases that have no row yet."""


def case(name: str) -> Callable[[Check], Check]:
    """Enter the decorated check into the table."""

    def enter(check: Check) -> Check:
        CHECKS[name] = check
        return check

    return enter


@case("2026-11-29_01")
def apertures_of_a_zemax_design() -> None:
    """A disk of 3 of 5 mm radius takes 9/25 of the light, and a hole of 3 mm is f/8.32, where 9/25 are left.

    The aberration of the pupil is 0.3 % at f/5, the noise of the render 0.05 %.
    """
    scene = """<scene version="3.0.0"><integrator type="direct"/><sensor type="perspective"><film type="hdrfilm">
        <integer name="width" value="3"/><integer name="height" value="3"/></film></sensor>
        <emitter type="constant"><spectrum name="radiance" value="1e-3"/></emitter></scene>"""

    def light(name: str, f_number: float) -> float:
        lens = str(CASES / "2026-11-29_01_zemax_clap" / name)
        fields = {"lens.prescription": lens, "lens.f_number": f_number, "lens.focus_m": 1e3}
        camera = ms.load_camera("konnik_table1").replace(**fields)
        options = {"spp": 1024, "wavelength_nm": 587.56, "denoise": False, "progress": False}
        return float(ms.render(scene, camera, ms.Exposure(0.1), **options).data.mean())

    plain = light("plain.zmx", 5.0)
    assert light("obsc3.zmx", 5.0) == pytest.approx(0.64 * plain, rel=0.005)
    with pytest.raises(ms.InputError, match=r"opens to f/8\.32 at most"):
        light("clap3.zmx", 5.0)
    assert light("clap3.zmx", 8.32) == pytest.approx(0.36 * plain, rel=0.005)


@case("2026-11-29_05")
def tuning_file_with_a_comma_before_a_bracket() -> None:
    folder = CASES / "2026-11-29_05_libcamera_trailing_comma"
    for name in ("tuning.json", "without_comma.json"):
        camera = import_camera(folder / name)
        assert gain_dn_per_e(camera) == pytest.approx(2.5**2 / 16, rel=1e-5)
        assert camera.adc.black_level_dn == 200
        assert "pisp (Raspberry Pi 5)" in camera.description


@case("2026-11-29_06")
def tuning_file_of_a_monochrome_sensor() -> None:
    camera = import_camera(CASES / "2026-11-29_06_libcamera_mono" / "sensor_mono.json")
    assert list(camera.quantum_efficiency.curves) == ["mono"]
    assert "a monochrome sensor" in camera.sources["quantum_efficiency.curves"]
    assert "bcm2835 (vc4, Raspberry Pi 0 to 4)" in camera.sources["adc.full_scale_v"]


@case("2026-11-29_14")
def flat_fields_under_light_that_flickers_before_a_rolling_shutter() -> None:
    """Made with K 0.12 DN/e-, 7 e- of read noise and PRNU of 1 % in the pixels; the figures of rows are refused."""
    with tempfile.TemporaryDirectory() as folder:
        make = CASES / "2026-11-29_14_flicker_prnu" / "make.py"
        subprocess.run([sys.executable, make], cwd=folder, check=True)
        (measured,) = ms.lab.measure_bench(ms.lab.read_bench(folder))
    figures = measured.figures
    for symbol, right in (("K", 0.12), ("PRNU1288_pixel", 1.0), ("σ_d", 7.0)):
        assert figures[symbol].covers(right)
        assert figures[symbol].high - figures[symbol].low < 0.04 * right
    for symbol in ("PRNU1288", "PRNU1288_row", "σ/µ"):
        assert math.isnan(figures[symbol].value)
        assert "flickers before a rolling shutter" in figures[symbol].note
    assert any("flickers before a rolling shutter" in note for note in measured.notes)


def names_of_inputs() -> set[str]:
    """The numbers that inputs begin with: 01, 2026-11-29_01."""
    names = (re.match(r"(2026-11-29_)?\d\d(?=_)", path.name) for path in CASES.iterdir())
    return {name.group() for name in names if name}


def test_each_input_has_a_row() -> None:
    assert {*CHECKS} | PENDING == names_of_inputs()


@pytest.mark.parametrize("name", sorted(CHECKS))
def test_case(name: str) -> None:
    CHECKS[name]()

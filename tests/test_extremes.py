"""Stiff and extreme cases: every one gives the right number or one clear sentence, never a NaN, a hang or a wrap."""

from __future__ import annotations

import json
import math
import warnings
from typing import Any

import numpy as np
import pytest

import mitsuba_sensor as ms
from mitsuba_sensor.data.files import to_json
from mitsuba_sensor.engine.llvm import backend_problem
from mitsuba_sensor.sensor.chain import pedestal_dn

CAMERA = ms.load_camera("konnik_table1")
EXPOSURE = ms.Exposure(0.1)
LIGHT = np.full((3, 4), 1000.0)


@pytest.fixture(autouse=True)
def no_warnings() -> Any:
    """NumPy's "invalid value encountered" would be a NaN on its way."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        yield


ENGINE: dict[str, Any] = {}
ENGINES = {
    "numpy": {"engine": "numpy"},
    "drjit": {"engine": "drjit"},
    "float64": {"engine": "numpy", "precision": "float64"},
}


@pytest.fixture(params=ENGINES, autouse=True)
def every_engine(request: pytest.FixtureRequest) -> None:
    """All of this is asked of every engine."""
    if request.param == "drjit" and (problem := backend_problem("llvm")):
        pytest.skip(problem)
    ENGINE.clear()
    ENGINE.update(ENGINES[request.param])


def raw(light: Any, camera: ms.Camera = CAMERA, exposure: ms.Exposure = EXPOSURE, **more: Any) -> ms.Frames:
    """A frame that went through everything: finite signals, codes in range, a report and a plan that are JSON."""
    frames = ms.expose(light, camera, exposure, keep=("electrons", "volts"), **(ENGINE | more))
    for signal in (frames.electrons, frames.volts):
        assert np.isfinite(signal).all()
    assert frames.electrons.min() >= 0 and frames.electrons.max() <= camera.pixel.full_well_e
    assert frames.digital.max() < 2**camera.adc.bits
    json.loads(to_json(frames.report))
    json.loads(to_json(ms.plan(camera, exposure, light, wavelengths_nm=more.get("wavelengths_nm")).to_dict()))
    return frames


@pytest.mark.parametrize("name", ms.list_cameras())
@pytest.mark.parametrize("light", [1e-320, 1e-12, 1e-6, 1e12, 1e30, 1e150])
def test_any_amount_of_light_gives_a_frame(name: str, light: float) -> None:
    """From subnormal to absurd; above the full well every pixel that sees the light at all reads the full well."""
    camera = ms.load_camera(name)
    electrons = raw(np.full((4, 6), light), camera, ms.Exposure(0.1, 77.0)).electrons[0]
    seen = camera.qe([camera.quantum_efficiency.reference_nm])[camera.filter_index((4, 6)), 0] > 0
    assert seen.sum() >= 18 and not electrons[~seen].any()
    if light < 1e-9:
        assert not electrons.any()
    if light >= 1e12:
        np.testing.assert_array_equal(electrons[seen], camera.pixel.full_well_e)


def test_no_light_and_no_time_is_exactly_no_electron() -> None:
    assert not raw(np.zeros((50, 50)), exposure=ms.Exposure(0.0, 400.0)).electrons.any()


def test_infinite_light_saturates_its_own_pixel_only() -> None:
    light = LIGHT.copy()
    light[1, 2] = np.inf
    raw(light, CAMERA.replace(**{"pixel.prnu": 0.0}))
    with_inf, without = raw(light), raw(LIGHT)
    assert with_inf.electrons[0, 1, 2] == CAMERA.pixel.full_well_e and with_inf.digital[0, 1, 2] == 4095
    keep = np.isfinite(light)
    np.testing.assert_array_equal(with_inf.digital[:, keep], without.digital[:, keep])


def test_infinite_light_in_a_band_that_the_sensor_cannot_see_is_no_light() -> None:
    """QE is 0 beyond the curve: ∞·0 = 0, and the visible band counts alone."""
    bands = np.stack([np.full((2, 2), np.inf), np.full((2, 2), 500.0)], axis=-1)
    seen = raw(bands, wavelengths_nm=[1500.0, 550.0])
    np.testing.assert_array_equal(seen.electrons, raw(np.full((2, 2), 500.0)).electrons)


@pytest.mark.parametrize(
    ("bad", "kind"), [(np.nan, "NaN"), (-1.0, "negative"), (-1e-300, "negative"), (-np.inf, "negative")]
)
def test_nan_and_negative_photons_are_refused_with_their_number_and_the_first_place(bad: float, kind: str) -> None:
    light = LIGHT.copy()
    light[1, 2] = light[2, 0] = bad
    with pytest.raises(ms.InputError, match=rf"{kind} in 2 place\(s\), first at \(1, 2\)"):
        ms.expose(light, CAMERA, EXPOSURE)
    with pytest.raises(ValueError, match=kind):
        ms.plan(CAMERA, EXPOSURE, light)


@pytest.mark.parametrize("time_s", [math.nan, math.inf, -math.inf, -1e-300, -1.0, 1.1e12, "0.1", None, [0.1]])
def test_an_impossible_exposure_time_is_refused(time_s: Any) -> None:
    with pytest.raises(ms.InputError, match=r"time_s is .*; it must be"):
        ms.Exposure(time_s)


@pytest.mark.parametrize("kelvin", [math.nan, math.inf, -1e-9, -273.15, 1.001e4, 1e9, "cold"])
def test_an_impossible_temperature_is_refused(kelvin: Any) -> None:
    with pytest.raises(ms.InputError, match=r"temperature_k is .*; it must be"):
        ms.Exposure(0.1, kelvin)


@pytest.mark.parametrize("name", ms.list_cameras())
@pytest.mark.parametrize("time_s", [0.0, 1e-12, 1e6, 1e12])
def test_any_exposure_time_gives_a_frame(name: str, time_s: float) -> None:
    camera = ms.load_camera(name)
    electrons = raw(np.zeros((4, 6)), camera, ms.Exposure(time_s)).electrons
    if time_s <= 1e-12:
        assert not electrons.any()
    if time_s >= 1e6:
        np.testing.assert_array_equal(electrons, camera.pixel.full_well_e)


@pytest.mark.parametrize("name", ms.list_cameras())
@pytest.mark.parametrize("kelvin", [0.0, 5e-324, 4.0, 77.0, 300.0, 400.0, 600.0, 1e4])
def test_any_temperature_gives_a_frame(name: str, kelvin: float) -> None:
    camera = ms.load_camera(name).replace(**{"readout.reset": "hard", "adc.pedestal_dn": 100})
    frames = raw(LIGHT, camera, ms.Exposure(0.1, kelvin))
    if kelvin >= 1e4:
        np.testing.assert_array_equal(frames.electrons, camera.pixel.full_well_e)


@pytest.mark.parametrize("cv", [0.0, 0.01, 0.4, 1.0, 10.0])
@pytest.mark.parametrize("pattern", ["gaussian", "lognormal"])
def test_any_width_of_the_dark_pattern_gives_a_frame(pattern: str, cv: float) -> None:
    """Means are tested in test_laws; here: through the whole chain, for ten minutes, at 400 K."""
    camera = CAMERA.replace(**{"dark_current.pattern": pattern, "dark_current.cv": cv})
    for exposure in (ms.Exposure(1e-3), ms.Exposure(600.0, 400.0)):
        raw(np.zeros((20, 20)), camera, exposure)


@pytest.mark.parametrize("full_well_e", [1.0, 33_000.0, 5e7])
def test_any_full_well_is_cut_exactly(full_well_e: float) -> None:
    """Above 2^24 = 16.8 million electrons a float32 could not count; float64 does."""
    camera = CAMERA.replace(**{"pixel.full_well_e": full_well_e, "adc.bits": 16})
    light = np.geomspace(full_well_e / 100, full_well_e * 100, 200).reshape(10, 20)
    if full_well_e > 2**24 and ENGINE["engine"] == "drjit":
        with pytest.raises(ms.InputError, match="take numpy, or precision float32"):
            raw(light, camera, ms.Exposure(0.0))
        return
    electrons = raw(light, camera, ms.Exposure(0.0)).electrons
    assert electrons.max() == full_well_e
    np.testing.assert_array_equal(electrons, np.floor(electrons))
    if full_well_e > 2**24:
        assert np.any(electrons % 2 == 1)


@pytest.mark.parametrize(
    ("bits", "kind"),
    [(1, "uint8"), (8, "uint8"), (9, "uint16"), (12, "uint16"), (16, "uint16"), (17, "uint32"), (24, "uint32")],
)
def test_any_number_of_bits_uses_its_whole_range_and_the_smallest_type(bits: int, kind: str) -> None:
    camera = CAMERA.replace(**{"adc.bits": bits})
    light = np.concatenate([np.zeros((5, 40)), np.full((5, 40), 1e9)])
    digital = raw(light, camera, ms.Exposure(0.0)).digital
    assert digital.dtype == kind
    assert digital.max() == 2**bits - 1 and digital.min() <= (2**bits - 1) // 8


def test_more_than_24_bits_and_less_than_one_are_refused() -> None:
    for bits in (0, 25, -1):
        with pytest.raises(ms.InputError, match="bits"):
            CAMERA.replace(**{"adc.bits": bits})


@pytest.mark.parametrize("ratio", np.logspace(-9, 9, 7))
def test_any_cds_timing_gives_a_frame(ratio: float) -> None:
    """t_s/τ_D from 1e-9 to 1e9; closed forms are tested in test_cds."""
    camera = CAMERA.replace(**{"source_follower.cds_dominant_s": 1e-6 / ratio, "source_follower.rtn_uv": 100.0})
    raw(LIGHT, camera)


@pytest.mark.parametrize("tau", [1e-9, 1e-6 * (1 - 1e-9), 1e-6, 1e-6 * (1 + 1e-9), 1e-3, 1.0])
def test_any_telegraph_time_constant_gives_a_frame(tau: float) -> None:
    """1e-6 s is the removable singularity, twice the dominant time."""
    raw(LIGHT, CAMERA.replace(**{"source_follower.rtn_s": tau, "source_follower.rtn_uv": 200.0}))


@pytest.mark.parametrize("coupling", [0.0, 5e-324, 0.25, 0.4999])
def test_allowed_column_couplings_give_a_frame(coupling: float) -> None:
    raw(LIGHT, CAMERA.replace(**{"readout.column_coupling": coupling}))


@pytest.mark.parametrize("coupling", [0.5, 0.49991, -1e-9, 1.0])
def test_a_column_coupling_of_a_half_is_refused(coupling: float) -> None:
    """At a = 1/2 the stripes are a random walk without a variance."""
    with pytest.raises(ms.InputError, match="column_coupling"):
        CAMERA.replace(**{"readout.column_coupling": coupling})


@pytest.mark.parametrize("shape", [(1, 1), (1, 5000), (5000, 1), (2, 3)])
def test_a_frame_of_any_shape_is_a_crop_of_a_bigger_one(shape: tuple[int, int]) -> None:
    frames = raw(np.full(shape, 500.0))
    assert frames.digital.shape == (1, *shape)
    corner = tuple(min(n, 2) for n in shape)
    small = raw(np.full(corner, 500.0))
    np.testing.assert_array_equal(small.digital, frames.digital[:, : corner[0], : corner[1]])


@pytest.mark.parametrize("prnu", [1e-200, 1e-9, 0.005, 10.0])
def test_any_prnu_gives_a_frame(prnu: float) -> None:
    raw(LIGHT, CAMERA.replace(**{"pixel.prnu": prnu}))


SMALLEST = dict.fromkeys(
    (
        "pixel.pitch_x_um",
        "source_follower.cds_sample_s",
        "source_follower.cds_dominant_s",
        "source_follower.rtn_s",
        "source_follower.gain",
        "readout.sense_gain_uv_per_e",
        "readout.cds_gain",
        "readout.v_ref_v",
        "adc.full_scale_v",
    ),
    1e-30,
) | {"pixel.full_well_e": 1.0}
"""Fields that something is divided by, and the smallest number that they may be."""


@pytest.mark.parametrize("dotted", SMALLEST)
def test_a_field_that_divides_is_refused_before_it_overflows_and_its_smallest_value_gives_a_frame(dotted: str) -> None:
    for tiny in (5e-324, 1e-320, 1e-150, 0.99 * SMALLEST[dotted]):
        with pytest.raises(ms.InputError, match=rf"{dotted} is .*; it must be greater than or equal to"):
            CAMERA.replace(**{dotted: tiny})
    raw(LIGHT, CAMERA.replace(**{dotted: SMALLEST[dotted]}))


@pytest.mark.parametrize("tiny", [5e-324, 1e-150, 1e-9])
@pytest.mark.parametrize("pattern", ["gaussian", "lognormal", "gamma", "wald", "logistic"])
def test_a_pattern_of_next_to_no_width_is_none(pattern: str, tiny: float) -> None:
    """Shapes are cv⁻² and would overflow; variances are differences and would cancel."""
    changes = {"dark_current.pattern": pattern, "dark_current.cv": tiny, "adc.pedestal_dn": 10.0}
    frames = raw(LIGHT, CAMERA.replace(**changes))
    without = raw(LIGHT, CAMERA.replace(**{"dark_current.cv": 0.0, "adc.pedestal_dn": 10.0}))
    np.testing.assert_array_equal(frames.digital, without.digital)
    line = next(line for line in frames.report["stages"] if line["name"] == "dark current")
    before = next(line for line in frames.report["stages"] if line["name"] == "prnu")
    added = line["sigma_fixed_expected"] ** 2 - before["sigma_fixed_expected"] ** 2
    assert added == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize("alpha", [5e-324, 1e-200, 1e-100, 1e-12])
def test_a_node_that_next_to_does_not_bend_is_linear(alpha: float) -> None:
    straight, bent = raw(LIGHT), raw(LIGHT, CAMERA.replace(**{"readout.ve_nonlinearity": alpha}))
    np.testing.assert_allclose(bent.volts, straight.volts, rtol=1e-9 if "precision" in ENGINE else 1e-6)


def test_twelve_megapixels_go_through_the_same_code() -> None:
    """4000 × 3000 in the dark of 77 K: read noise, stripes and converter, with the right mean, in seconds."""
    camera = CAMERA.replace(**{"sensor.columns": 4000, "sensor.rows": 3000, "pixel.prnu": 0.0})
    digital = ms.expose(0.0, camera, ms.Exposure(0.1, 77.0)).digital
    assert digital.shape == (1, 3000, 4000) and digital.dtype == np.uint16
    assert digital.mean() == pytest.approx(pedestal_dn(camera), abs=5 * 4.1 / math.sqrt(4000))

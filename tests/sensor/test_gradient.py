"""Derivatives of frames: values unchanged; means against frames with equal random bits.

Where the noise does not hide the steps of the converter, and next to the clips, both are compared with the mean and the
variance that an enumeration of the counts gives (helpers/expected_codes.py): both are right at any noise.

Seeds are fixed. A comparison fails by chance beyond 5 standard errors, 6e-7 of the time; there are about 500.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest
from helpers.expected_codes import bare_camera, mean_and_variance, slopes
from helpers.marks import exhaustive, one_in

import mitsuba_sensor as ms
from mitsuba_sensor import differentiable
from mitsuba_sensor.core.drjit_backend import DrJitBackend
from mitsuba_sensor.core.llvm import backend_problem

problem = backend_problem("llvm")
pytestmark = pytest.mark.skipif(problem is not None, reason=f"derivatives need LLVM: {problem}")

EXPOSURE = ms.Exposure(0.1, 298.15)
PLAIN = ms.load_camera("konnik_table1")
RICH = PLAIN.replace(
    **{
        "source_follower.white_nv_per_rthz": None,
        "source_follower.corner_hz": 0.0,
        "source_follower.read_noise_e": 6.0,
        "source_follower.gain": 0.9,
        "source_follower.vv_nonlinearity": 1.02,
        "dark_current.fom_na_per_cm2": None,
        "dark_current.rate_e_per_s": 20.0,
        "dark_current.at_temperature_k": 298.15,
        "dark_current.cv": 0.2,
        "pixel.dsnu_e": 3.0,
        "readout.reset": "hard",
        "readout.ktc_residual": 0.05,
        "readout.prnu_col": 0.004,
        "readout.dsnu_col": 0.0002,
        "readout.ve_nonlinearity": 0.05,
        "adc.full_scale_v": 0.165,
        "adc.black_level_dn": 100.0,
        "adc.gamma": 1.02,
    }
)
"""Nearly everything that a camera has, and a black level that does not jump."""

QE = 0.6
PARAMETERS = (
    "photons",
    "readout.sense_gain_uv_per_e",
    "pixel.prnu",
    "pixel.full_well_e",
    "pixel.dsnu_e",
    "dark_current.rate_e_per_s",
    "dark_current.cv",
    "source_follower.read_noise_e",
    "source_follower.gain",
    "source_follower.vv_nonlinearity",
    "readout.ktc_residual",
    "readout.dsnu_col",
    "readout.prnu_col",
    "readout.v_ref_v",
    "readout.ve_nonlinearity",
    "adc.full_scale_v",
    "adc.black_level_dn",
    "adc.gamma",
    "exposure.time_s",
    "exposure.temperature_k",
)
LEVELS = (exhaustive(3), 1000)
"""Electrons."""
SHAPE = (16, 1024)
SURE = 5.0


def value_of(name: str, camera: ms.Camera = RICH, exposure: ms.Exposure = EXPOSURE) -> float:
    found: Any = exposure if name.startswith("exposure.") else camera
    for part in name.removeprefix("exposure.").split("."):
        found = getattr(found, part)
    return found


def changed(
    name: str, factor: float, camera: ms.Camera = RICH
) -> tuple[float, ms.Camera, ms.Exposure]:
    """(factor for the photons, camera, exposure), one of them changed."""
    if name == "photons":
        return factor, camera, EXPOSURE
    value = value_of(name, camera) * factor
    if name.startswith("exposure."):
        return 1.0, camera, replace(EXPOSURE, **{name.removeprefix("exposure."): value})
    return 1.0, camera.replace(**{name: value}), EXPOSURE


@cache
def sampled(level: int) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """Digital numbers (H, W) of flat light of ``level`` electrons, and their derivatives by ln(parameter)."""
    photons = np.full(SHAPE, level / QE)
    frame = differentiable(photons, RICH, EXPOSURE, PARAMETERS, seed=4, serial=9).frame(2)
    frame.store()
    slopes = {name: frame.forward(name).astype(float) for name in PARAMETERS}
    scale = {name: value_of(name) if name != "photons" else level / QE for name in PARAMETERS}
    return frame.codes.astype(float), {
        name: slope * scale[name] for name, slope in slopes.items()
    }


def by_columns(x: np.ndarray) -> tuple[float, float]:
    """Mean and its standard error, when pixels of a column share offsets and gains."""
    columns = x.mean(axis=0)
    return float(columns.mean()), float(columns.std() / np.sqrt(columns.size))


@pytest.mark.parametrize("level", LEVELS)
@pytest.mark.parametrize("name", PARAMETERS)
def test_the_mean_follows_frames_with_equal_random_bits(name: str, level: int) -> None:
    step = 1e-3 if name == "exposure.temperature_k" else 1e-2
    ends = []
    for sign in (1, -1):
        factor, camera, exposure = changed(name, 1 + sign * step)
        photons = np.full(SHAPE, level / QE * factor)
        shot = ms.expose(
            photons, camera, exposure, seed=4, serial=9, first_frame=2, engine="drjit"
        )
        ends.append(shot.digital[0].astype(float))
    digital, slopes = sampled(level)
    found, error = by_columns((ends[0] - ends[1]) / (2 * step) - slopes[name])
    error += 1 / (
        2 * step * digital.size
    )  # no pixel may have changed its code where one should
    assert abs(found) < SURE * error + 2e-3 * abs(slopes[name].mean()) + 1e-6 * digital.mean()


@pytest.mark.parametrize("name", ["photons", "pixel.prnu"])
def test_backward_adds_up_what_forward_says(name: str) -> None:
    frames = differentiable(
        np.full((37, 41), 900.0), RICH, EXPOSURE, PARAMETERS, seed=4, serial=9
    )
    frame = frames.frame()
    weights = np.linspace(-1.0, 2.0, 37 * 41, dtype=np.float32)
    found = frame.backward(frame.digital * type(frame.digital)(weights))
    again = frames.frame()
    again.store()
    squares = again.backward((again.digital - 150.0) * (again.digital - 150.0) * 0.5)
    slope = frame.forward(name).astype(float)
    digital = frame.codes.astype(float)
    for derivative, weight in (
        (found[name], weights.reshape(37, 41)),
        (squares[name], digital - 150.0),
    ):
        wanted = slope * weight if name == "photons" else np.sum(slope * weight)
        assert derivative == pytest.approx(
            wanted, rel=1e-5, abs=1e-6 * np.abs(slope * weight).sum()
        )


COLOURS = {
    "quantum_efficiency.wavelengths_nm": [400.0, 550.0, 700.0],
    "quantum_efficiency.curves": {"R": [0.1, 0.3, 0.5], "G": [0.2, 0.6, 0.2]},
    "quantum_efficiency.tile": [["R", "G"], ["G", "R"]],
}
PART = {"weight": 0.1, "family": "normal", "mean": 18.0, "sigma": 4.0, "unit": "dn"}
CAMERAS: dict[str, dict[str, Any]] = {
    "wald, steps": {
        "dark_current.distribution": "wald",
        "adc.dnl_lsb": {"101": -1.0, "140": 0.7},
        "dark_current.components": [PART],
    },
    "gamma, yield": {
        "dark_current.distribution": "gamma",
        "quantum_efficiency.quantum_yield": [2.0, 1.0],
    },
    "ar, colours": {
        "dark_current.distribution": "ar",
        "dark_current.coupling": 0.25,
        "pixel.prnu_distribution": "lognormal",
        "readout.dsnu_row": 1e-4,
        "readout.dsnu_row_coupling": 0.2,
        **COLOURS,
    },
}


@pytest.mark.parametrize(
    "kind", ["ar, colours", exhaustive("gamma, yield"), exhaustive("wald, steps")]
)
def test_values_are_those_of_expose_bit_by_bit(kind: str) -> None:
    camera = RICH.replace(**CAMERAS[kind])
    shape = (45, 67)
    photons = np.geomspace(1.0, 6e4, shape[0] * shape[1]).reshape(shape)
    photons[0, :5] = 0.0, 1e-12, 1e9, 1e300, 3.0
    given: dict[str, Any] = {"seed": 5, "serial": 3, "origin": (6, 2)}
    if kind == "ar, colours":
        given |= {"wavelengths_nm": [500.0, 600.0], "maps": {"prnu": np.full((1, 1), 1.01)}}
        photons = np.stack([photons, photons / 3], axis=-1)
    if kind == "gamma, yield":
        given |= {"wavelengths_nm": [450.0]}
    wanted = ms.expose(photons, camera, EXPOSURE, frames=3, engine="drjit", **given).digital
    names = [name for name in PARAMETERS if name != "pixel.prnu" or "maps" not in given]
    frames = differentiable(photons, camera, EXPOSURE, names, **given)
    for index in (2, 0):
        frame = frames.frame(index)
        derivatives = frame.backward(frame.digital)
        assert np.array_equal(frame.codes, wanted[index])
        assert all(np.isfinite(x).all() for x in derivatives.values()), derivatives
        assert derivatives["photons"].shape == photons.shape
        assert np.array_equal(frames.frame(index).codes, wanted[index])


WIDE = RICH.replace(
    **{
        "dark_current.rate_e_per_s": None,
        "dark_current.at_temperature_k": None,
        "dark_current.fom_na_per_cm2": 1.0,
        "dark_current.diffusion_fom_na_per_cm2": 0.3,
        "dark_current.components": [PART],
        "pixel.prnu_distribution": "ar",
        "pixel.prnu_coupling": 0.25,
        "readout.dsnu_col_coupling": 0.25,
        "readout.dsnu_row": 2e-3,
        "readout.dsnu_residual": 0.5,
        "source_follower.read_noise_e": None,
        "source_follower.white_nv_per_rthz": 150.0,
        "source_follower.corner_hz": 1e6,
        "source_follower.rtn_uv": 20.0,
        "source_follower.noisy_pixel_factor": 2.0,
        "readout.cds_gain": 1.1,
    }
)
FIELDS = [
    f"{section}.{field}"
    for section, table in WIDE.model_dump().items()
    if isinstance(table, dict) and section != "lens"
    for field, value in table.items()
    if isinstance(value, float) and value
]
NO_SLOPE = (
    "dark_current.rts_activation_ev",
    "dark_current.rts_duty",
    "dark_current.rts_switching",
    "dark_current.rts_switching_activation_ev",
    "pixel.fill_factor",
    "pixel.hit_e",
    "quantum_efficiency.fano_factor",
    "source_follower.rtn_pixel_duty",
    "source_follower.rtn_pixel_switching",
)
"""Fields on which no stage of this camera depends."""

WIDE_LIGHT = np.full((48, 64), 8000.0)


@pytest.mark.parametrize("name", one_in(9, FIELDS))
def test_every_field_moves_every_pixel_as_its_derivative_says_or_is_refused(name: str) -> None:
    if name in NO_SLOPE:
        with pytest.raises(ms.InputError, match="does not depend on it smoothly"):
            differentiable(WIDE_LIGHT[:1, :1], WIDE, EXPOSURE, name)
        return
    step = 5e-3
    ends = [changed(name, 1 + sign * step, WIDE)[1] for sign in (1, -1)]
    shots = [
        ms.expose(WIDE_LIGHT, camera, EXPOSURE, engine="drjit").digital[0].astype(float)
        for camera in ends
    ]
    slope = differentiable(WIDE_LIGHT, WIDE, EXPOSURE, name).frame().forward(name)
    missed = shots[0] - shots[1] - 2 * step * value_of(name, WIDE) * slope
    assert (
        np.sqrt(np.mean(missed**2)) < 0.75
    )  # two roundings: 0.41; counts of electrons jump as well


def test_what_is_clipped_does_not_move() -> None:
    names = ("photons", "pixel.prnu", "pixel.full_well_e", "adc.full_scale_v")
    full = differentiable(np.full((32, 32), 1e6), RICH, EXPOSURE, names).frame()
    found = full.backward(full.digital)
    assert not found["photons"].any()
    assert found["pixel.prnu"] == 0
    assert found["pixel.full_well_e"] / 1024 == pytest.approx(theory_full_well(), rel=0.01)
    narrow = RICH.replace(**{"adc.full_scale_v": 0.05})
    top = differentiable(np.full((32, 32), 4e4), narrow, EXPOSURE, names).frame()
    assert not any(np.any(x) for x in top.backward(top.digital).values())
    low = differentiable(
        np.full((32, 32), 1.0), RICH.replace(**{"adc.black_level_dn": 0.0}), EXPOSURE, names
    ).frame()
    assert np.all(low.forward("photons") >= 0)


def theory_full_well() -> float:
    ends = [
        ms.expose(np.full((32, 32), 1e6), changed("pixel.full_well_e", 1 + x)[1], EXPOSURE)
        for x in (0.01, -0.01)
    ]
    step = 0.02 * value_of("pixel.full_well_e")
    return float(ends[0].clean.mean() - ends[1].clean.mean()) / step


ENDS: dict[str, tuple[float, dict[str, float]]] = {
    "centre": (3.0, {"adc__black_level_dn": 64.0}),
    "edge": (40.0, {"adc__black_level_dn": 16.5}),
    "lower clip": (4.0, {"adc__black_level_dn": 0.3}),
    "upper clip": (1940.0, {"adc__black_level_dn": 16.0, "adc__bits": 8}),
    "full well": (1020.0, {"adc__black_level_dn": 16.0, "pixel__full_well_e": 1000.4}),
    "3 DN/e-": (5.0, {"adc__black_level_dn": 9.3, "dn_per_e": 3.0}),
}
BEHIND = (
    "readout.sense_gain_uv_per_e",
    "source_follower.read_noise_e",
    "adc.black_level_dn",
    "pixel.full_well_e",
)


@pytest.mark.parametrize("end", ENDS)
@pytest.mark.parametrize("sigma_dn", [0.3, exhaustive(1.05)])
def test_at_edges_and_clips_the_slopes_are_those_of_an_enumeration(
    end: str, sigma_dn: float
) -> None:
    """Slopes of mean and variance of the code by a doubling, within 3 %, or 0.3 % of the variance where few electrons
    near a clip count as normal, or 1.5 DN (1.2 % of the full well) where noise below 0.5 DN meets a full well between
    two codes: its electrons are summed in steps of a quarter of their noise."""
    electrons, fields = ENDS[end]
    camera = bare_camera(sigma_dn, **fields)
    photons = np.full((2, 2), electrons / QE)
    law = differentiable(photons, camera, EXPOSURE, ("photons", *BEHIND)).slopes
    mean, variance = mean_and_variance(camera, electrons)
    assert law.values[0] == pytest.approx(mean, abs=0.01 * np.sqrt(variance + 1 / 12))
    for name in ("photons", *BEHIND):
        slope = law.by_light if name == "photons" else law.by_name[name]
        scale = electrons if name == "photons" else value_of(name, camera)
        for found, exact in zip(
            scale * slope[:, 0, 0], slopes(camera, electrons, name), strict=True
        ):
            room = max(0.003 * variance, 0.1 if sigma_dn > 1 else 1.5)
            assert found == pytest.approx(exact, rel=0.03, abs=room), name


def test_derivatives_of_codes_and_of_their_squares_have_the_right_mean() -> None:
    """Over a quarter of a million pixels in 20 electrons, within 5 standard errors."""
    camera = bare_camera(0.3, adc__black_level_dn=2.0)
    mean, _ = mean_and_variance(camera, 20.0)
    frame = differentiable(
        np.full((512, 512), 20.0 / QE), camera, EXPOSURE, ("photons", *BEHIND)
    ).frame()
    for name in ("photons", BEHIND[0], BEHIND[1]):
        scale = 20.0 / QE if name == "photons" else value_of(name, camera)
        slope, exact = frame.forward(name).astype(float) * scale, slopes(camera, 20.0, name)
        for moved, what in zip((slope, 2 * (frame.codes - mean) * slope), exact, strict=True):
            assert abs(moved.mean() - what) < SURE * moved.std() / 512 + 2e-3 * abs(what) + 1e-3


def test_strips_of_rows_have_the_derivatives_of_the_whole(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    names = ("photons", "pixel.prnu", "readout.sense_gain_uv_per_e")
    camera = bare_camera(0.2).replace(**{"pixel.prnu": 0.01})
    light = np.linspace(50.0, 900.0, 37 * 41).reshape(37, 41)
    frames = differentiable(light, camera, EXPOSURE, names, seed=4, serial=9, origin=(6, 2))
    target = np.float32(30.0) + np.arange(37 * 41, dtype=np.float32).reshape(37, 41) % 7

    def loss(digital: Any, rows: slice) -> Any:
        miss = digital - type(digital)(target[rows].ravel())
        return miss * miss

    frame = frames.frame(3)
    whole = frame.backward(loss(frame.digital, slice(None)))
    one_strip = frames.backward(loss, 3)
    monkeypatch.setattr(DrJitBackend, "strip_pixels", 5 * 41)
    assert [rows.start for rows, _ in frames.strips()] == list(range(0, 37, 5))
    found = frames.backward(loss, 3)
    np.testing.assert_allclose(found["photons"], whole["photons"], rtol=1e-5)
    np.testing.assert_array_equal(one_strip["photons"], whole["photons"])
    for name in names[1:]:
        assert found[name] == pytest.approx(whole[name], rel=1e-5)
    codes = [strip.frame(3).codes for _, strip in frames.strips()]
    assert np.array_equal(np.concatenate(codes), frame.codes)

"""Clean frames: expectation and variance of the frames of one camera, against closed forms and averages of frames."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest
from helpers.expected_codes import bare_camera, mean_and_variance

import mitsuba_sensor as ms
from mitsuba_sensor.stages.gains import gain_dn_per_e

SHAPE, FRAMES, EXPOSURE = (16, 24), 250, ms.Exposure(0.1)
TABLE1 = ms.load_camera("konnik_table1")
QUIET = {
    "source_follower.white_nv_per_rthz": None,
    "source_follower.read_noise_e": 0.8,
    "readout.reset": "true_cds",
    "adc.black_level_dn": 20,
}
RTS = {
    "dark_current.rts_fraction": 0.3,
    "dark_current.rts_amplitude_e_per_s": 3000.0,
    "dark_current.rts_switching": 1.0,
    "dark_current.rts_duty": 0.3,
}
OWN = {
    "source_follower.rtn_pixel_fraction": 0.3,
    "source_follower.rtn_pixel_amplitude_e": 60.0,
    "source_follower.read_noise_cv": 0.5,
    "readout.prnu_col": 0.03,
}
CURVED = {
    "source_follower.vv_nonlinearity": 1.05,
    "adc.gamma": 1.04,
    "readout.ve_nonlinearity": 1.0,
}
CAMERAS: dict[str, Any] = {
    "0.1 DN": TABLE1.replace(**QUIET),
    "all pixels differ": TABLE1.replace(**RTS, **OWN),
    "curved": TABLE1.replace(**CURVED, **QUIET),
    "bayer_2mp": ms.load_camera("bayer_2mp"),
}
CASES = [("0.1 DN", 0.002), ("all pixels differ", 0.0), ("curved", 0.995), ("bayer_2mp", 0.995)]


def photons_of(camera: ms.Camera, share: float) -> Any:
    """So large a share of what fills the well or the converter."""
    one = ms.expose(np.ones(SHAPE), camera, ms.Exposure(0.0)).detected.mean_e.max()
    return np.full(
        SHAPE,
        share
        * min(camera.pixel.full_well_e, (2**camera.adc.bits - 1) / gain_dn_per_e(camera))
        / one,
    )


ENDS: dict[str, tuple[float, dict[str, float]]] = {
    "few electrons": (3.0, {"adc__black_level_dn": 64.0}),
    "no light": (0.0, {"adc__black_level_dn": 1.3}),
    "code edge": (40.0, {"adc__black_level_dn": 16.5}),
    "lower clip": (4.0, {"adc__black_level_dn": 0.3}),
    "upper clip": (1940.0, {"adc__black_level_dn": 16.0, "adc__bits": 8}),
    "full well": (1020.0, {"adc__black_level_dn": 16.0, "pixel__full_well_e": 1000.4}),
    "well of 20 e-": (19.0, {"adc__black_level_dn": 16.0, "pixel__full_well_e": 20.0}),
    "3 DN/e-": (5.0, {"adc__black_level_dn": 9.3, "dn_per_e": 3.0}),
    "30 DN/e-": (7.0, {"adc__black_level_dn": 9.3, "dn_per_e": 30.0, "adc__bits": 8}),
}


@pytest.mark.parametrize("end", ENDS)
@pytest.mark.parametrize("sigma_dn", [0.05, 0.3, 0.61, 5.0])
def test_the_clean_frame_is_that_of_an_enumeration_of_counts_and_codes(
    end: str, sigma_dn: float
) -> None:
    """Within 0.01 of the noise (or of rounding noise), the variance within 2 %, at clips, full wells and code edges."""
    electrons, fields = ENDS[end]
    camera = bare_camera(sigma_dn, **fields)
    mean, variance = mean_and_variance(camera, electrons)
    light = ms.Photons(np.full((2, 3), electrons), detected=True)
    found = ms.expose(light, camera, EXPOSURE)
    assert found.pixel_moments.method == "closed form"
    assert found.clean == pytest.approx(mean, abs=0.01 * np.sqrt(variance + 1 / 12))
    assert found.temporal_variance == pytest.approx(variance, rel=0.02, abs=2e-3)


def averages(photons: Any, camera: ms.Camera, count: int = FRAMES) -> tuple[Any, Any]:
    """Mean and variance of every pixel over frames."""
    total, square = np.zeros(SHAPE), np.zeros(SHAPE)
    for frame in ms.stream(photons, camera, EXPOSURE, frames=count):
        total += frame
        square += frame.astype(float) ** 2
    return total / count, square / count - (total / count) ** 2


@pytest.mark.parametrize(("name", "share"), CASES)
def test_the_average_of_many_frames_is_the_clean_frame(name: str, share: float) -> None:
    """Within 4.5 standard errors in every pixel, 0.3 σ by a lattice; variances within 3 %. One seed in 100 fails."""
    camera = CAMERAS[name]
    photons = photons_of(camera, share)
    found = ms.expose(photons, camera, EXPOSURE)
    mean, square = averages(photons, camera)
    variance = found.temporal_variance.astype(float)
    is_lattice = found.pixel_moments.method != "closed form"
    moving = (
        variance > 0.1 * variance.max()
    )  # else the codes are at the clip but for few frames
    sigma = np.sqrt(np.where(moving, variance, variance.max()))
    off = np.abs(mean - found.clean) / sigma
    assert off.max() < 4.5 / np.sqrt(FRAMES) + 0.3 * is_lattice
    assert np.sqrt(np.mean(off**2)) < 1.15 / np.sqrt(FRAMES) + 0.06 * is_lattice
    assert np.sum(square[moving]) == pytest.approx(np.sum(variance[moving]), rel=0.03)


EM = ms.load_camera("proem_hs_1024b").replace(
    **{"readout.em_gain": 300.0, "readout.em_full_well_e": None}
)
NOT_STRAIGHT: dict[str, ms.Camera] = {
    "EM gain, converter curve": EM.replace(**{"adc.gamma": 1.04}),
    "unequal steps": TABLE1.replace(**{"adc.dnl_lsb": {str(k): 0.7 - 1.4 * (k % 2) for k in range(10, 3000)}}),
    "coupled neighbours": TABLE1.replace(**{"readout.ipc_coupling": 0.02}),
    "row noise and radiation hits": TABLE1.replace(**{"readout.row_noise_e": 30.0, "pixel.hits_per_cm2_s": 4e6}),
    "soft saturation": TABLE1.replace(**{"pixel.full_well_knee_e": 800.0}),
}  # fmt: skip


@pytest.mark.parametrize("name", list(NOT_STRAIGHT))
def test_a_chain_that_is_not_straight_has_its_mean_by_a_lattice_and_says_so(name: str) -> None:
    """In a ramp of light. Five standard errors of the average over pixels, of 100 frames and the 32 of the lattice."""
    camera = NOT_STRAIGHT[name]
    light = ms.Photons(np.linspace(5.0, 120.0, 384).reshape(SHAPE), detected=True)
    found = ms.expose(light, camera, EXPOSURE)
    assert found.pixel_moments.method.startswith("32 frames of a lattice, because")
    assert np.isfinite(found.clean).all() and np.isfinite(found.temporal_variance).all()
    mean, variance = averages(light, camera, 100)
    off = (found.clean - mean) / np.sqrt(variance)
    assert abs(off.mean()) < 5 * np.sqrt(1 / 100 + 0.08**2) / np.sqrt(
        SHAPE[0]
    )  # rows share noise
    assert np.std(off) < 0.15
    assert found.temporal_variance.mean() == pytest.approx(variance.mean(), rel=0.06)


@dataclass(frozen=True)
class Ramp(ms.Stage):
    """A fixed gain that rises along the rows, in electrons."""

    domain = "electrons"

    def sample(self, signal: ms.stages.Electrons, frame: ms.stages.Frame) -> ms.stages.Array:
        return ms.stages.Electrons(signal.light * self.gain(frame), signal.dark)

    def gain(self, frame: ms.stages.Frame) -> ms.stages.Array:
        return frame.window.backend.from_numpy(
            1 + 0.01 * frame.window.columns[None, :], frame.window
        )


@dataclass(frozen=True)
class Jitter(ms.Stage):
    """Temporal noise of 100 electrons before they are counted."""

    domain = "electrons"

    def sample(self, signal: ms.stages.Electrons, frame: ms.stages.Frame) -> ms.stages.Array:
        return ms.stages.Electrons(
            signal.light + frame.number(100.0) * frame.normal("jitter"), signal.dark
        )


@dataclass(frozen=True)
class Drift(ms.Stage):
    """An offset that grows from frame to frame."""

    domain = "volts"

    def sample(self, swing: ms.stages.Array, frame: ms.stages.Frame) -> ms.stages.Array:
        return swing + frame.number(1e-4 * frame.index)


def test_stages_of_a_user_count_as_they_are_sampled() -> None:
    photons, gain = photons_of(TABLE1, 0.4), gain_dn_per_e(TABLE1)
    plain = ms.expose(photons, TABLE1, EXPOSURE)
    ramp = ms.expose(photons, TABLE1.with_stage(Ramp(), after="prnu"), EXPOSURE)
    light = plain.detected.mean_e * ms.fpn_maps(TABLE1, SHAPE)["prnu"]
    assert ramp.clean - plain.clean == pytest.approx(
        gain * light * 0.01 * np.arange(SHAPE[1]), abs=5e-3
    )
    moved = ms.expose(photons, TABLE1.with_stage(Jitter(), after="prnu"), EXPOSURE)
    assert "jitter" in moved.pixel_moments.method
    sigma = np.sqrt(moved.temporal_variance.mean())
    assert np.std(moved.clean - plain.clean) < 0.1 * sigma
    added = (moved.temporal_variance - plain.temporal_variance).mean()
    assert added == pytest.approx(1e4 * gain**2, rel=0.05)
    drifting = TABLE1.with_stage(Drift(), after="reset_noise")
    first, ninth = (ms.expose(photons, drifting, EXPOSURE, first_frame=k) for k in (0, 9))
    volt_dn = TABLE1.stages[-1].gain_dn_per_v  # type: ignore[attr-defined]
    assert ninth.clean - first.clean == pytest.approx(9e-4 * volt_dn, abs=5e-3)

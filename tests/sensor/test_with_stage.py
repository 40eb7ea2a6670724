"""Stages of one's own: row banding is in the chain, in theory, noise budget and metadata."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
import pytest

import mitsuba_sensor as ms
from mitsuba_sensor import InputError
from mitsuba_sensor.core.types import Float64Array
from mitsuba_sensor.stages.gains import gain_dn_per_e

TABLE1, DARK = ms.load_camera("konnik_table1"), ms.Exposure(0.0)


@dataclass(frozen=True)
class Banding(ms.Stage):
    """All pixels of a row share an offset that is new in each frame and varies from row to row with this spectrum.

    sigma_e : σ as electrons at the sense node [e- rms].  gain_v_per_e : volts of one electron at this place [V/e-].
    spectrum : power at evenly spaced frequencies from 0 to ½ cycle per row, in any unit.
    """

    sigma_e: float
    gain_v_per_e: float
    spectrum: tuple[float, ...]
    domain = "volts"

    @cached_property
    def kernel(self) -> Float64Array:
        """The filter with this spectrum, Σ h² = 1."""
        h = np.fft.fftshift(np.fft.irfft(np.sqrt(self.spectrum)))
        return np.asarray(h / np.sqrt(np.sum(h**2)))

    def sample(self, swing: ms.stages.Array, frame: ms.stages.Frame) -> ms.stages.Array:
        """Swing [V] with the banding of this frame."""
        if self.sigma_e == 0:
            return swing
        rows = np.arange(frame.window.rows[0], frame.window.rows[-1] + len(self.kernel))
        offsets = np.convolve(frame.row_normal("banding", rows), self.kernel, "valid")[:, None]
        volts = self.sigma_e * self.gain_v_per_e
        return swing + frame.number(volts) * frame.window.backend.from_numpy(
            offsets, frame.window
        )


def camera_with_banding(sigma_e: float = 20.0) -> ms.Camera:
    """konnik_table1 with banding of a period of about 16 rows behind its reset noise."""
    frequency = np.linspace(0, 0.5, 65)
    peak = np.exp(-0.5 * ((frequency - 1 / 16) / 0.01) ** 2)
    return TABLE1.with_stage(Banding(sigma_e, 5e-6, tuple(peak)), after="reset_noise")


def test_a_stage_of_ones_own_stands_in_report_noise_budget_and_metadata() -> None:
    camera = camera_with_banding(20.0)
    frames = ms.expose(np.zeros((64, 64)), camera, DARK)
    names = [line["name"] for line in frames.report["stages"]]
    assert names[names.index("banding") - 1] == "reset noise"
    (entry,) = (one for one in frames.noise_budget().entries if one.source == "banding")
    expected_dn2 = (20.0 * gain_dn_per_e(camera)) ** 2
    assert abs(entry.temporal_dn2 - expected_dn2) < 4 * entry.temporal_error_dn2
    assert (
        entry.temporal_error_dn2 < 0.2 * expected_dn2
    )  # 24 windows of 64 rows, of which 20 are alike
    (added,) = camera.to_dict()["added_stages"]
    assert added["after"] == "reset_noise" and "Banding(sigma_e=20.0" in added["stage"]
    assert "added_stages" not in TABLE1.to_dict()


class Hum(ms.Stage):
    """Noise of one value per pixel; not frozen, without a hash, with an array among its fields."""

    domain = "volts"

    def __init__(
        self, source: str = "hum", sigma_v: float = 1e-3, double: bool = False
    ) -> None:
        self.source, self.sigma_v, self.weights = (
            source,
            np.array([sigma_v]),
            np.float64(1) if double else 1.0,
        )

    __hash__ = None  # type: ignore[assignment]

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Hum) and bool(np.all(self.sigma_v == other.sigma_v))

    def sample(self, swing: Any, frame: ms.stages.Frame) -> Any:
        """Swing with noise."""
        return swing + self.weights * (
            frame.number(float(self.sigma_v[0])) * frame.normal(self.source)
        )


def test_a_stage_that_leaves_float32_is_refused() -> None:
    """On NumPy a float64 scalar makes the frame float64, on Dr.Jit it does not."""
    with pytest.raises(InputError, match=r"turns float32 into float64.*frame\.number"):
        TABLE1.with_stage(Hum(double=True), after="reset_noise")


class Sum(ms.Stage):
    """Adds up what must stay apart."""

    domain = "electrons"

    def sample(self, electrons: Any, frame: ms.stages.Frame) -> Any:
        """The sum."""
        return electrons.total


def test_a_stage_that_adds_up_electrons_is_refused() -> None:
    with pytest.raises(InputError, match=r"Sum returns a ndarray.*return Electrons"):
        TABLE1.with_stage(Sum(), after="shot_noise")


@dataclass(frozen=True)
class MeanOfTwoExposures(ms.Stage):
    """The average of two exposures of the same light, each with shot noise of its own."""

    domain = "electrons"

    def sample(
        self, electrons: ms.stages.Electrons, frame: ms.stages.Frame
    ) -> ms.stages.Electrons:
        counts = [frame.poisson(name, electrons.total) for name in ("exposure 1", "exposure 2")]
        return replace(electrons, light=frame.number(0.5) * (counts[0] + counts[1]), dark=0.0)


def test_a_stage_stands_in_place_of_one_of_the_camera() -> None:
    """Half the shot noise in frames and in their theory, within 4 standard errors of 130 000 differences."""
    camera = ms.load_camera("sony_imx174").without("shot_noise")
    averaged = camera.with_stage(MeanOfTwoExposures(), after="shot_noise")
    light = ms.Photons(np.full((128, 128), 4000.0), detected=True)
    quiet, frames = (
        ms.expose(light, one, DARK, frames=8).digital.astype(float)
        for one in (camera, averaged)
    )
    added_dn2 = frames.var(axis=0, ddof=1).mean() - quiet.var(axis=0, ddof=1).mean()
    half_dn2 = camera.system_gain_dn_per_e**2 * 4000.0 / 2
    assert added_dn2 == pytest.approx(half_dn2, rel=0.02)
    expected = ms.expose(light, averaged, DARK).theory.averages(averaged.stages[-1])
    assert expected.temporal == pytest.approx(frames.var(axis=0, ddof=1).mean(), rel=0.03)

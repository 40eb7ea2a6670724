"""check_stage: right stages pass, and a moments that does not fit its sample is told with place and numbers.

The random numbers are the same in every run: what passes once passes always.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest
from helpers.amp_glow import AmpGlow
from helpers.marks import exhaustive, one_in

import mitsuba_sensor as ms
from mitsuba_sensor.stages.effects.radiation_hits import RadiationHits
from mitsuba_sensor.theory import stage_check

TABLE1 = ms.load_camera("konnik_table1")


class GlowWithMoments(AmpGlow):
    """Its moments are averages over the window."""

    def moments(self, m: ms.Moments) -> ms.Moments:
        glow = self.glow_e(m.frame)
        return m.add(mean=glow.mean(), spatial=glow.var())


class GlowOfEveryPixel(GlowWithMoments):
    """Its moments are those of every pixel."""

    def moments(self, m: ms.Moments) -> ms.Moments:
        return m.add(mean=self.glow_e(m.frame))


class GlowOfTheOrigin(GlowWithMoments):
    """Its moments are those of the first pixel of the sensor, wherever the window is."""

    def moments(self, m: ms.Moments) -> ms.Moments:
        return m.add(mean=self.rate_e_per_s * m.frame.exposure.time_s)


class GlowOfNoNumber(GlowWithMoments):
    """Its moments are no numbers."""

    def moments(self, m: ms.Moments) -> ms.Moments:
        return m.add(mean=np.nan)


class GlowOfTheWindow(GlowWithMoments):
    """Begins anew in every window."""

    def glow_e(self, frame: ms.Frame) -> ms.Array:
        rows, columns = np.indices(frame.window.shape)
        return self.rate_e_per_s * frame.exposure.time_s * np.exp(-(rows + columns) / 40.0)


@dataclass(frozen=True)
class Hum(ms.Stage):
    """Temporal noise of pixels, rows or columns; moments say ``stated`` times its variance."""

    draw: str = "normal"
    stated: float = 1.0
    sigma_v: float = 1e-3
    domain = "volts"

    def sample(self, swing: ms.Array, frame: ms.Frame) -> ms.Array:
        return swing + frame.number(self.sigma_v) * getattr(frame, self.draw)("hum")

    def moments(self, m: ms.Moments) -> ms.Moments:
        return m.add(temporal=self.stated * self.sigma_v**2)


@dataclass(frozen=True)
class Amplifier(ms.Stage):
    """Twice the swing; moments say so of the mean alone."""

    domain = "volts"

    def sample(self, swing: ms.Array, frame: ms.Frame) -> ms.Array:
        return swing * frame.number(2.0)

    def moments(self, m: ms.Moments) -> ms.Moments:
        return replace(m, mean=2.0 * m.mean)


@pytest.fixture
def fewest_places(monkeypatch: pytest.MonkeyPatch) -> None:
    """A large mistake is found wherever it is looked for."""
    monkeypatch.setattr(stage_check, "PLACES_OF_EACH_SHAPE", 1)


@pytest.mark.parametrize("stage", [GlowWithMoments(), exhaustive(GlowOfEveryPixel())])
def test_an_amp_glow_whose_moments_are_those_of_its_window_passes(
    stage: GlowWithMoments,
) -> None:
    check = ms.check_stage(stage, camera=TABLE1, after="dark_current")
    assert check.unit == "e-" and max(row.standard_errors for row in check.comparisons) < 5
    lines = check.explain().splitlines()
    assert lines[0].startswith(type(stage).__name__) and len(lines) == 2 + 3 * 3


@pytest.mark.parametrize(
    "draw", [exhaustive("normal"), "row_normal", exhaustive("column_normal")]
)
def test_three_percent_of_a_temporal_variance_are_found(draw: str) -> None:
    ms.check_stage(Hum(draw), camera=TABLE1, after="reset_noise")
    with pytest.raises(
        ms.InputError, match=r"moments says that the temporal variance is 1\.03e-06 V²"
    ):
        ms.check_stage(Hum(draw, stated=1.03), camera=TABLE1, after="reset_noise")


@pytest.mark.usefixtures("fewest_places")
def test_moments_of_another_place_are_told_with_place_and_numbers() -> None:
    said = r"rows \d+-\d+, columns \d+-\d+ of konnik_table1 with a \w+ signal, moments says that the \w+"
    with pytest.raises(ms.InputError, match=f"GlowOfTheOrigin: at {said}"):
        ms.check_stage(GlowOfTheOrigin(), camera=TABLE1, after="dark_current")


@pytest.mark.usefixtures("fewest_places")
def test_noise_that_enters_and_is_not_amplified_in_moments_is_found() -> None:
    with pytest.raises(
        ms.InputError,
        match=r"with a noisy signal, moments says that the (temporal|spatial) variance",
    ):
        ms.check_stage(Amplifier(), camera=TABLE1, after="reset_noise")


@pytest.mark.usefixtures("fewest_places")
def test_moments_that_are_no_numbers_are_told() -> None:
    with pytest.raises(ms.InputError, match="moments says that the mean is nan e-,"):
        ms.check_stage(GlowOfNoNumber(), camera=TABLE1, after="dark_current")


def test_a_stage_that_begins_anew_in_every_window_is_found() -> None:
    with pytest.raises(ms.InputError, match="is not the crop of the frame of"):
        ms.check_stage(GlowOfTheWindow(), camera=TABLE1, after="dark_current")


@pytest.mark.parametrize(
    "number", one_in(16, range(1, len(ms.load_camera("bayer_2mp").stages) - 1))
)
def test_every_stage_of_a_camera_behind_which_are_electrons_or_volts_passes(
    number: int,
) -> None:
    camera = ms.load_camera("bayer_2mp")
    ms.check_stage(camera.stages[number], camera=camera)


def test_a_stage_that_is_not_in_the_chain_needs_its_place() -> None:
    for stage in (Hum(), TABLE1.stages[0], TABLE1.stages[-1]):
        with pytest.raises(
            ms.InputError, match=r"say where it stands, e\.g\. after='dark_current'"
        ):
            ms.check_stage(stage, camera=TABLE1)


HIT = 1500.0


@dataclass(frozen=True)
class HitsThatStateMore(RadiationHits):
    """Its moments say that every hit leaves 10 % more."""

    def moments(self, m: ms.Moments) -> ms.Moments:
        return replace(self, hit_e=1.1 * self.hit_e).as_right(m)

    def as_right(self, m: ms.Moments) -> ms.Moments:
        return RadiationHits.moments(self, m)


@pytest.mark.exhaustive
@pytest.mark.parametrize("hits_of_a_pixel", [1e-7, 1e-5])
def test_rare_hits_pass_however_few_there_are(hits_of_a_pixel: float) -> None:
    """All windows together have 2.9e6 pixels in two frames: 0.6 hits and 58. By chance one in 1000 would fail."""
    stage = RadiationHits(hits_of_a_pixel, HIT, 1.0)
    check = ms.check_stage(stage, camera=TABLE1, after="full_well", exposure=ms.Exposure(1.0))
    assert max(row.standard_errors for row in check.comparisons) < 5


@pytest.mark.exhaustive
def test_hits_of_which_10_percent_more_charge_is_stated_are_told_where_there_are_enough() -> (
    None
):
    """1 % of the pixels: 2600 hits in a window of 64 × 64 alone, which give their charge within 2 %."""
    stage = HitsThatStateMore(0.01, HIT, 1.0)
    with pytest.raises(ms.InputError, match=r"HitsThatStateMore.*the (mean|temporal)"):
        ms.check_stage(stage, camera=TABLE1, after="full_well", exposure=ms.Exposure(1.0))

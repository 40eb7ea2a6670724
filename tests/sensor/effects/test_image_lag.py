"""Image lag: a share of the photoelectrons of each frame is missing in it and part of the next one."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from helpers.stage_tests import ENGINES, StageTests, backend_of
from numpy.typing import NDArray

import mitsuba_sensor as ms
from mitsuba_sensor.core.backend import Backend
from mitsuba_sensor.stages.effects.quantum_efficiency import QuantumEfficiency

BASE = ms.load_camera("konnik_table1")
LAG, WELL_E = 0.02, BASE.pixel.full_well_e
LAGGING = BASE.replace(**{"quantum_efficiency.image_lag": LAG})
QUIET = LAGGING.replace(**{"pixel.prnu": 0.0, "dark_current.fom_na_per_cm2": 0.0})
SHORT = ms.Exposure(0.1)


def after(before: Any, now: Any) -> ms.Photons:
    """Photoelectrons of a frame, and those of the frame before."""
    of_before = ms.Photons(np.asarray(before, float), detected=True)
    return ms.Photons(np.asarray(now, float), detected=True, by_readout={"before": of_before})


def mean_e(camera: ms.Camera, light: Any, **options: Any) -> NDArray[np.float64]:
    """Mean photoelectrons of a frame."""
    return ms.expose(light, camera, SHORT, precision="float64", **options).theory.light.mean_e


def sequence_e(camera: ms.Camera, levels_e: list[float]) -> NDArray[np.float64]:
    """Mean photoelectrons that each frame of a sequence shows, of light that is this bright in each."""
    pairs = zip([levels_e[0], *levels_e], levels_e, strict=False)
    frames = [mean_e(camera, after([[before]], [[now]])) for before, now in pairs]
    return np.array([frame.item() for frame in frames])


def options_of(engine: str) -> dict[str, Any]:
    backend_of(engine)
    return {"precision": "float64"} if engine == "float64" else {"engine": engine}


class TestImageLag(StageTests):
    """Photons of one frame have no frame before: nothing changes."""

    stage = QuantumEfficiency
    camera = LAGGING
    without = BASE

    @pytest.mark.parametrize("engine", ENGINES)
    def test_a_crop_of_a_frame_is_the_frame_of_the_crop(self, engine: str) -> None:
        before, now = np.random.default_rng(1).uniform(0.0, 4e4, (2, 40, 50))
        whole = ms.expose(after(before, now), LAGGING, SHORT, **options_of(engine)).digital[0]
        light = after(before[9:, 5:31], now[9:, 5:31])
        part = ms.expose(light, LAGGING, SHORT, origin=(9, 5), **options_of(engine))
        np.testing.assert_array_equal(part.digital[0], whole[9:, 5:31])


def test_the_step_response_is_the_closed_form() -> None:
    """Light on: 1 − f of it in the first frame. Light off: f of it in the first dark frame, and nothing later. A full
    pixel leaves f of its full well, however bright the light was."""
    steps = sequence_e(LAGGING, [0.0, 1000.0, 1000.0, 0.0, 0.0])
    np.testing.assert_allclose(steps, [0.0, 980.0, 1000.0, 20.0, 0.0], rtol=1e-12)
    with pytest.warns(UserWarning, match="saturated"):
        full = sequence_e(LAGGING, [20 * WELL_E, 0.0, 0.0])
    np.testing.assert_allclose(full[1:], [LAG * WELL_E, 0.0], rtol=1e-12)
    assert full[0] == 20 * WELL_E


def test_a_well_with_a_knee_leaves_a_share_of_what_it_holds() -> None:
    """At the full well that is w·ln 2 less; far above it all of it."""
    camera = LAGGING.replace(**{"pixel.full_well_knee_e": 1000.0})
    with pytest.warns(UserWarning, match="saturated"):
        found = [sequence_e(camera, [level, 0.0])[1] for level in (WELL_E, 1e9, np.inf)]
    expected = WELL_E - 1000 * np.log(2), WELL_E, WELL_E
    np.testing.assert_allclose(found, LAG * np.array(expected), rtol=1e-9)


def test_the_first_dark_frame_has_the_lag_in_its_codes() -> None:
    """Within 4 standard errors of 2^16 pixels, 0.1 DN; the light on would be 1985 DN higher."""
    dark = ms.expose(after(np.zeros((256, 256)), np.zeros((256, 256))), QUIET, SHORT)
    ghost = ms.expose(after(np.full((256, 256), 16e3), np.zeros((256, 256))), QUIET, SHORT)
    rise_dn = ghost.digital.mean() - dark.digital.mean()
    expected_dn = LAG * 16e3 * QUIET.system_gain_dn_per_e
    error_dn = (ghost.temporal_variance.mean() + dark.temporal_variance.mean()) ** 0.5 / 256
    assert rise_dn == pytest.approx(expected_dn, abs=4 * float(error_dn))


def test_charge_is_conserved_over_a_sequence() -> None:
    """Between two dark ends all electrons that wells held are shown: within 1e-12, of any lag and up to full wells."""
    random = np.random.default_rng(2)
    for lag in (0.001, 0.02, 0.5):
        levels = [0.0, *random.uniform(0.0, WELL_E, 20), 0.0, 0.0]
        camera = BASE.replace(**{"quantum_efficiency.image_lag": lag})
        assert sequence_e(camera, levels).sum() == pytest.approx(sum(levels), rel=1e-12)


def test_two_frames_of_lag_are_left_out_to_the_second_order() -> None:
    """A pixel that keeps a share of all its charge, of older frames too, shows (1 − f)·f^k of a flash k frames later:
    f² of it, 4e-4 at f = 0.02, are in the first dark frame here and in later ones there."""
    flash = sequence_e(LAGGING, [0.0, 1.0, 0.0, 0.0, 0.0])[1:]
    recursive = (1 - LAG) * LAG ** np.arange(4.0)
    off = flash - recursive
    assert off[0] == pytest.approx(0, abs=1e-12)
    assert off[1] == pytest.approx(LAG**2, rel=1e-9)
    assert off[1:].sum() == pytest.approx(0, abs=1.01 * LAG**4)


def test_counts_stay_poisson_and_successive_frames_independent() -> None:
    """Variance over mean is 1, and two frames have no covariance, within 3 standard errors of 2^18 counts; shares that
    were not whole electrons would make these 0.51 and 0.5 at f = 0.5."""
    camera = QUIET.replace(**{"quantum_efficiency.image_lag": 0.5})
    light = after(np.full((512, 512), 3000.0), np.full((512, 512), 5000.0))
    kept = ms.expose(light, camera, SHORT, frames=2, keep="electrons").electrons
    assert kept is not None
    first, second = (one.astype(float) - 4000.0 for one in kept)
    assert kept.mean() == pytest.approx(4000.0, abs=3 * (4000 / 2**19) ** 0.5)
    assert first.var() / 4000 == pytest.approx(1.0, abs=3 * 2**0.5 / 512)
    assert abs((first * second).mean()) / 4000 < 3 / 512


def test_the_theory_keeps_the_law_of_a_pixel() -> None:
    """Bytes, clean frame, variance, plan and noise budget are those of a camera without lag in the light that the frame
    shows."""
    before, now = np.random.default_rng(3).uniform(0.0, 3e4, (2, 20, 30))
    frames = ms.expose(after(before, now), LAGGING, SHORT, precision="float64")
    shown = ms.Photons((1 - LAG) * now + LAG * before, detected=True)
    same = ms.expose(shown, BASE, SHORT, precision="float64")
    assert frames.pixel_moments.method == "closed form"
    np.testing.assert_array_equal(frames.digital, same.digital)
    np.testing.assert_allclose(frames.clean, same.clean, rtol=1e-6)
    np.testing.assert_allclose(frames.temporal_variance, same.temporal_variance, rtol=1e-6)
    budgets = [[x.rms_dn for x in one.noise_budget().entries] for one in (frames, same)]
    np.testing.assert_allclose(budgets[0], budgets[1], rtol=1e-6)
    plans = [
        ms.plan(camera, SHORT, light, 0.1).left_out
        for camera, light in ((LAGGING, after(before, now)), (BASE, shown))
    ]
    assert plans[0] == plans[1]


def test_without_lag_or_change_no_byte_changes() -> None:
    light = np.random.default_rng(4).uniform(0.0, 4e4, (30, 40))
    plain = ms.expose(ms.Photons(light, detected=True), BASE, SHORT, frames=2).digital
    same = ms.expose(after(light, light), LAGGING, SHORT, frames=2).digital
    alone = ms.expose(ms.Photons(light, detected=True), LAGGING, SHORT, frames=2).digital
    np.testing.assert_array_equal(same, plain)
    np.testing.assert_array_equal(alone, plain)
    assert BASE.replace(**{"quantum_efficiency.image_lag": 0.0}).stages == BASE.stages


@pytest.mark.parametrize("engine", ["numpy", "drjit"])
def test_no_byte_depends_on_strips_and_engines(
    engine: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """With crosstalk, whose strips see the rows beside them in both frames."""
    kernel = [[0.0, 0.02, 0.01], [0.03, 0.9, 0.01], [0.0, 0.02, 0.0]]
    camera = LAGGING.replace(**{"quantum_efficiency.crosstalk": kernel})
    light = after(*np.random.default_rng(5).uniform(0.0, 4e4, (2, 23, 31)))
    whole = ms.expose(light, camera, SHORT, engine="numpy").digital
    for pixels in (2**17, 1, 31 * 4):
        monkeypatch.setattr(Backend, "strip_pixels", pixels)
        found = ms.expose(light, camera, SHORT, **options_of(engine))
        np.testing.assert_array_equal(found.digital, whole)


def test_lag_and_crosstalk_mix_the_same_electrons_in_either_order() -> None:
    kernel = [[0.0, 0.02, 0.01], [0.03, 0.9, 0.01], [0.0, 0.02, 0.0]]
    mixing = {"quantum_efficiency.crosstalk": kernel}
    before, now = np.random.default_rng(6).uniform(0.0, 1e4, (2, 9, 11))
    both = mean_e(LAGGING.replace(**mixing), after(before, now))
    alone = [
        mean_e(BASE.replace(**mixing), ms.Photons(light, detected=True))
        for light in (before, now)
    ]
    np.testing.assert_allclose(both, LAG * alone[0] + (1 - LAG) * alone[1], rtol=1e-12)


def test_the_variance_of_renders_is_mixed_by_squares() -> None:
    of_before = ms.Photons(np.full((2, 2), 1e4), variance_e2=np.full((2, 2), 300.0))
    now = ms.Photons(
        np.full((2, 2), 1e4),
        variance_e2=np.full((2, 2), 100.0),
        by_readout={"before": of_before},
    )
    signal = ms.expose(now, LAGGING, SHORT, precision="float64").theory.light.signal
    expected = (1 - LAG) ** 2 * 100 + LAG**2 * 300
    np.testing.assert_allclose(signal.variance_e2, expected, rtol=1e-12)


LIGHT = after([[1.0]], [[2.0]])
UNKNOWN = LIGHT.changed(by_readout={"next": ms.Photons(np.ones((1, 1)), detected=True)})
YIELD = {
    "quantum_efficiency.image_lag": 0.01,
    "quantum_efficiency.wavelengths_nm": [200.0, 700.0],
    "quantum_efficiency.curves": {"mono": [0.5, 0.5]},
    "quantum_efficiency.quantum_yield": [2.0, 1.0],
}
REFUSED: dict[str, tuple[dict[str, Any], str]] = {
    "percent": ({"quantum_efficiency.image_lag": 2.0}, "at most 0.5"),
    "negative": ({"quantum_efficiency.image_lag": -0.1}, "at least 0"),
    "bursts": (YIELD, "give either image_lag or quantum_yield"),
    "dual": (
        {"quantum_efficiency.image_lag": 0.01, "sensor.dual_pixel": True},
        "image_lag is not 0",
    ),
    "read-outs": (
        {"quantum_efficiency.image_lag": 0.01, "readouts": [{"name": "a"}, {"name": "b"}]},
        "readouts need pixels with one charge in a frame; set quantum_efficiency.image_lag to 0",
    ),
}


@pytest.mark.parametrize("case", REFUSED)
def test_cameras_whose_lag_is_not_known_are_refused(case: str) -> None:
    fields, said = REFUSED[case]
    with pytest.raises(ms.InputError, match=said):
        BASE.replace(**fields)


def test_light_of_a_frame_before_is_checked_and_for_a_camera_with_lag() -> None:
    with pytest.raises(ms.InputError, match=r"names 'before'; .* pass photons\.changed"):
        ms.expose(LIGHT, BASE, SHORT)
    with pytest.raises(
        ms.InputError, match=r"names 'next'; of a camera with image lag .*'before'"
    ):
        ms.expose(UNKNOWN, LAGGING, SHORT)
    with pytest.raises(ms.InputError, match=r"negative"):
        ms.expose(after([[-1.0]], [[2.0]]), LAGGING, SHORT)
    with pytest.raises(ms.InputError, match=r"has shape \(2, 2, 1\)"):
        ms.expose(after(np.ones((2, 2)), [[2.0]]), LAGGING, SHORT)


def test_derivatives_by_photons_are_refused_and_by_fields_are_those_of_the_light() -> None:
    backend_of("drjit")
    of_before = ms.Photons(np.full((8, 8), 4000.0))
    light = ms.Photons(np.full((8, 8), 2000.0), by_readout={"before": of_before})
    with pytest.raises(ms.InputError, match="a part of these stays"):
        ms.differentiable(light, LAGGING, SHORT, parameters="photons")
    gain = "readout.sense_gain_uv_per_e"
    shown = ms.Photons(np.full((8, 8), 2040.0))
    slopes = [
        ms.differentiable(photons, camera, SHORT, parameters=gain).frame().forward(gain)
        for photons, camera in ((light, LAGGING), (shown, BASE))
    ]
    np.testing.assert_allclose(slopes[0], slopes[1], rtol=1e-5)


def test_a_frame_without_the_light_of_the_one_before_says_that_it_shows_no_lag() -> None:
    alone = ms.expose(np.ones((4, 4)), LAGGING, SHORT)
    assert any("image_lag shows nothing in frame 0: " in note for note in alone.notes)
    both = ms.expose(after(np.ones((4, 4)), np.ones((4, 4))), LAGGING, SHORT)
    assert not any("image_lag" in note for note in both.notes)

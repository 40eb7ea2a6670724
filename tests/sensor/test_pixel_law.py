"""The law of a pixel on Dr.Jit: against the theory of a frame, which is computed apart, and against enumeration.

Nothing here is random: the theory is the law itself, and the limits are those of its own accuracy.
"""

from __future__ import annotations

import sys
from typing import Any

import numpy as np
import pytest
from helpers import BENCHMARKS
from helpers.marks import one_in
from mitsuba_sensor.gradient.attached_frames import Pixels, attached_frames
from mitsuba_sensor.gradient.pixel_law import PixelLaw
from mitsuba_sensor.theory.pixel_moments import PixelStrip
from scipy import stats

import mitsuba_sensor as ms
from mitsuba_sensor.core import SensorWindow
from mitsuba_sensor.core.drjit_backend import DrJitBackend
from mitsuba_sensor.core.llvm import backend_problem
from mitsuba_sensor.stages.chain import chain

sys.path.insert(0, str(BENCHMARKS))
from expected_codes import bare_camera

problem = backend_problem("llvm")
pytestmark = pytest.mark.skipif(problem is not None, reason=f"derivatives need LLVM: {problem}")

EXPOSURE = ms.Exposure(0.01)
BENT = ms.load_camera("konnik_table1").replace(
    **{"source_follower.vv_nonlinearity": 1.02, "adc.black_level_dn": 100.0}
)
CAMERAS = {
    "konnik_table1": ms.load_camera("konnik_table1"),
    "bayer_2mp": ms.load_camera("bayer_2mp"),
    "sony_a7s2": ms.load_camera("sony_a7s2"),
    "less noise than a step": bare_camera(0.05, adc__black_level_dn=0.3),
    "clipped below": bare_camera(1.05, adc__black_level_dn=0.3),
    "clipped above": bare_camera(0.3, adc__bits=8, adc__black_level_dn=16.0),
    "full well": bare_camera(0.5, pixel__full_well_e=1000.0, adc__black_level_dn=16.0),
    "noisy full well": bare_camera(1.05, pixel__full_well_e=1000.0, adc__black_level_dn=16.0),
    "a well of 20 e-": bare_camera(2.0, pixel__full_well_e=20.0, adc__black_level_dn=16.0),
    "3 DN/e-": bare_camera(0.5, dn_per_e=3.0, adc__black_level_dn=9.3),
}


def backend() -> DrJitBackend:
    return DrJitBackend("llvm", differentiable=True)


def law_of(camera: ms.Camera, light_e: np.ndarray, names: tuple[str, ...] = ()) -> Any:
    """The law of pixels, their mean photoelectrons as a variable, and variables of the names minus their values."""
    number = backend().float
    light = number(light_e.astype(np.float32).ravel())
    changes = {name: number(0.0) for name in names}
    backend().dr.enable_grad(light, *changes.values())
    frames = attached_frames(camera, EXPOSURE, Pixels(1, light_e.shape), names, (), "llvm")
    return frames.law(light, changes), light, changes


def gradient(value: Any, *variables: Any) -> list[np.ndarray]:
    dr = backend().dr
    dr.backward(value)
    return [dr.grad(x).numpy() for x in variables]


def theory(camera: ms.Camera, light_e: np.ndarray) -> np.ndarray:
    """Expected code of every pixel by pixel_moments.py, in float64."""
    window = SensorWindow(1, light_e.shape, camera=camera.name)
    frame = ms.Frame(EXPOSURE, window)
    mean, _ = PixelStrip(chain(camera), ms.Electrons(light_e), frame).codes()
    return mean.reshape(light_e.shape)


def levels_of(camera: ms.Camera) -> np.ndarray:
    """From less than an electron to beyond the well, twice."""
    full_e = camera.pixel.full_well_e
    near = np.linspace(0.9, 1.1, 20) * full_e
    wide = np.geomspace(1.0, 1.5 * full_e, 40)
    return np.tile(np.concatenate([wide, near, np.linspace(200, 300, 10)]), (2, 1))


@pytest.mark.parametrize("name", one_in(3, list(CAMERAS)))
def test_the_expected_code_and_its_derivative_by_the_light_are_those_of_theory(
    name: str,
) -> None:
    """The code within a thousandth of the noise and 0.01 DN, its derivative within 1 % of the gain; from 1 e- to
    beyond saturation. Theory
    leaves out of its sums what no frame shows."""
    camera = CAMERAS[name]
    light_e = levels_of(camera)
    law, light, _ = law_of(camera, light_e)
    expected = law.expected()
    (slope,) = gradient(expected, light)
    noise_e = np.sqrt(light_e)
    step = 0.1 * noise_e
    near, far = (
        (theory(camera, light_e + k * step), theory(camera, light_e - k * step)) for k in (1, 2)
    )
    slopes = (8 * (near[0] - near[1]) - (far[0] - far[1])) / (12 * step)
    gain = np.abs(slopes).max()
    off = np.abs(expected.numpy().reshape(light_e.shape) - theory(camera, light_e))
    assert (off <= 0.01 + 1e-3 * gain * noise_e).all()
    assert (np.abs(slope.reshape(light_e.shape) - slopes) <= 1e-2 * gain).all()


NUMBERS = {
    "pixel.full_well_e": "noisy full well",
    "readout.sense_gain_uv_per_e": "3 DN/e-",
    "source_follower.read_noise_e": "clipped below",
    "adc.black_level_dn": "clipped below",
    "source_follower.vv_nonlinearity": "bent",
}


@pytest.mark.parametrize("name", one_in(5, list(NUMBERS)))
def test_the_derivative_by_a_number_of_the_camera_is_that_of_theory(name: str) -> None:
    """Of the sum over pixels in few and many electrons, within 1 %."""
    camera = BENT if NUMBERS[name] == "bent" else CAMERAS[NUMBERS[name]]
    levels = [0.5, 3.0, 20.0, 30.0, 300.0, 980.0, 5000.0]
    light_e = np.tile(levels, (2, 1))
    law, _, changes = law_of(camera, light_e, (name,))
    (found,) = gradient(law.expected(), changes[name])
    value: Any = camera
    for part in name.split("."):
        value = getattr(value, part)
    ends = [theory(camera.replace(**{name: value * (1 + h)}), light_e) for h in (0.005, -0.005)]
    assert found[0] == pytest.approx((ends[0] - ends[1]).sum() / (0.01 * value), rel=0.01)


def enumerated(law: PixelLaw) -> np.ndarray:
    """Chance of every code of the first pixel, by a sum over its counts."""
    rate, signal, slope, bend, sigma = (
        float(np.ravel(x.numpy())[0])
        for x in (law.rate, law.signal, law.slope, law.bend, law.sigma)
    )
    assert law.well_e is not None
    counts = np.arange(
        max(int(rate - 9 * np.sqrt(rate)), 0), int(rate + 9 * np.sqrt(rate) + 40)
    )
    more = np.minimum(counts, law.well_e.numpy()[0]) - rate
    ideal = signal + slope * more + bend * more**2
    levels = np.arange(law.highest) + 0.5
    above = stats.poisson.pmf(counts, rate) @ stats.norm.sf((levels - ideal[:, None]) / sigma)
    return -np.diff(np.concatenate([[1.0], above, [0.0]]))


LIKELY = [
    ("clipped above", 0.5),
    ("clipped above", 5.0),
    ("clipped above", 30.0),
    ("clipped above", 33.0),
    ("clipped above", 1900.0),
    ("small well", 20.0),
    ("small well", 950.0),
    ("small well", 1050.0),
]


@pytest.mark.parametrize("case", one_in(2, LIKELY))
def test_the_likelihood_of_all_codes_is_that_of_an_enumeration(case: tuple[str, float]) -> None:
    """It adds up to 1; less than 0.002 of a nat is lost of what the enumeration knows; and the mean of its derivative
    is 0 within a hundredth of its standard deviation, so that what maximises it has no bias."""
    name, electrons = case
    camera = CAMERAS["clipped above"]
    if name == "small well":
        camera = camera.replace(**{"pixel.full_well_e": 1000.0})
    codes = np.arange(2**camera.adc.bits, dtype=np.float32)
    law, light, _ = law_of(camera, np.full((1, codes.size), electrons))
    logarithm = law.log_likelihood(backend().float(codes))
    (score,) = (x.astype(float) for x in gradient(logarithm, light))
    found, exact = logarithm.numpy().astype(float), enumerated(law)
    assert np.exp(found).sum() == pytest.approx(1.0, abs=1e-3)
    seen = exact > 1e-12
    assert abs(np.sum(exact[seen] * (np.log(exact[seen]) - found[seen]))) < 2e-3
    assert abs(exact @ score) < 0.01 * np.sqrt(exact @ score**2)


def test_a_code_that_cannot_be_has_a_finite_likelihood_and_a_derivative_towards_it() -> None:
    """So that an optimiser that begins far away finds the way."""
    camera = CAMERAS["konnik_table1"]
    light_e = np.full((1, 2), 2000.0)
    law, light, _ = law_of(camera, light_e)
    logarithm = law.log_likelihood(backend().float(np.array([4000.0, 0.0], np.float32)))
    (slope,) = gradient(logarithm, light)
    assert np.isfinite(logarithm.numpy()).all() and (logarithm.numpy() < -50).all()
    assert slope[0] > 0 > slope[1]

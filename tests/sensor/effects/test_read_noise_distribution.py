"""Read noise that is not normal: Tukey's lambda and Student's t, against SciPy's laws, and the theory against frames.

Everything is seeded. Five standard errors: chance fails one comparison in a million, of normal averages.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from helpers.marks import exhaustive, one_in
from helpers.stage_tests import StageTests
from scipy import special, stats

import mitsuba_sensor as ms
from mitsuba_sensor.core.backend import NUMPY_FLOAT32, NUMPY_FLOAT64
from mitsuba_sensor.core.noise_distributions import NoiseDistribution, StudentT, TukeyLambda
from mitsuba_sensor.stages.effects.source_follower_noise import SourceFollowerNoise
from mitsuba_sensor.stages.gains import gain_dn_per_e

BASE = ms.load_camera("konnik_table1").replace(
    **{
        "source_follower.white_nv_per_rthz": None,
        "source_follower.read_noise_e": 60.0,
        "readout.dsnu_col": 0.0,
    }
)
HEAVY = {
    "source_follower.read_noise_distribution": "tukey_lambda",
    "source_follower.read_noise_shape": -0.1,
}
STUDENT = {
    "source_follower.read_noise_distribution": "student",
    "source_follower.read_noise_shape": 6.0,
}
NORMAL = {
    "source_follower.read_noise_distribution": "normal",
    "source_follower.read_noise_shape": None,
}
LAWS: tuple[NoiseDistribution, ...] = (
    *map(TukeyLambda, (-0.45, -0.3, -0.1, 0.0, 0.1, 0.14, 0.2)),
    *map(StudentT, (2.5, 4.0, 30.0, 1000.0)),
)


class TestHeavyTails(StageTests):
    stage = SourceFollowerNoise
    camera = BASE.replace(**HEAVY)
    without = {**NORMAL, "source_follower.read_noise_e": 0.0}
    neutral = (SourceFollowerNoise(0.0, distribution=TukeyLambda(-0.1)),)
    level = 0.1


class TestHeavyTailsOfEveryPixel(TestHeavyTails):
    camera = BASE.replace(**STUDENT, **{"source_follower.read_noise_cv": 0.5})


def exact(law: NoiseDistribution) -> Any:
    """The same law of SciPy."""
    return stats.tukeylambda(law.shape) if isinstance(law, TukeyLambda) else stats.t(law.shape)


@pytest.mark.parametrize("law", LAWS, ids=str)
def test_random_bits_become_the_quantiles_of_scipys_law(law: NoiseDistribution) -> None:
    """One factor for all quantiles, from the centre to the farthest number that can be drawn; float32 to 6e-5 of it."""
    bits = np.array(
        [0, 1, 10, 1000, 10**5, 10**8, 10**9, 2**31 - 10**6, 2**31 + 10**7, 2**32 - 1],
        np.uint32,
    )
    survival = (bits.astype(np.float64) + 0.5) / 2**32
    x = NUMPY_FLOAT64.distributed(bits, law)
    below = exact(law).ppf(survival)  # the law is symmetric; SciPy loses the upper tail
    np.testing.assert_allclose(x / -below, x[3] / -below[3], rtol=1e-8)
    np.testing.assert_allclose(NUMPY_FLOAT32.distributed(bits, law), x, rtol=6e-5)


@pytest.mark.parametrize("law", one_in(4, LAWS), ids=str)
def test_the_variance_of_the_numbers_that_can_be_drawn_is_1(law: NoiseDistribution) -> None:
    """All 2³² of them: the outermost 2¹⁶ one by one, the others in groups of a 4096th of their number.

    Where the tails are light enough, the factor is that of the whole law.
    """
    edges = np.unique(
        np.concatenate(
            [np.arange(2**16), np.geomspace(2**16, 2**31, 40_000).astype(np.int64), [2**31]]
        )
    )
    size, middle = np.diff(edges), 0.5 * (edges[:-1] + edges[1:]) / 2**32
    assert 2 * (size / 2**32) @ law.quantile(middle) ** 2 == pytest.approx(1.0, rel=2e-5)
    if law.shape in (-0.1, 0.0, 0.14, 0.2, 30.0):
        unit = law.quantile(np.array([0.1]))[0] / exact(law).isf(0.1)
        assert unit == pytest.approx(1 / exact(law).std(), rel=1e-5)


@pytest.mark.parametrize("law", LAWS, ids=str)
def test_the_mixture_of_normals_of_the_theory_is_the_law(law: NoiseDistribution) -> None:
    """Cumulative probabilities to 1e-3, those of the tail at 3 σ to 20 % of themselves, variance exactly."""
    weights, means, variances = law.mixture
    assert (weights.sum(), weights @ means) == pytest.approx((1.0, 0.0), abs=1e-12)
    assert weights @ (means**2 + variances) == pytest.approx(1.0, rel=1e-9)
    survival = special.ndtr(-np.linspace(-5, 5, 201))
    x = law.quantile(survival)
    found = special.ndtr((means - x[:, None]) / np.sqrt(variances)) @ weights
    np.testing.assert_allclose(found, survival, atol=1e-3)
    np.testing.assert_allclose(
        found[100:161], survival[100:161], rtol=0.2
    )  # from the centre to 3 σ


def flat(
    camera: ms.Camera, photoelectrons: float, shape: tuple[int, int], frames: int = 1
) -> ms.Frames:
    """Frames of light that frees so many electrons in every pixel."""
    qe = camera.quantum_efficiency
    light = np.full(shape, photoelectrons / camera.qe([qe.reference_nm])[0, 0])
    return ms.expose(light, camera, ms.Exposure(0.0), frames=frames, seed=3)


def camera_with(sigma_dn: float, black_dn: float, dn_per_e: float, **more: Any) -> ms.Camera:
    """One whose read noise is so many DN."""
    noise = {
        "source_follower.read_noise_e": sigma_dn / dn_per_e,
        "adc.black_level_dn": black_dn,
    }
    gain = {
        "adc.bits": 12,
        "adc.full_scale_v": 4096 / dn_per_e * BASE.readout.sense_gain_uv_per_e * 1e-6,
    }
    still = {
        "pixel.prnu": 0.0,
        "dark_current.cv": 0.0,
        "readout.reset": "true_cds",
        "pixel.full_well_e": 1e5,
    }
    return BASE.replace(**{**noise, **gain, **still, **more})


CASES = [
    (0.3, 20.0, 1.0, 0.0), (0.3, 0.25, 1.0, 0.0), (0.3, 0.0, 0.5, 3.0), (1.0, 1.0, 0.1, 0.0),
    (5.0, 3.0, 0.1, 20.0), (5.0, 20.0, 0.05, 81_400.0), (0.3, 20.0, 2.0, 2037.3), (0.3, 10.5, 1.0, 300.0),
]  # fmt: skip


@pytest.mark.parametrize(
    "shape",
    [
        HEAVY,
        exhaustive(STUDENT),
        exhaustive({**HEAVY, "source_follower.read_noise_shape": -0.3}),
    ],
    ids=str,
)
@pytest.mark.parametrize(
    ("sigma_dn", "black_dn", "dn_per_e", "light_e"), one_in(3, CASES, several=True)
)
def test_the_theory_of_a_frame_is_that_of_its_frames(
    shape: dict[str, Any], sigma_dn: float, black_dn: float, dn_per_e: float, light_e: float
) -> None:
    """Mean and temporal σ of 500 000 codes, within 4 standard errors of their own, 0.3 % or 0.01 DN.

    Next to both clips, between two codes and behind shot noise. The standard error of σ is that of 64 blocks, wide
    where the fourth moment of the law is infinite.
    """
    frames = flat(camera_with(sigma_dn, black_dn, dn_per_e, **shape), light_e, (512, 1000))
    code = frames.digital.astype(np.float64)
    expected = frames.theory.averages(frames.stages[-1])
    mean, sigma = code.mean(), code.std()
    error = (
        4 * np.square(code - mean).reshape(64, -1).mean(axis=1).std() / 8 / max(2 * sigma, 1e-9)
    )
    assert mean == pytest.approx(expected.mean, abs=max(4 * sigma / math.sqrt(code.size), 0.01))
    assert sigma == pytest.approx(
        math.sqrt(expected.temporal), abs=max(error, 0.003 * sigma, 0.01)
    )


@pytest.mark.parametrize("shape", [HEAVY, STUDENT], ids=str)
@pytest.mark.parametrize(("sigma_dn", "black_dn"), [(0.3, 10.3), (2.0, 3.0)])
def test_every_code_is_as_probable_as_the_law_says(
    shape: dict[str, Any], sigma_dn: float, black_dn: float
) -> None:
    """Darkness, 1 000 000 pixels: P(code) = F(code + ½) − F(code − ½) of SciPy's law, and of a normal it is not."""
    frames = flat(camera_with(sigma_dn, black_dn, 1.0, **shape), 0.0, (1000, 1000))
    seen = (
        np.bincount(frames.digital.ravel().astype(int), minlength=40)[:40] / frames.digital.size
    )
    name, parameter = shape.values()
    law = exact((TukeyLambda if name == "tukey_lambda" else StudentT)(parameter))
    edges = (np.arange(41) - 0.5 - black_dn) / sigma_dn

    def chances(cdf: Any, sigma: float) -> Any:
        edges_of = np.where(np.arange(41) == 0, -np.inf, edges * sigma)
        return np.diff(cdf(edges_of))

    expected = chances(law.cdf, law.std())
    error = np.sqrt(expected / frames.digital.size)
    assert np.abs(seen - expected)[expected > 1e-5].max() < 5 * error.max()
    assert (np.abs(seen - expected) < 5 * error + 1e-5).all()
    assert (np.abs(seen - chances(stats.norm.cdf, 1.0)) > 20 * error).any()


@pytest.mark.exhaustive
@pytest.mark.parametrize(
    ("sigma_dn", "black_dn", "light_e"), [(0.3, 0.4, 0.0), (3.0, 6.0, 20.0)]
)
def test_the_clean_frame_of_pixels_with_noise_of_their_own_is_the_mean_of_their_frames(
    sigma_dn: float, black_dn: float, light_e: float
) -> None:
    """800 frames of 96 pixels, Student's t of 6 degrees of freedom: z of all means, and the mean of their variances."""
    camera = camera_with(
        sigma_dn, black_dn, 1.0, **STUDENT, **{"source_follower.read_noise_cv": 0.5}
    )
    frames = flat(camera, light_e, (8, 12), frames=800)
    found = frames.digital, frames.clean, frames.temporal_variance
    code, clean, variance = (np.asarray(x, np.float64) for x in found)
    z = (code.mean(axis=0) - clean) / np.sqrt(np.maximum(variance, 1e-6) / len(code))
    assert np.abs(z).max() < 5 and np.square(z).mean() == pytest.approx(
        1.0, abs=5 * math.sqrt(2 / z.size)
    )
    assert code.var(axis=0).mean() == pytest.approx(variance.mean(), rel=0.05)


def test_float32_differs_from_float64_in_few_pixels() -> None:
    """In 0.1 % of them, by 1 DN, as normal noise does."""
    camera = camera_with(5.0, 30.0, 0.5, **HEAVY)
    one, other = (
        ms.expose(
            np.full((200, 500), 500.0), camera, ms.Exposure(0.0), precision=precision
        ).digital.astype(int)
        for precision in ("float32", "float64")
    )
    off = np.abs(one - other)
    assert off.max() <= 1 and np.mean(off > 0) < 2e-3


def test_a_normal_distribution_is_the_camera_of_before() -> None:
    """Equal stages; and its random bits are those of a normal noise, so that frames of both go together."""
    assert (
        BASE.replace(**{"source_follower.read_noise_distribution": "normal"}).stages
        == BASE.stages
    )
    plain, heavy = (
        flat(camera_with(5.0, 200.0, 1.0, **shape), 0.0, (100, 200)).digital - 200.0
        for shape in (NORMAL, HEAVY)
    )
    assert np.corrcoef(plain.ravel(), heavy.ravel())[0, 1] > 0.97


@pytest.mark.parametrize(
    ("name", "shape", "said"),
    [
        (
            "tukey_lambda",
            None,
            "read_noise_shape is missing; that of tukey_lambda must be from -0.45 to 0.2",
        ),
        (
            "tukey_lambda",
            -0.5,
            "read_noise_shape is -0.5; that of tukey_lambda must be from -0.45 to 0.2",
        ),
        ("student", 2.0, "read_noise_shape is 2; that of student must be from 2.5 to 1000"),
        (
            "normal",
            0.1,
            "read_noise_shape is 0.1, and a normal read noise has none; leave it out, or set",
        ),
        ("cauchy", 0.1, "read_noise_distribution is 'cauchy'"),
    ],
)
def test_a_wrong_shape_is_one_sentence_with_the_range(
    name: str, shape: float | None, said: str
) -> None:
    with pytest.raises(ms.InputError, match=said):
        BASE.replace(
            **{
                "source_follower.read_noise_distribution": name,
                "source_follower.read_noise_shape": shape,
            }
        )


def test_the_overall_gain_is_what_the_cases_say() -> None:
    assert gain_dn_per_e(camera_with(1.0, 0.0, 0.5)) == pytest.approx(0.5, rel=1e-9)

"""Read noise that is not normal: Tukey's lambda and Student's t, against SciPy's laws, and the theory against frames.

Everything is seeded. Five standard errors: chance fails one comparison in a million, of normal averages.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy import stats

import mitsuba_sensor as ms
from mitsuba_sensor.core.backend import NUMPY_FLOAT32, NUMPY_FLOAT64
from mitsuba_sensor.core.noise_distributions import NoiseDistribution, StudentT, TukeyLambda

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
LAWS: tuple[NoiseDistribution, ...] = (
    *map(TukeyLambda, (-0.45, -0.3, -0.1, 0.0, 0.1, 0.14, 0.2)),
    *map(StudentT, (2.5, 4.0, 30.0, 1000.0)),
)


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


@pytest.mark.parametrize("law", LAWS[::4], ids=str)
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

"""Law of the read noise: L-moments against closed forms and direct sums, and what was put into frames comes back."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from helpers.marks import one_in
from scipy import integrate, special, stats

import mitsuba_sensor as ms
from mitsuba_sensor.core.noise_distributions import NoiseDistribution, StudentT, TukeyLambda
from mitsuba_sensor.lab.frames.bench import Bench
from mitsuba_sensor.lab.frames.stack import Stack
from mitsuba_sensor.lab.quantity import Quantity
from mitsuba_sensor.lab.twin import fit
from mitsuba_sensor.lab.twin.dark import dark_over_time
from mitsuba_sensor.lab.twin.noise import read_noise
from mitsuba_sensor.lab.twin.noise_law import (
    NoiseLaw,
    Pixels,
    _sample_l_moments,
    noise_law,
    of_one_family,
)

EXPOSURE = ms.Exposure(0.0)
ONE = Pixels(1.0)
FRAMES, SHAPE = 20, (120, 160)


def read_frames(
    law: NoiseDistribution | None, sigma: float = 3.0, cv: float = 0.0, rows: float = 0.0
) -> Stack:
    """Offsets, read noise of this law with its own σ in every pixel, row noise; whole numbers."""
    chance = np.random.default_rng(7)
    z = chance.normal(size=(FRAMES, *SHAPE))
    noise = z if law is None else np.copysign(law.quantile(special.ndtr(-np.abs(z))), z)
    s = math.sqrt(math.log1p(cv**2))
    own = sigma * np.exp(s * chance.normal(size=SHAPE) - s**2)
    shared = rows * chance.normal(size=(FRAMES, SHAPE[0], 1))
    return Stack(np.round(200 + 5 * chance.normal(size=SHAPE) + own * noise + shared), 0.0, 0.0)


def law_of(stack: Stack, sigma: float = 3.0, cv: float = 0.0, rows: float = 0.0) -> NoiseLaw:
    """As the fit asks for it."""
    return noise_law(stack, Pixels(sigma, cv, rows**2, True, 200.0, 5.0))


@pytest.mark.parametrize("shape", [-0.4, -0.2, 0.0, 0.1, 0.2])
def test_tau4_of_tukeys_law_is_its_closed_form(shape: float) -> None:
    """Hosking 1990, of equal powers."""
    expected = (shape - 1) * (shape - 2) / ((shape + 3) * (shape + 4))
    assert ONE.ratios(TukeyLambda(shape))[0] == pytest.approx(expected, rel=1e-4)


def test_tau4_and_tau6_of_a_normal_and_of_students_law_are_integrals_over_their_quantiles() -> (
    None
):
    """Of the quantile function times a shifted Legendre polynomial."""
    laws = {None: stats.norm(), StudentT(5.0): stats.t(5)}
    for law, oracle in laws.items():
        moments = []
        for order in (1, 3, 5):
            legendre = special.sh_legendre(order)
            value, _ = integrate.quad(lambda u: oracle.ppf(u) * legendre(u), 0, 1, limit=400)  # noqa: B023
            moments.append(value)
        expected = moments[1] / moments[0], moments[2] / moments[0]
        np.testing.assert_allclose(ONE.ratios(law), expected, rtol=2e-4)


def test_normal_noise_beside_it_makes_the_law_more_normal() -> None:
    """Of which one part in 26 of the variance is Tukey's: the fourth cumulant is 1/676 of its own."""
    assert Pixels(1.0, normal=25.0).ratios(TukeyLambda(-0.1))[0] == pytest.approx(
        0.1226, abs=1e-3
    )


def test_rounding_at_every_place_between_two_codes_leaves_the_l_moments() -> None:
    """Of a noise of 0.4 DN: sums over the codes, averaged over 64 places, are those of the law itself."""
    sigma, law = 0.4, TukeyLambda(-0.1)
    z = np.linspace(-6, 6, 4001)
    x = sigma * np.copysign(law.quantile(special.ndtr(-np.abs(z))), z)
    edges = np.arange(-8, 8) + 0.5 + (np.arange(64)[:, None] + 0.5) / 64
    below = special.ndtr(np.interp(edges, x, z))
    inner = below * (1 - below)
    second, fourth = (float((inner * p).sum()) for p in (1.0, 1 - 5 * below + 5 * below**2))
    assert fourth / second == pytest.approx(ONE.ratios(law)[0], rel=1e-4)


def test_sample_l_moments_are_averages_over_all_subsamples() -> None:
    """l_r = 1/r Σ_k (−1)^k C(r−1, k) E[(r−k)-th smallest of r values], over every choice of r of the n values."""
    values = np.random.default_rng(3).normal(size=9) ** 3
    for order, found in zip((2, 4, 6), _sample_l_moments(values[:, None]), strict=True):
        some = np.sort(np.array(list(itertools.combinations(values, order))), axis=1)
        signs = [(-1) ** k * math.comb(order - 1, k) for k in range(order)]
        expected = (
            sum(sign * some[:, order - 1 - k].mean() for k, sign in enumerate(signs)) / order
        )
        assert found[0] == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize(
    ("sigma", "cv", "rows"), [(3.0, 0.0, 0.0), (0.8, 0.0, 0.0), (3.0, 0.35, 2.0)]
)
def test_normal_noise_is_taken_for_normal(sigma: float, cv: float, rows: float) -> None:
    """Within 3.5 standard errors of 31 degrees of freedom: another seed fails once in 700."""
    assert law_of(read_frames(None, sigma, cv, rows), sigma, cv, rows).name == "normal"


@pytest.mark.parametrize(
    ("law", "cv", "rows"),
    one_in(3, [(TukeyLambda(-0.15), 0.0, 0.0), (TukeyLambda(0.2), 0.0, 0.0), (StudentT(4.0), 0.0, 0.0),
     (TukeyLambda(-0.15), 0.3, 2.0), (StudentT(6.0), 0.3, 0.0)], several=True),
)  # fmt: skip
def test_the_law_and_its_shape_come_back(
    law: NoiseDistribution, cv: float, rows: float
) -> None:
    """384 000 values: λ to 0.01, 1/ν to 0.012, which is four standard errors, 1 seed in 10 000."""
    found = law_of(read_frames(law, cv=cv, rows=rows), cv=cv, rows=rows)
    assert isinstance(found.distribution, type(law)), found.name
    if isinstance(law, StudentT):
        assert 1 / found.shape.value == pytest.approx(1 / law.shape, abs=0.012)
    else:
        assert found.shape.value == pytest.approx(law.shape, abs=0.01)
    assert found.shape.low <= found.shape.value <= found.shape.high


def test_too_few_frames_are_taken_for_normal_and_say_so() -> None:
    few = Stack(read_frames(TukeyLambda(-0.2)).frames[:5], 0.0, 0.0)
    found = law_of(few)
    assert found.name == "normal" and not math.isfinite(found.shape.value)
    assert found.said == "assumed: 5 frames; the law of the noise needs 6"


@pytest.mark.parametrize("offsets_dn", one_in(2, [0.0, 0.1]))
def test_quiet_pixels_that_rounding_hides_are_no_reason_for_another_law(
    offsets_dn: float,
) -> None:
    """Normal noise of 0.78 DN rms whose σ differs by 55 %, all pixels at one place between two codes."""
    chance, s = np.random.default_rng(3), math.sqrt(math.log1p(0.55**2))
    own = 0.78 * np.exp(s * chance.normal(size=SHAPE) - s**2)
    frames = (
        8.6 + offsets_dn * chance.normal(size=SHAPE) + own * chance.normal(size=(48, *SHAPE))
    )
    found = read_noise(
        dark_over_time([Stack(np.round(frames), 0.0, 0.0)]),
        Quantity("K", "", 1.0, 1.0, 1.0, "", ""),
    )
    assert found.law.name == "normal" and found.law.said == "assumed: hidden by rounding"


def test_settings_of_a_ladder_have_laws_of_one_family() -> None:
    """A normal law is Tukey's of λ 0.142, where (λ − 1)(λ − 2)/((λ + 3)(λ + 4)) is 0.1226; alike laws stay."""
    normal, tails = law_of(read_frames(None)), law_of(read_frames(TukeyLambda(-0.15)))
    one, other = of_one_family([normal, tails])
    assert one.name == "tukey_lambda" and one.shape.value == pytest.approx(0.1425, abs=1e-3)
    assert other is tails and of_one_family([normal, normal]) == [normal, normal]
    assert (
        one.shape.low < 0.14161 < one.shape.high
        and one.shape.high - one.shape.low == pytest.approx(0.016, rel=0.5)
    )


def test_a_setting_whose_frames_do_not_show_its_law_has_the_whole_range() -> None:
    """Two frames: the shape of a normal law, from −0.45 to 0.2."""
    few, tails = (
        law_of(Stack(read_frames(None).frames[:2], 0.0, 0.0)),
        law_of(read_frames(TukeyLambda(-0.15))),
    )
    one, _ = of_one_family([few, tails])
    assert (one.shape.low, one.shape.high) == (-0.45, 0.2)
    assert one.shape.value == pytest.approx(0.1425, abs=1e-3)


@pytest.mark.exhaustive
def test_a_twin_of_heavy_tails_has_their_law_and_their_spread_over_pixels() -> None:
    """Frames of one camera: λ to 0.02, cv to 10 %, σ_read to 1.5 %, and a file that loads."""
    camera = ms.load_camera("sony_imx174").replace(
        **{"sensor.rows": 80, "sensor.columns": 96, "source_follower.read_noise_e": 12.0},
        **{
            "source_follower.read_noise_distribution": "tukey_lambda",
            "source_follower.read_noise_shape": -0.1,
        },
        **{"source_follower.read_noise_cv": 0.3, "adc.black_level_dn": 100.0},
    )

    def stack(photons: float, frames: int, seed: int) -> Stack:
        made = ms.expose(photons, camera, ms.Exposure(0.001), frames=frames, seed=seed)
        return Stack(made.digital, 0.001, photons, bits=camera.adc.bits)

    top = camera.pixel.full_well_e / float(camera.qe([550.0]).max())
    flats = tuple(
        stack(share * top, 2, 10 + k) for k, share in enumerate((0.1, 0.25, 0.4, 0.55, 0.7))
    )
    twin = fit(Bench((), (stack(0.0, 24, 1),), flats))
    made = ms.load_camera(twin.tables()).source_follower
    assert made.read_noise_distribution == "tukey_lambda"
    assert made.read_noise_shape == pytest.approx(-0.1, abs=0.02)
    assert made.read_noise_cv == pytest.approx(0.3, rel=0.1)
    assert made.read_noise_e == pytest.approx(12.0, rel=0.015)
    assert twin.figures()["λ"].quantity.covers(-0.1)

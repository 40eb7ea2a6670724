"""Volts and codes: source follower noise at every ratio of its times, bent nodes, coupled columns, the converter."""

from __future__ import annotations

import math
from decimal import Decimal, localcontext
from functools import partial
from typing import Any

import numpy as np

from ...core import distributions
from ...core.exposure import Exposure
from ...sensor.chain import chain
from ...sensor.effects.source_follower_noise import CdsNoise, flicker_integral
from ...sensor.expose import expose
from ..statistics import standard_error
from .case import ONLY_ONCE, SIGMAS, Case, Engine, cases_of, stage_of, table1
from .got import Got, agree, holds, refusal, relative, together

DIGITS = 120  # A float64 has up to 75 of them, so that even τ_RTN/2 is exact
EULER_GAMMA = Decimal("0.57721566490153286060651209008240243104215933593992359880576723")  # γ_E (DLMF 5.2.3)
PAPER: dict[str, Any] = {
    "white_nv_per_rthz": 15.0,
    "corner_hz": 1e6,
    "sample_s": 1e-6,
    "dominant_s": 0.5e-6,
    "rtn_uv": 200.0,
}
"""Konnik & Welsh 2014's source follower, with a telegraph step of 200 µV."""
VOLTS_PER_E = 5e-6
SEAM = 1e-7
"""Where its series takes over from it, at t_s/τ_D = 1e-4, J = 5e-8 is what is left of terms of 10: they are exact to
1e-16, so J to a few 1e-8; the series neglects a² = 1e-8 there."""
RATIOS = tuple(10.0**k for k in (-9, -6, -4, -2, 0, 1, 2, 3, 6, 9))
TIMES_S = (1e-9, 5e-8, 1e-7, 1e-6, 1e-5, 1e-3, 1.0)
DISTANCES = (0.0, 1e-15, 1e-12, 1e-9, 1e-6, 0.99e-4, 1.01e-4, 1e-3)
"""Of τ_RTN from 2τ_D, relative, on both sides of where the series takes over (1e-4)."""
TABLED = ((5e-8, 6.6102), (1e-6, 17.8268), (1e-5, 10.1226), (1e-3, 1.1012), (1.0, 0.034855))
"""τ_RTN [s] and electrons, printed in tests/sensor/test_cds.py; 1e-6 s is the singularity itself."""


def noise_of(**changes: Any) -> CdsNoise:
    """The paper's noise with something changed."""
    return CdsNoise(**(PAPER | changes))


def exact_flicker(a: Decimal) -> Decimal:
    """J(a) = γ + ln a − ½[e^(−a)Ei(a) − e^a·E₁(a)]: by the power series of Ei and E₁, and their asymptotic one."""
    if a > 60:  # terms fall until 2k ≈ a, to e^(−60)
        terms = [Decimal(math.factorial(2 * k + 1)) / a ** (2 * k + 2) for k in range(25)]
        return EULER_GAMMA + a.ln() - sum(terms)
    common, rising, falling, term = EULER_GAMMA + a.ln(), Decimal(0), Decimal(0), Decimal(1)
    for k in range(1, 400):
        term = term * a / k
        rising, falling = rising + term / k, falling + term / k * (-1) ** k
    grow = a.exp()
    return common - ((common + rising) / grow + (common + falling) * grow) / 2


def exact_parts(noise: CdsNoise) -> tuple[Decimal, Decimal, Decimal]:
    """White, flicker and telegraph noise [V²], and at the singularity its limit."""
    density, step = Decimal(noise.white_nv_per_rthz) / 10**9, Decimal(noise.rtn_uv) / 10**6
    t, tau, r = Decimal(noise.sample_s), Decimal(noise.dominant_s), Decimal(noise.rtn_s) / 2
    a = t / tau
    white = density**2 * (1 - (-a).exp()) / (2 * tau)
    flicker = 2 * density**2 * Decimal(noise.corner_hz) * exact_flicker(a)
    left, right = (time * (1 - (-t / time).exp()) for time in (r, tau))
    slope = (left - right) / (r**2 - tau**2) if r != tau else (1 - (-a).exp() * (1 + a)) / (2 * tau)
    return white, flicker, step**2 * r / 2 * slope


def parts_of(noise: CdsNoise) -> Got:
    """White, flicker and telegraph noise, and what all come to at the node, against 120 digits."""
    with localcontext() as context:
        context.prec = DIGITS
        exact = exact_parts(noise)
        sigma = (exact[0] + exact[1] + exact[2]).sqrt() / (
            1 - (-Decimal(noise.sample_s) / Decimal(noise.dominant_s)).exp()
        )
    ours = [noise.white_v2, noise.flicker_v2, noise.rtn_v2, noise.sigma_v]
    off = np.abs(np.divide(ours, [float(x) for x in (*exact, sigma)]) - 1).max()
    return holds(f"{noise.sigma_v / VOLTS_PER_E:.6g} e- in all, off by {off:.1g}", off <= SEAM)


def through_singularity(distance: float) -> Got:
    """Both sides of τ_RTN = 2τ_D."""
    answers = []
    for sign in (-1, 1):
        noise = noise_of(rtn_s=2 * PAPER["dominant_s"] * (1 + sign * distance))
        with localcontext() as context:
            context.prec = DIGITS
            answers.append(relative(noise.rtn_v2, float(exact_parts(noise)[2]), SEAM, " V²"))
    return together(*answers)


def alone(rtn_s: float, expected_e: float) -> Got:
    """Telegraph noise without the others; the table has five digits."""
    return relative(noise_of(white_nv_per_rthz=0.0, rtn_s=rtn_s).sigma_v / VOLTS_PER_E, expected_e, 3e-5, " e-")


def sampled(engine: Engine, rtn_uv: float, **changes: float) -> Got:
    """The stage in a camera: σ of what it adds."""
    stage = stage_of("source follower noise", source_follower__rtn_uv=rtn_uv, **changes)
    added = engine.through(np.zeros((256, 256)), stage)
    return relative(added.std() / VOLTS_PER_E, stage.sigma_v / VOLTS_PER_E, SIGMAS / math.sqrt(2 * added.size), " e-")


def follower_cases() -> list[Case]:
    """The source follower's noise: its formula, then in a camera."""
    formula = partial(cases_of, "source follower", "source follower noise", asked=ONLY_ONCE)
    camera = partial(cases_of, "source follower", "source follower noise")
    parts, sigma = (
        "white, flicker, telegraph and σ as with 120 digits, to 1e-7 of each",
        "σ of 65 536 pixels within 5 standard errors",
    )
    at_ratio = lambda a: parts_of(noise_of(dominant_s=PAPER["sample_s"] / a))  # noqa: E731
    by_ratio = lambda engine, a: sampled(engine, 100.0, source_follower__cds_dominant_s=1e-6 / a)  # noqa: E731
    by_time = lambda engine, t: sampled(engine, 200.0, source_follower__rtn_s=t)  # noqa: E731
    at_two = lambda: agree(flicker_integral(2.0), 1.115785799, 5e-10)  # noqa: E731
    return [
        *formula("t_s/τ_D = {}", parts, at_ratio, RATIOS),
        *formula("τ_RTN = {} s", parts, lambda t: parts_of(noise_of(rtn_s=t)), TIMES_S),
        *formula("τ_RTN = {0} s, 200 µV alone", "{1} e-", alone, TABLED),
        *formula("τ_RTN = 2τ_D(1 ± {})", "as with 120 digits, to 1e-7", through_singularity, DISTANCES),
        *formula("t_s/τ_D = 2", "J(2) = 1.115785799", at_two),
        *camera("in a camera, t_s/τ_D = {}, 100 µV", sigma, by_ratio, (1e-9, 1e-3, 1.0, 1e3, 1e9)),
        *camera("in a camera, τ_RTN = {} s, 200 µV", sigma, by_time, (1e-9, 1e-6, 1.0)),
    ]


A_SN, V_REF = 5e-6, 3.1


def bent_node(alpha: float) -> Any:
    """A sense node with this much of a bend."""
    gains = {"readout__sense_gain_uv_per_e": 1e6 * A_SN, "readout__v_ref_v": V_REF}
    name = "nonlinear sense node" if alpha > 1e-100 else "sense node"
    return stage_of(name, **gains, readout__ve_nonlinearity=alpha)


def bent(engine: Engine, alpha: float) -> Got:
    """S = −(V_REF/α)·expm1(−α·A_SN·N/V_REF)."""
    electrons = np.concatenate([np.geomspace(1e-3, 2e7, 2000), [1e30]])
    swing = engine.through([electrons], bent_node(alpha), electrons=True)[0]
    exact = -(V_REF / alpha) * np.expm1(-alpha * A_SN * electrons / V_REF)
    rises, top = (np.diff(swing) >= 0).all(), float(swing[-1]) / (V_REF / alpha)
    text = f"rises {'all the way' if rises else 'not'}, ends at {top:.9g} of V_REF/α"
    return together(relative(swing, exact, 8 * engine.unit), holds(text, rises, top <= 1 + 2 * engine.unit))


def inverse(engine: Engine) -> Got:
    """N = −(V_REF/α)/A_SN·log1p(−α·S/V_REF): finite as long as S is below V_REF, and N up to ten full wells."""
    electrons = np.array([0.0, 1.0, 100.0, 33_000.0, 330_000.0])
    swing = engine.through([electrons], bent_node(1.0), electrons=True)[0]
    lost = np.exp(A_SN * electrons / V_REF)  # so many times more roundings where the curve is flatter
    allowed = 8 * engine.unit * np.maximum(electrons * lost, 1.0)
    return agree(-V_REF / A_SN * np.log1p(-swing / V_REF), electrons, allowed, " e-")


def straight(engine: Engine, alpha: float) -> Got:
    """A node that next to does not bend, from the datasheet on."""
    electrons = np.linspace(0, 33_000, 200)[None]
    swing = engine.through(electrons, bent_node(alpha), electrons=True)
    return agree(swing, A_SN * electrons, (8 * engine.unit + alpha) * A_SN * 33_000, " V")


COUPLINGS = (0.0, 5e-324, 0.25, 0.45, 0.49, 0.4999)


def impulse(a: float) -> Got:
    """The answer h to one impulse: Σh² = 1, Σh_i·h_{i+1} = 2a, and h solves the recursion everywhere else."""
    margin = distributions.AR_WARM_UP
    white = np.zeros(4 * margin + 1)
    white[2 * margin] = 1.0
    h = distributions.isotropic_ar(white, a, margin)
    left = np.delete(h[1:-1] - a * (h[:-2] + h[2:]), margin - 1)
    return agree([h @ h, h[1:] @ h[:-1], np.abs(left).max()], [1.0, 2 * a, 0.0], 1e-9)


def columns(engine: Engine, a: float) -> Got:
    """Offsets of 33 e-: variance and neighbours, with the spread of 64 blocks as their sampling error."""
    stage = stage_of("dsnu column", readout__dsnu_col=1e-3, readout__dsnu_col_coupling=a)
    x = engine.through(np.zeros((1, 2**18)), stage)[0].reshape(64, -1) / (33.0 * stage.gain_v_per_e * stage.residual)
    answers = []
    for values, expected in ((x * x, 1.0), (x[:, 1:] * x[:, :-1], 2 * a)):
        blocks = values.mean(axis=1)
        answers.append(agree(blocks.mean(), expected, SIGMAS * standard_error(blocks)))
    return together(*answers)


def node_and_column_cases() -> list[Case]:
    """The sense node, the columns."""
    node = partial(cases_of, "sense node", "nonlinear sense node")
    column = partial(cases_of, "coupled columns", "dsnu column")
    closed = "the closed form to 8 roundings, rising, never beyond V_REF/α"
    walk, apart = "refused: at ½ columns are a random walk", "variance 1, ρ₁ = 2a, within 5 standard errors"
    refused = lambda a: refusal(lambda: table1(readout__dsnu_col_coupling=a), "readout.dsnu_col_coupling is")  # noqa: E731
    return [
        *node("α = {}, 1e-3 … 2e7 and 1e30 e-", closed, bent, (1e-9, 0.01, 1.0)),
        *node("α = 1, back from volts", "the electrons, to 8 roundings", inverse),
        *node("α = {}", "linear", straight, (5e-324, 1e-200, 1e-100, 1e-12)),
        *column("a = {}, one impulse", "variance 1, ρ₁ = 2a, to 1e-9", impulse, COUPLINGS, ONLY_ONCE),
        *column("a = {}, 262 144 columns", apart, columns, COUPLINGS),
        *column("a = {}", walk, refused, (0.5, 0.49991, 1.0, -1e-9), ONLY_ONCE),
    ]


BITS = {1: "uint8", 8: "uint8", 9: "uint16", 12: "uint16", 16: "uint16", 17: "uint32", 24: "uint32"}
"""Resolution → the smallest unsigned type that holds its codes."""


def adc_of(bits: int, black_level_dn: float = 0.0, **more: object) -> Any:
    """A converter of 1 DN/V."""
    return stage_of("adc", adc__bits=bits, adc__full_scale_v=2.0**bits, adc__black_level_dn=black_level_dn, **more)


def resolved(engine: Engine, bits: int, *_: object) -> Got:
    """Half of a frame dark, half of it far too bright."""
    light = np.concatenate([np.zeros((5, 40)), np.full((5, 40), 1e9)])
    digital = expose(light, table1(adc__bits=bits), Exposure(0.0), **engine.how).digital
    ends = digital.max() == 2**bits - 1, digital.min() <= (2**bits - 1) // 8
    return holds(f"{digital.min()} … {digital.max()}, {digital.dtype}", digital.dtype == BITS[bits], *ends)


def rounds(engine: Engine) -> Got:
    """4 bits, A = 1, pedestal 2: halves go up, and both ends hold."""
    swing = [-1e30, -9.0, -2.5, -1.51, -1.5, -0.5, 0.49, 0.5, 12.49, 12.5, 13.0, 99.0, 1e30]
    return agree(engine.through([swing], adc_of(4, 2.0)), [[0, 0, 0, 0, 1, 2, 2, 3, 14, 15, 15, 15, 15]])


def uniform_error(engine: Engine, bits: int) -> Got:
    """A ramp with 100 steps for each code: the error has the σ of a uniform law, 1/√12, and no mean."""
    codes = min(2**bits, 2**14)  # the lowest of them, where a float32 holds a hundredth of a code
    ramp = (np.arange(100 * (codes - 1)) + 0.5) / 100
    error = engine.through([ramp], adc_of(bits))[0] - ramp
    return agree([error.std(), error.mean()], [12**-0.5, 0.0], 1e-3, " LSB")


def missing(engine: Engine) -> Got:
    """DNL −1 at 2 of 16 codes and +1 at a third: those never appear, and the third is twice as wide."""
    places = np.full(16, 100)
    places[[5, 11, 8]] = 0, 0, 200
    ramp = np.arange(-50, 1650) / 100 + 0.005
    codes = engine.through([ramp], adc_of(4, adc__dnl_lsb={"5": -1.0, "11": -1.0, "8": 1.0}))[0]
    count = np.bincount(codes.astype(int), minlength=16)
    return holds(
        f"codes 0 … 15 at {count.tolist()} places", (count[:15] == places[:15]).all(), (np.diff(codes) >= 0).all()
    )


def bend_of(gamma: float) -> Any:
    """The converter's curve with a full scale of 1 V."""
    return stage_of("integral nonlinearity", adc__gamma=gamma, adc__full_scale_v=1.0)


def next_to_straight(engine: Engine, sign: str, offset: float) -> Got:
    """S·γ^(−S/V_FS) = S·(1 − x + x²/2), x = ln γ·S/V_FS = 1e-7 at most: what is cut is below 1e-21."""
    swing = np.linspace(0.01, 1.0, 50)
    x = math.log1p(offset) * swing
    gamma_held = 2e-9 * abs(offset)  # 1 + 1e-7 is held to 1e-16, so its logarithm to 1e-9 of itself
    bent = engine.through([swing], bend_of(1 + offset))[0]
    return relative(bent, swing * (1 - x + x * x / 2), 4 * engine.unit + gamma_held)


def gain_of_one(engine: Engine) -> Got:
    """4096 V of full scale and γ = 1.04, at no swing, half and all of it: the paper's logarithm of A would be 0."""
    camera = table1(adc__full_scale_v=4096.0, adc__gamma=1.04, adc__black_level_dn=0.0, pixel__full_well_e=1e9)
    expected = [0, math.floor(2048 / 1.04**0.5 + 0.5), math.floor(4096 / 1.04 + 0.5)]
    return agree(engine.through([[0.0, 2048.0, 4096.0]], *chain(camera)[-2:])[0], expected)


def rises(engine: Engine, gamma: float) -> Got:
    """From 0 to full scale, in a thousand steps."""
    curve = engine.through([np.linspace(0, 1, 1001)], bend_of(gamma))[0]
    step = float(np.diff(curve).min())
    return holds(f"ends at {curve[-1]:.6g}, smallest step {step:.2g}", step > 0)


def converter_cases() -> list[Case]:
    """Bits, curves, ends."""
    converter = partial(cases_of, "converter")
    adc, bend = partial(converter, "adc"), partial(converter, "integral nonlinearity")
    codes = [(bits, 2**bits - 1, kind) for bits, kind in BITS.items()]
    uniform, formula = "error σ 0.288675 LSB and mean 0, to 0.001", "S·γ^(−S/V_FS) to 4 roundings: nothing cancels"
    bits_refused = lambda bits: refusal(lambda: table1(adc__bits=bits), "adc.bits is")  # noqa: E731
    gamma_refused = lambda name, gamma: refusal(lambda: table1(adc__gamma=gamma), "adc.gamma is")  # noqa: E731
    return [
        *adc("{} bit, darkness and 1e9 photons", "up to {1}, {2}, darkness below ⅛", resolved, codes),
        *adc("{} bit", "refused", bits_refused, (0, 25, -1), ONLY_ONCE),
        *adc("4 bit, swings from −1e30 to 1e30", "half up, 0 and 15 at the ends", rounds),
        *adc("{} bit, a ramp of 100 places per code", uniform, uniform_error, (1, 8, 12)),
        *converter("adc with steps", "4 bit, DNL −1, −1 and +1", "two codes never, one twice as often", missing),
        *bend("γ = 1 {} 1e-7", formula, next_to_straight, (("+", 1e-7), ("−", -1e-7))),
        *converter("integral nonlinearity, adc", "A = 1 DN/V, γ = 1.04", "0, 2008, 3938", gain_of_one),
        *bend("γ = {}", "rises from 0 to full scale", rises, (0.5, 0.9, 2.0, 2.718)),
        *bend("γ = {}", "refused: not monotone", gamma_refused, (("e", math.e), ("3", 3.0)), ONLY_ONCE),
    ]

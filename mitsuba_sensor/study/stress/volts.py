"""Volts and codes: source follower noise at every ratio of its times, non-linear nodes, coupled columns, the ADC."""

from __future__ import annotations

import math
from dataclasses import replace
from decimal import Decimal, localcontext

import numpy as np

from ... import Exposure
from ...core import Array, distributions
from ...lab.statistics.estimators import standard_error
from ...sensor.cds_noise import CdsNoise, flicker_integral
from .case import SIGMAS, Engine, Rows, agree, holds, relative, shown, stage_of, table1, together

DIGITS = 120  # A float64 has up to 75 of them, so that even τ_RTN/2 is exact
EULER_GAMMA = Decimal("0.57721566490153286060651209008240243104215933593992359880576723")  # γ_E (DLMF 5.2.3)
PAPER = CdsNoise(15.0, 1e6, sample_s=1e-6, dominant_s=0.5e-6, rtn_uv=200.0)  # Konnik & Welsh 2014; 200 µV are ours
VOLTS_PER_E = 5e-6
SEAM = 1e-7  # at t_s/τ_D = 1e-4, J = 5e-8 is left of terms of 10, exact to 1e-16; the series there neglects a² = 1e-8
RATIOS, TIMES_S = (1e-9, 1e-6, 1e-4, 0.01, 1.0, 10.0, 100.0, 1e3, 1e6, 1e9), (1e-9, 5e-8, 1e-7, 1e-6, 1e-5, 1e-3, 1.0)
COUPLINGS = (0.0, 5e-324, 0.25, 0.45, 0.49, 0.4999)


def exact_flicker(a: Decimal) -> Decimal:
    """J(a) = γ + ln a − ½[e^(−a)Ei(a) − e^a·E₁(a)]: by the power series of Ei and E₁, and their asymptotic one."""
    common = EULER_GAMMA + a.ln()
    if a > 60:  # terms fall until 2k ≈ a, to e^(−60)
        return common - sum(math.factorial(2 * k + 1) / a ** (2 * k + 2) for k in range(25))
    term, rising, falling = Decimal(1), common, common
    for k in range(1, 400):
        term = term * a / k
        rising, falling = rising + term / k, falling + term / k * (-1) ** k
    return common - (rising / a.exp() + falling * a.exp()) / 2


def exact_parts(noise: CdsNoise) -> tuple[Decimal, Decimal, Decimal, Decimal]:
    """White, flicker and telegraph noise [V²], at the singularity its limit; what all come to at the node [V]."""
    with localcontext(prec=DIGITS):
        density, step = Decimal(noise.white_nv_per_rthz) / 10**9, Decimal(noise.rtn_uv) / 10**6
        t, tau, r = Decimal(noise.sample_s), Decimal(noise.dominant_s), Decimal(noise.rtn_s) / 2
        settled = 1 - (-t / tau).exp()
        white = density**2 * settled / (2 * tau)
        flicker = 2 * density**2 * Decimal(noise.corner_hz) * exact_flicker(t / tau)
        slope = (settled - t / tau * (1 - settled)) / (2 * tau)
        if r != tau:
            slope = (r * (1 - (-t / r).exp()) - tau * settled) / (r**2 - tau**2)
        telegraph = step**2 * r / 2 * slope
        return white, flicker, telegraph, (white + flicker + telegraph).sqrt() / settled


def follower_formulas(_: Engine) -> Rows:
    """The closed forms of the source follower's noise."""
    stage = "source follower noise"
    noises = {f"t_s/τ_D = {shown(a)}": replace(PAPER, dominant_s=1e-6 / a) for a in RATIOS}
    noises |= {f"τ_RTN = {shown(t)} s": replace(PAPER, rtn_s=t) for t in TIMES_S}
    for given, noise in noises.items():
        ours = [noise.white_v2, noise.flicker_v2, noise.rtn_v2, noise.sigma_v]
        off = np.abs(np.divide(ours, [float(x) for x in exact_parts(noise)]) - 1).max()
        got = holds(f"{noise.sigma_v / VOLTS_PER_E:.6g} e- in all, off by {off:.1g}", off <= SEAM)
        yield stage, given, "white, flicker, telegraph and σ as with 120 digits, to 1e-7 of each", got
    for t, expected_e in ((5e-8, 6.6102), (1e-6, 17.8268), (1e-5, 10.1226), (1e-3, 1.1012), (1.0, 0.034855)):
        alone = replace(PAPER, white_nv_per_rthz=0.0, rtn_s=t)  # as in test_cds.py
        got = relative(alone.sigma_v / VOLTS_PER_E, expected_e, 3e-5, " e-")
        yield stage, f"τ_RTN = {shown(t)} s, 200 µV alone", f"{expected_e} e-", got
    for x in (0.0, 1e-15, 1e-12, 1e-9, 1e-6, 0.99e-4, 1.01e-4, 1e-3):  # of τ_RTN from 2τ_D; a series below 1e-4
        sides = [replace(PAPER, rtn_s=1e-6 * (1 + sign * x)) for sign in (-1, 1)]
        got = together(*(relative(noise.rtn_v2, float(exact_parts(noise)[2]), SEAM, " V²") for noise in sides))
        yield stage, f"τ_RTN = 2τ_D(1 ± {shown(x)})", "as with 120 digits, to 1e-7", got
    yield stage, "t_s/τ_D = 2", "J(2) = 1.115785799", agree(flicker_integral(2.0), 1.115785799, 5e-10)


def follower_in_camera(engine: Engine) -> Rows:
    """σ of what the stage adds."""
    given = [(f"t_s/τ_D = {shown(a)}, 100", "cds_dominant_s", 1e-6 / a, 100.0) for a in (1e-9, 1e-3, 1.0, 1e3, 1e9)]
    given += [(f"τ_RTN = {shown(t)} s, 200", "rtn_s", t, 200.0) for t in (1e-9, 1e-6, 1.0)]
    for text, field, value, rtn_uv in given:
        changes = {f"source_follower__{field}": value, "source_follower__rtn_uv": rtn_uv}
        stage = stage_of("source follower noise", **changes)
        added, sigma_e = engine.through(np.zeros((256, 256)), stage), stage.sigma_v / VOLTS_PER_E
        got = relative(added.std() / VOLTS_PER_E, sigma_e, SIGMAS / math.sqrt(2 * added.size), " e-")
        yield stage.label, f"in a camera, {text} µV", "σ of 65 536 pixels within 5 standard errors", got


def sense_node(engine: Engine) -> Rows:
    """S = −(V_REF/α)·expm1(−α·A_SN·N/V_REF), and back."""
    stage, gain, v_ref = "nonlinear sense node", 5e-6, 3.1

    def swing_of(electrons: Array, alpha: float) -> Array:
        return engine.through([electrons], stage_of("sense node", readout__ve_nonlinearity=alpha), electrons=True)[0]

    electrons = np.concatenate([np.geomspace(1e-3, 2e7, 2000), [1e30]])
    for alpha in (1e-9, 0.01, 1.0):
        swing, highest = swing_of(electrons, alpha), v_ref / alpha
        rises, top = (np.diff(swing) >= 0).all(), float(swing[-1]) / highest
        closed = relative(swing, -highest * np.expm1(-gain * electrons / highest), 8 * engine.unit)
        text = f"rises {'all the way' if rises else 'not'}, ends at {top:.9g} of V_REF/α"
        got = together(closed, holds(text, rises, top <= 1 + 2 * engine.unit))
        expected = "the closed form to 8 roundings, rising, never beyond V_REF/α"
        yield stage, f"α = {shown(alpha)}, 1e-3 … 2e7 and 1e30 e-", expected, got
    electrons = np.array([0.0, 1.0, 100.0, 33_000.0, 330_000.0])
    lost = np.maximum(electrons * np.exp(gain * electrons / v_ref), 1.0)  # more roundings where the curve is flatter
    got = agree(-v_ref / gain * np.log1p(-swing_of(electrons, 1.0) / v_ref), electrons, 8 * engine.unit * lost, " e-")
    yield stage, "α = 1, back from volts", "the electrons, to 8 roundings", got
    electrons = np.linspace(0, 33_000, 200)
    for alpha in (5e-324, 1e-200, 1e-100, 1e-12):
        allowed = (8 * engine.unit + alpha) * gain * 33_000
        yield stage, f"α = {shown(alpha)}", "linear", agree(swing_of(electrons, alpha), gain * electrons, allowed, " V")


def column_formulas(_: Engine) -> Rows:
    """The answer h to one impulse: Σh² = 1, Σh_i·h_{i+1} = 2a, and h solves the recursion everywhere else."""
    margin = distributions.AR_WARM_UP
    (white,) = np.eye(1, 4 * margin + 1, 2 * margin)
    for a in COUPLINGS:
        h = distributions.isotropic_ar(white, a, margin)
        left = np.delete(h[1:-1] - a * (h[:-2] + h[2:]), margin - 1)
        got = agree([h @ h, h[1:] @ h[:-1], np.abs(left).max()], [1.0, 2 * a, 0.0], 1e-9)
        yield "dsnu column", f"a = {shown(a)}, one impulse", "variance 1, ρ₁ = 2a, to 1e-9", got


def columns(engine: Engine) -> Rows:
    """Offsets of 33 e-: variance and neighbours, with the spread of 64 blocks as their sampling error."""
    for a in COUPLINGS:
        stage = stage_of("dsnu column", readout__dsnu_col=1e-3, readout__dsnu_col_coupling=a)
        offsets = engine.through(np.zeros((1, 2**18)), stage).reshape(64, -1)
        x = offsets / (33.0 * stage.gain_v_per_e * stage.residual)
        variance, covariance = (x * x).mean(axis=1), (x[:, 1:] * x[:, :-1]).mean(axis=1)
        pairs = (variance, 1.0), (covariance, 2 * a)
        got = together(*(agree(y.mean(), exact, SIGMAS * standard_error(y)) for y, exact in pairs))
        yield "dsnu column", f"a = {shown(a)}, 262 144 columns", "variance 1, ρ₁ = 2a, within 5 standard errors", got


def converter(engine: Engine) -> Rows:
    """Bits and ends."""
    light = np.concatenate([np.zeros((5, 40)), np.full((5, 40), 1e9)])
    kinds = {1: "uint8", 8: "uint8", 9: "uint16", 12: "uint16", 16: "uint16", 17: "uint32", 24: "uint32"}
    for bits, kind in kinds.items():  # the smallest unsigned type that holds the codes
        digital, highest = engine.expose(light, table1(adc__bits=bits), Exposure(0.0)).digital, 2**bits - 1
        good = digital.dtype == kind, digital.max() == highest, digital.min() <= highest // 8
        got = holds(f"{digital.min()} … {digital.max()}, {digital.dtype}", *good)
        yield "adc", f"{bits} bit, darkness and 1e9 photons", f"up to {highest}, {kind}, darkness below ⅛", got
    four_bit = {"adc__bits": 4, "adc__full_scale_v": 16.0, "adc__black_level_dn": 2.0}
    swing = [-1e30, -9.0, -2.5, -1.51, -1.5, -0.5, 0.49, 0.5, 12.49, 12.5, 13.0, 99.0, 1e30]
    got = agree(engine.through([swing], stage_of("adc", **four_bit)), [[0, 0, 0, 0, 1, 2, 2, 3, 14, 15, 15, 15, 15]])
    yield "adc", "4 bit, swings from −1e30 to 1e30", "half up, 0 and 15 at the ends", got
    for bits in (1, 8, 12):
        ramp = (np.arange(100 * (2**bits - 1)) + 0.5) / 100
        adc = stage_of("adc", adc__bits=bits, adc__full_scale_v=2.0**bits, adc__black_level_dn=0.0)
        error = engine.through([ramp], adc)[0] - ramp
        got = agree([error.std(), error.mean()], [12**-0.5, 0.0], 1e-3, " LSB")
        yield "adc", f"{bits} bit, a ramp of 100 places per code", "error σ 0.288675 LSB and mean 0, to 0.001", got
    ramp = np.arange(-250, 1450) / 100 + 0.005
    codes = engine.through([ramp], stage_of("adc", **four_bit, adc__dnl_lsb={"5": -1.0, "11": -1.0, "8": 1.0}))[0]
    count = np.bincount(codes.astype(int), minlength=16).tolist()
    steps = [100 + 100 * (code == 8) - 100 * (code in (5, 11)) for code in range(15)]
    got = holds(f"codes 0 … 15 at {count} places", count[:15] == steps, (np.diff(codes) >= 0).all())
    yield "adc with steps", "4 bit, DNL −1, −1 and +1", "two codes never, one twice as often", got


def converter_curve(engine: Engine) -> Rows:
    """S·γ^(−S/V_FS) at a full scale of 1 V, and in front of a converter of 1 DN/V, where the paper's ln A is 0."""
    stage, swing = "integral nonlinearity", np.linspace(0.01, 1.0, 50)
    for sign, offset in (("+", 1e-7), ("−", -1e-7)):
        x = math.log1p(offset) * swing  # 1e-7 at most: what is cut of 1 − x + x²/2 is below 1e-21
        allowed = 4 * engine.unit + 2e-9 * abs(offset)  # 1 + 1e-7 is held to 1e-16, its logarithm to 1e-9 of itself
        curve = engine.through([swing], stage_of(stage, adc__gamma=1 + offset, adc__full_scale_v=1.0))[0]
        got = relative(curve, swing * (1 - x + x * x / 2), allowed)
        yield stage, f"γ = 1 {sign} 1e-7", "S·γ^(−S/V_FS) to 4 roundings: nothing cancels", got
    camera = table1(adc__full_scale_v=4096.0, adc__gamma=1.04, adc__black_level_dn=0.0, pixel__full_well_e=1e9)
    codes = engine.through([[0.0, 2048.0, 4096.0]], *camera.stages[-2:])[0]
    got = agree(codes, [0, math.floor(2048 / 1.04**0.5 + 0.5), math.floor(4096 / 1.04 + 0.5)])
    yield f"{stage}, adc", "A = 1 DN/V, γ = 1.04", "0, 2008, 3938", got
    for gamma in (0.5, 0.9, 2.0, 2.718):
        curve = engine.through([np.linspace(0, 1, 1001)], stage_of(stage, adc__gamma=gamma, adc__full_scale_v=1.0))[0]
        got = holds(f"ends at {curve[-1]:.6g}, smallest step {(step := np.diff(curve).min()):.2g}", step > 0)
        yield stage, f"γ = {shown(gamma)}", "rises from 0 to full scale", got

"""Volts: the noise of the source follower at every ratio of its times, bent sense nodes, coupled columns."""

from __future__ import annotations

import math
from decimal import Decimal, localcontext
from functools import partial
from typing import Any

import numpy as np

from ...core import distributions
from ...core.exposure import Exposure
from ...core.signals import Electrons
from ...sensor.camera import load_camera
from ...sensor.cds import CdsNoise, flicker_integral
from ...sensor.chain import chain
from ...sensor.volts import DsnuColumn, NonlinearSenseNode, SourceFollowerNoise
from .case import SIGMAS, Case, Engine, Got, largest, near, once, refusal, relative, shown, together

DIGITS = 120
"""A float64 has up to 75 of them, so that even τ_RTN/2 is exact."""
EULER_GAMMA = Decimal("0.57721566490153286060651209008240243104215933593992359880576723")
"""γ_E (DLMF 5.2.3)."""

PAPER = CdsNoise(white_nv_per_rthz=15.0, corner_hz=1e6, sample_s=1e-6, dominant_s=0.5e-6, rtn_uv=200.0)
"""Konnik & Welsh 2014's source follower, with a telegraph step of 200 µV."""
VOLTS_PER_E = 5e-6

SEAM = 1e-7
"""Where its series takes over from it, at t_s/τ_D = 1e-4, J = 5e-8 is what is left of terms of 10: they are exact to
1e-16, so J to a few 1e-8; the series neglects a² = 1e-8 there."""

RATIOS = tuple(10.0**k for k in (-9, -6, -4, -2, 0, 1, 2, 3, 6, 9))
TIMES_S = (1e-9, 5e-8, 1e-7, 1e-6, 1e-5, 1e-3, 1.0)
DISTANCES = (0.0, 1e-15, 1e-12, 1e-9, 1e-6, 0.99e-4, 1.01e-4, 1e-3)
"""Of τ_RTN from 2τ_D, relative, on both sides of where the series takes over (1e-4)."""

TABLED = {5e-8: 6.6102, 1e-6: 17.8268, 1e-5: 10.1226, 1e-3: 1.1012, 1.0: 0.034855}
"""τ_RTN [s] → electrons, printed in tests/sensor/test_cds.py; 1e-6 s is the singularity itself."""


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
    left = lambda time: time * (1 - (-t / time).exp())  # noqa: E731
    slope = (left(r) - left(tau)) / (r**2 - tau**2) if r != tau else (1 - (-a).exp() * (1 + a)) / (2 * tau)
    return white, flicker, step**2 * r / 2 * slope


def parts_of(noise: CdsNoise) -> Got:
    """Each of the three, and what all come to at the node, against 120 digits."""
    with localcontext() as context:
        context.prec = DIGITS
        exact = exact_parts(noise)
        sigma = sum(exact).sqrt() / (1 - (-Decimal(noise.sample_s) / Decimal(noise.dominant_s)).exp())
    pairs = [*zip((noise.white_v2, noise.flicker_v2, noise.rtn_v2), exact, strict=True), (noise.sigma_v, sigma)]
    off = max(abs(ours / float(x) - 1) for ours, x in pairs)
    return Got(f"{noise.sigma_v / VOLTS_PER_E:.6g} e- in all, off by {off:.1g}", off <= SEAM)


def through(distance: float) -> Got:
    """Both sides of τ_RTN = 2τ_D."""
    answers = []
    for sign in (-1, 1):
        noise = replaced(rtn_s=2 * PAPER.dominant_s * (1 + sign * distance))
        with localcontext() as context:
            context.prec = DIGITS
            exact = float(exact_parts(noise)[2])
        answers.append(Got(f"{noise.rtn_v2:.12g} V²", abs(noise.rtn_v2 / exact - 1) <= SEAM))
    return together(answers)


def replaced(**changes: Any) -> CdsNoise:
    """The paper's noise with something changed."""
    return CdsNoise(**(PAPER.__dict__ | changes))


def alone(rtn_s: float, expected_e: float) -> Got:
    """Telegraph noise without the others; the table has five digits."""
    return relative(replaced(white_nv_per_rthz=0.0, rtn_s=rtn_s).sigma_v / VOLTS_PER_E, expected_e, 3e-5, " e-")


def follower(engine: Engine, **change: float) -> Got:
    """The stage in a camera: σ of what it adds."""
    changes = {f"source_follower.{name}": value for name, value in change.items()}
    camera = load_camera("konnik_table1").replace(**changes)
    stage = next(s for s in chain(camera) if isinstance(s, SourceFollowerNoise))
    frame = engine.frame((256, 256), Exposure(0.1))
    (added,) = engine.give([stage(engine.take(np.zeros((256, 256)), frame), frame)], frame)
    error = SIGMAS / math.sqrt(2 * added.size)
    return relative(float(added.std()) / VOLTS_PER_E, stage.sigma_v / VOLTS_PER_E, error, " e-")


A_SN, V_REF = 5e-6, 3.1


def bent(engine: Engine, alpha: float) -> Got:
    """S = −(V_REF/α)·expm1(−α·A_SN·N/V_REF) from 1e-3 to 2e7 e-, and 1e30."""
    electrons = np.concatenate([np.geomspace(1e-3, 2e7, 2000), [1e30]])
    frame = engine.frame((1, electrons.size), Exposure(0.1))
    held = engine.take(electrons[None], frame)
    ((swing,),) = engine.give([NonlinearSenseNode(A_SN, V_REF, alpha)(Electrons(held), frame)], frame)
    exact = -(V_REF / alpha) * np.expm1(-alpha * A_SN * np.minimum(electrons, 1e30) / V_REF)
    off = float(np.abs(swing / exact - 1).max())
    rises, top = bool((np.diff(swing) >= 0).all()), float(swing[-1]) / (V_REF / alpha)
    words = f"off by {off:.1g}, rises {'all the way' if rises else 'not'}, ends at {top:.9g} of V_REF/α"
    return Got(words, off <= 8 * engine.unit and rises and top <= 1 + 2 * engine.unit)


def inverse(engine: Engine) -> Got:
    """N = −(V_REF/α)/A_SN·log1p(−α·S/V_REF): finite as long as S is below V_REF, and N up to ten full wells."""
    electrons = np.array([0.0, 1.0, 100.0, 33_000.0, 330_000.0])
    frame = engine.frame((1, electrons.size), Exposure(0.1))
    held = engine.take(electrons[None], frame)
    ((swing,),) = engine.give([NonlinearSenseNode(A_SN, V_REF, 1.0)(Electrons(held), frame)], frame)
    back = -V_REF / A_SN * np.log1p(-swing / V_REF)
    lost = np.exp(A_SN * electrons / V_REF)  # so many times more roundings where the curve is flatter
    off = float((np.abs(back - electrons) / np.maximum(electrons * lost, 1.0)).max())
    return Got(f"0 … {back[-1]:.8g} e- back, off by {off:.1g}", bool(off <= 8 * engine.unit))


def straight(engine: Engine, alpha: float) -> Got:
    """A node that next to does not bend, from the datasheet on."""
    camera = load_camera("konnik_table1").replace(**{"readout.ve_nonlinearity": alpha})
    node = next(s for s in chain(camera) if s.domain == "volts")
    frame = engine.frame((1, 200), Exposure(0.1))
    electrons = np.linspace(0, 33_000, 200)[None]
    (swing,) = engine.give([node(Electrons(engine.take(electrons, frame)), frame)], frame)
    off = float(np.abs(swing - A_SN * electrons).max()) / (A_SN * 33_000)
    return largest(off, 8 * engine.unit + alpha, "of full swing off by")


COUPLINGS = (0.0, 5e-324, 0.25, 0.45, 0.49, 0.4999)
COLUMNS, BLOCK = 2**18, 2**12


def impulse(a: float) -> Got:
    """The answer h to one impulse: Σh² = 1, Σh_i·h_{i+1} = 2a, and h solves the recursion everywhere else."""
    margin = distributions.AR_WARM_UP
    white = np.zeros(4 * margin + 1)
    white[2 * margin] = 1.0
    h = distributions.isotropic_ar(white, a, margin)
    left = np.delete(h[1:-1] - a * (h[:-2] + h[2:]), margin - 1)
    off = max(abs(float(h @ h) - 1), abs(float(h[1:] @ h[:-1]) - 2 * a), float(np.abs(left).max()))
    return Got(f"Σh² = {h @ h:.12g}, ρ₁ = {h[1:] @ h[:-1]:.10g}", off <= 1e-9)


def columns(engine: Engine, a: float) -> Got:
    """Offsets of 33 e-: variance and neighbours, with the spread of 64 blocks as their sampling error."""
    frame = engine.frame((1, COLUMNS), Exposure(0.1))
    (offsets,) = engine.give([DsnuColumn(33.0, VOLTS_PER_E, a).maps(frame.window)["dsnu_col_e"]], frame)
    x = (offsets.ravel() / 33.0).reshape(-1, BLOCK)
    answers = []
    for name, values, expected in (("variance", x * x, 1.0), ("ρ₁", x[:, 1:] * x[:, :-1], 2 * a)):
        blocks = values.mean(axis=1)
        error = float(blocks.std(ddof=1)) / math.sqrt(blocks.size)
        found = float(blocks.mean())
        answers.append(Got(f"{name} {found:.4f} ± {error:.4f}", abs(found - expected) <= SIGMAS * error))
    return together(answers)


def coupled(a: float) -> Got:
    """The datasheet refuses it."""
    camera = load_camera("konnik_table1")
    return refusal(lambda: camera.replace(**{"readout.dsnu_col_coupling": a}), "readout.dsnu_col_coupling is")


def cases() -> list[Case]:
    """The source follower, the sense node, the columns."""
    return [*_follower_cases(), *_node_cases(), *_column_cases()]


def _follower_cases() -> list[Case]:
    place = "source follower", "source follower noise"
    formula, camera = partial(once, *place), partial(Case, *place)
    digits = "white, flicker, telegraph and σ as with 120 digits, to 1e-7 of each"
    sampled = "σ of 65 536 pixels within 5 standard errors"
    return [
        *(formula(f"t_s/τ_D = {shown(a)}", digits, partial(parts_of, replaced(dominant_s=PAPER.sample_s / a)))
          for a in RATIOS),
        *(formula(f"τ_RTN = {shown(t)} s", digits, partial(parts_of, replaced(rtn_s=t))) for t in TIMES_S),
        *(formula(f"τ_RTN = {shown(t)} s, 200 µV alone", f"{e:g} e-", partial(alone, t, e)) for t, e in TABLED.items()),
        *(formula(f"τ_RTN = 2τ_D(1 ± {shown(d)})", "as with 120 digits, to 1e-7", partial(through, d))
          for d in DISTANCES),
        formula("t_s/τ_D = 2", "J(2) = 1.115785799", lambda: near(flicker_integral(2.0), 1.115785799, 5e-10)),
        *(camera(f"in a camera, t_s/τ_D = {shown(a)}, 100 µV", sampled,
                 partial(follower, cds_dominant_s=1e-6 / a, rtn_uv=100.0)) for a in (1e-9, 1e-3, 1.0, 1e3, 1e9)),
        *(camera(f"in a camera, τ_RTN = {shown(t)} s, 200 µV", sampled, partial(follower, rtn_s=t, rtn_uv=200.0))
          for t in (1e-9, 1e-6, 1.0)),
    ]  # fmt: skip


def _node_cases() -> list[Case]:
    node = partial(Case, "sense node", "nonlinear sense node")
    closed = "the closed form to 8 roundings, rising, never beyond V_REF/α"
    return [
        *(node(f"α = {shown(a)}, 1e-3 … 2e7 and 1e30 e-", closed, partial(bent, alpha=a)) for a in (1e-9, 0.01, 1.0)),
        node("α = 1, back from volts", "the electrons, to 8 roundings", inverse),
        *(node(f"α = {shown(a)}", "linear", partial(straight, alpha=a)) for a in (5e-324, 1e-200, 1e-100, 1e-12)),
    ]


def _column_cases() -> list[Case]:
    place = "coupled columns", "dsnu column"
    sampled, refused = "variance 1, ρ₁ = 2a, within 5 standard errors", "refused: at ½ columns are a random walk"
    return [
        *(once(*place, f"a = {shown(a)}, one impulse", "variance 1, ρ₁ = 2a, to 1e-9", partial(impulse, a))
          for a in COUPLINGS),
        *(Case(*place, f"a = {shown(a)}, 262 144 columns", sampled, partial(columns, a=a)) for a in COUPLINGS),
        *(once(*place, f"a = {shown(a)}", refused, partial(coupled, a)) for a in (0.5, 0.49991, 1.0, -1e-9)),
    ]  # fmt: skip

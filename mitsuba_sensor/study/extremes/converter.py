"""The converter: 1 to 24 bits, curves next to straight, missing codes, both ends."""

from __future__ import annotations

import math
from functools import partial
from typing import Any

import numpy as np

from ...core.exposure import Exposure
from ...sensor.camera import load_camera
from ...sensor.chain import chain
from ...sensor.digital import Adc, AdcWithSteps, IntegralNonlinearity
from ...sensor.expose import expose
from .case import Case, Engine, Got, once, refusal, shown

BITS = {1: "uint8", 8: "uint8", 9: "uint16", 12: "uint16", 16: "uint16", 17: "uint32", 24: "uint32"}
"""Resolution → the smallest unsigned type that holds its codes."""


def outputs(engine: Engine, swing: Any, *stages: Any) -> Any:
    """A line of swings through stages."""
    frame = engine.frame((1, len(swing)), Exposure(0.1))
    signal = engine.take(np.asarray(swing, dtype=np.float64)[None], frame)
    for stage in stages:
        signal = stage(signal, frame)
    return engine.give([signal], frame)[0][0]


def resolved(engine: Engine, bits: int) -> Got:
    """Half of a frame dark, half of it far too bright."""
    camera = load_camera("konnik_table1").replace(**{"adc.bits": bits})
    light = np.concatenate([np.zeros((5, 40)), np.full((5, 40), 1e9)])
    digital = expose(light, camera, Exposure(0.0), **engine.how).digital
    good = digital.dtype == BITS[bits] and digital.max() == 2**bits - 1 and digital.min() <= (2**bits - 1) // 8
    return Got(f"{digital.min()} … {digital.max()}, {digital.dtype}", bool(good))


def bits_refused(bits: int) -> Got:
    """At the door."""
    return refusal(lambda: load_camera("konnik_table1").replace(**{"adc.bits": bits}), "adc.bits is")


def next_to_straight(engine: Engine, offset: float) -> Got:
    """S·γ^(−S/V_FS) = S·(1 − x + x²/2), x = ln γ·S/V_FS = 1e-7 at most: what is cut is below 1e-21."""
    swing = np.linspace(0.01, 1.0, 50)
    x = math.log1p(offset) * swing
    off = np.abs(outputs(engine, swing, IntegralNonlinearity(1 + offset, 1.0)) / (swing * (1 - x + x * x / 2)) - 1)
    gamma_held = 2e-9 * abs(offset)  # 1 + 1e-7 is held to 1e-16, so its logarithm to 1e-9 of itself
    return Got(f"off by {off.max():.1g}", bool(off.max() <= 4 * engine.unit + gamma_held))


def gain_of_one(engine: Engine) -> Got:
    """4096 V of full scale and γ = 1.04, at no swing, half and all of it: the paper's logarithm of A would be 0."""
    change = {"adc.full_scale_v": 4096.0, "adc.gamma": 1.04, "adc.black_level_dn": 0.0, "pixel.full_well_e": 1e9}
    bend, adc = chain(load_camera("konnik_table1").replace(**change))[-2:]
    codes = outputs(engine, [0.0, 2048.0, 4096.0], bend, adc)
    expected = [0, math.floor(2048 / 1.04**0.5 + 0.5), math.floor(4096 / 1.04 + 0.5)]
    return Got(f"A = {adc.gain_dn_per_v:g}: {codes.astype(int).tolist()}", codes.tolist() == expected)


def rises(engine: Engine, gamma: float) -> Got:
    """From 0 to full scale, in a thousand steps."""
    bent = outputs(engine, np.linspace(0, 1, 1001), IntegralNonlinearity(gamma, 1.0))
    step = float(np.diff(bent).min())
    return Got(f"ends at {bent[-1]:.6g}, smallest step {step:.2g}", step > 0)


def rounds(engine: Engine) -> Got:
    """4 bits, A = 1, pedestal 2: halves go up, and both ends hold."""
    swing = [-1e30, -9.0, -2.5, -1.51, -1.5, -0.5, 0.49, 0.5, 12.49, 12.5, 13.0, 99.0, 1e30]
    codes = outputs(engine, swing, Adc(4, 1.0, 2.0))
    return Got(str(codes.astype(int).tolist()), codes.tolist() == [0, 0, 0, 0, 1, 2, 2, 3, 14, 15, 15, 15, 15])


def dithered(engine: Engine, bits: int) -> Got:
    """A ramp with 100 steps for each code: the error has the σ of a uniform law, 1/√12, and no mean."""
    codes = min(2**bits, 2**14)  # the lowest of them, where a float32 holds a hundredth of a code
    ramp = (np.arange(100 * (codes - 1)) + 0.5) / 100
    error = outputs(engine, ramp, Adc(bits, 1.0, 0.0)) - ramp
    good = abs(error.std() - 12**-0.5) <= 1e-3 and abs(error.mean()) <= 1e-3
    return Got(f"σ {error.std():.6f}, mean {error.mean():.1g} LSB", bool(good))


def missing(engine: Engine) -> Got:
    """DNL −1 at 2 of 16 codes and +1 at a third: those never appear, and the third is twice as wide."""
    table = [0.0] * 16
    table[5] = table[11] = -1.0
    table[8] = 1.0
    ramp = np.arange(-50, 1650) / 100 + 0.005
    codes = outputs(engine, ramp, AdcWithSteps(4, 1.0, 0.0, tuple(table)))
    count = np.bincount(codes.astype(int), minlength=16)
    expected = np.array([100, *(100 * (1 + x) for x in table[1:15])])
    good = (count[:15] == expected).all() and (np.diff(codes) >= 0).all()
    return Got(f"code 5: {count[5]}, 8: {count[8]}, 11: {count[11]} of 100 places each", bool(good))


def gamma_refused(gamma: float) -> Got:
    """Where the curve stops being monotone."""
    return refusal(lambda: load_camera("konnik_table1").replace(**{"adc.gamma": gamma}), "adc.gamma is")


def cases() -> list[Case]:
    """Bits, curves, ends."""
    adc, bend = partial(Case, "converter", "adc"), partial(Case, "converter", "integral nonlinearity")
    straight, bent = "S·γ^(−S/V_FS) to 4 roundings: nothing cancels", "refused: not monotone"
    return [
        *(adc(f"{bits} bit, darkness and 1e9 photons", f"up to {2**bits - 1}, {kind}, darkness below ⅛",
              partial(resolved, bits=bits)) for bits, kind in BITS.items()),
        *(once("converter", "adc", f"{bits} bit", "refused", partial(bits_refused, bits)) for bits in (0, 25, -1)),
        adc("4 bit, swings from −1e30 to 1e30", "half up, 0 and 15 at the ends", rounds),
        *(adc(f"{bits} bit, a ramp of 100 places per code", "error σ 0.288675 LSB and mean 0, to 0.001",
              partial(dithered, bits=bits)) for bits in (1, 8, 12)),
        Case("converter", "adc with steps", "4 bit, DNL −1, −1 and +1", "two codes never, one twice as often", missing),
        *(bend(f"γ = 1 {sign} 1e-7", straight, partial(next_to_straight, offset=x))
          for sign, x in (("+", 1e-7), ("−", -1e-7))),
        Case("converter", "integral nonlinearity, adc", "A = 1 DN/V, γ = 1.04", "0, 2008, 3938", gain_of_one),
        *(bend(f"γ = {shown(gamma)}", "rises from 0 to full scale", partial(rises, gamma=gamma))
          for gamma in (0.5, 0.9, 2.0, 2.718)),
        *(once("converter", "integral nonlinearity", f"γ = {words}", bent, partial(gamma_refused, gamma))
          for words, gamma in (("e", math.e), ("3", 3.0))),
    ]  # fmt: skip

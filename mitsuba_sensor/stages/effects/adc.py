"""Analogue-to-digital converter (ADC): volts → codes, with black level, rounding, clipping and DNL."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import accumulate
from typing import Annotated, Self

import numpy as np
from pydantic import Field, model_validator

from ...core import Array, Doubt, Exposure, Frame, arrays
from ...core.types import Float64Array
from ..datasheet import FileTable, NotNegative, Positive, optional
from ..gains import (
    adc_gain_dn_per_v,
    full_scale_v,
    full_well_swing_v,
    sense_gain_v_per_e,
    volts_per_electron,
)
from ..stage import Converter, Datasheet
from ..usual_range import MV_TO_V, Usual
from .reset_noise import reset_noise_v
from .rtn_pixels import rtn_noise_e
from .source_follower_noise import read_noise_v

HALVES_END = 2**23
"""From here on float32 has no halves, and x + ½ would round to even."""

FILLED_MIN, FILLED_MAX = 0.05, 100.0
"""Full well over code range; beyond these, a gain is probably in another unit. 100 is a gain of 40 dB. Cameras at a
gain setting have no maximum."""

BLACK_LEVEL_AT = Exposure(time_s=0.0, temperature_k=298.15)
"""The exposure whose noise determines the default black level."""


class AdcFields(FileTable):
    """The analogue-to-digital converter."""

    bits: Annotated[int, Field(ge=1, le=24, strict=True)] = Field(
        description="resolution [bit]", examples=[12]
    )
    full_scale_v: Annotated[Positive | None, Usual.of(1e-3, 30, MV_TO_V)] = optional(
        "swing of the whole code range V_FS [V]; default: the swing of a full well",
        0.165,
        title="full scale V_FS",
    )
    black_level_dn: NotNegative | None = optional(
        "black level [DN]; default: 4σ of the noise of a bias frame",
        64,
        title="black level, offset μ_y.dark (E)",
    )
    dnl_lsb: dict[str, Annotated[float, Field(ge=-1, strict=True)]] = Field(
        default_factory=dict,
        title="differential non-linearity DNL, missing codes",
        description="code → width of its step minus one [LSB]; -1 is a missing code",
        examples=[{"7": -1.0}],
    )

    @model_validator(mode="after")
    def _codes_exist(self) -> Self:
        for code in self.dnl_lsb:
            if not code.isdecimal() or not 0 < int(code) < 2**self.bits - 1:
                last = 2**self.bits - 2
                raise ValueError(
                    f"dnl_lsb names the code {code!r}; codes with two edges run from 1 to {last}"
                )
        return self

    @model_validator(mode="after")
    def _black_level_is_a_code(self) -> Self:
        highest, black_dn = 2**self.bits - 1, self.black_level_dn or 0.0
        if black_dn > highest:
            raise ValueError(
                f"black_level_dn is {black_dn:g}, but the codes of {self.bits} bits end at {highest}; use a lower "
                "black level or more bits"
            )
        return self

    @classmethod
    def notes_of(cls, camera: Datasheet) -> tuple[str, ...]:
        """Notes if the black level is high, or a full well fills little or much of a given V_FS."""
        bits, black_dn = camera.adc.bits, camera.adc.black_level_dn or 0.0
        highest, filled = 2**bits - 1, full_well_swing_v(camera) / full_scale_v(camera)
        found = []
        if black_dn > highest / 2:
            left = f"leaves {highest - black_dn:.6g} of {highest} codes for light"
            found.append(
                f"adc.black_level_dn is {black_dn:.6g}, which {left}; use a lower one, or more adc.bits"
            )
        most = FILLED_MAX if camera.gain is None else math.inf
        if camera.readout.gain_dn_per_e is None and not FILLED_MIN <= filled <= most:
            found.append(
                f"adc.full_scale_v is {full_scale_v(camera):.4g}; a full well fills {filled:.3g} of it; if the "
                f"highest code is a full well, omit it, or write {full_well_swing_v(camera):.4g}"
            )
        return tuple(map(Doubt, found))


@dataclass(frozen=True)
class Adc(Converter):
    """floor(black level + A·S + ½), clipped to 0 … 2^bits − 1 (paper eq. 10, 35).

    bits : resolution.  gain_dn_per_v : A = 2^bits/V_FS [DN/V].  black_level_dn : the code of darkness [DN].
    """

    bits: int
    gain_dn_per_v: float
    black_level_dn: float
    table = "adc"
    fields = AdcFields
    terms = "A/D converter ADC, A_ADC (J)"
    no_noise = "set adc.bits to 24 for the finest steps"
    label = "ADC"

    @classmethod
    def from_camera(cls, camera: Datasheet) -> Converter:
        """Return the converter, with steps of unequal width if the datasheet has a DNL table."""
        plain = (
            camera.adc.bits,
            adc_gain_dn_per_v(camera),
            default_black_level_dn(camera),
        )
        if not camera.adc.dnl_lsb:
            return Adc(*plain)
        table = [0.0] * 2**camera.adc.bits
        for code, width in camera.adc.dnl_lsb.items():
            table[int(code)] = width
        return AdcWithDnl(*plain, dnl_lsb=tuple(table))

    def sample(self, swing: Array, frame: Frame) -> Array:
        """Return whole digital numbers (H, W), rounded half up."""
        ideal, highest = self.ideal(swing, frame), frame.number(self.highest)
        return arrays.minimum(arrays.maximum(self._rounded(ideal), 0.0), highest)

    @property
    def nominal_gain(self) -> float:
        """A [DN/V]."""
        return self.gain_dn_per_v

    @property
    def highest(self) -> int:
        """The largest code, 2^bits − 1."""
        return int(2**self.bits - 1)

    def _rounded(self, ideal: Array) -> Array:
        """Return the nearest whole number, half up."""
        if self.highest < HALVES_END:
            return arrays.floor(ideal + 0.5)
        below = arrays.floor(ideal)
        return arrays.where(ideal - below < 0.5, below, below + 1.0)


@dataclass(frozen=True)
class AdcWithDnl(Adc):
    """Steps of unequal width: transition levels T_k = (k − ½ + INL_k)·LSB, INL the running sum of the DNL.

    dnl_lsb : (2^bits,) width of every code minus one [LSB], ≥ −1; −1 is a missing code.
    """

    dnl_lsb: tuple[float, ...] = ()
    label = "ADC"

    def sample(self, swing: Array, frame: Frame) -> Array:
        """Return the code whose step contains the swing, (H, W)."""
        return arrays.count_at_or_below(self._transitions, self.ideal(swing, frame))

    @property
    def inl_lsb(self) -> Float64Array:
        """The running sum of the DNL [LSB]."""
        return np.array(self._inl[1:])

    @property
    def _inl(self) -> tuple[float, ...]:
        """INL at the lower edge of every code [LSB]."""
        return tuple(accumulate(self.dnl_lsb, initial=0.0))[:-1]

    @property
    def _transitions(self) -> tuple[float, ...]:
        """Edges between code k − 1 and k, k = 1 … 2^bits − 1 [DN]."""
        return tuple(k - 0.5 + inl for k, inl in enumerate(self._inl) if k)


def default_black_level_dn(camera: Datasheet) -> float:
    """Return the black level as given, else 4σ of all noise and offsets in zero exposure, at most 1/8 of the range."""
    if camera.adc.black_level_dn is not None:
        return float(camera.adc.black_level_dn)
    readout, pixel = camera.readout, camera.pixel
    per_e, residual, well_e = (
        sense_gain_v_per_e(camera),
        readout.dsnu_residual,
        pixel.full_well_e,
    )
    noise_e = math.hypot(
        read_noise_v(camera) / per_e,
        reset_noise_v(camera, BLACK_LEVEL_AT) / per_e,
        rtn_noise_e(camera),
        residual * math.hypot(pixel.dsnu_e, readout.dsnu_col * well_e),
        readout.dsnu_row * well_e,
    )
    noise_e = math.hypot(
        noise_e * math.hypot(1.0, readout.prnu_col),
        readout.row_noise_e,
        readout.column_noise_e,
        readout.frame_noise_e,
    )
    gain = volts_per_electron(camera) * adc_gain_dn_per_v(camera)
    sigma_dn = math.hypot(noise_e * gain, math.sqrt(1 / 12))
    return float(min(math.ceil(4 * sigma_dn), (2**camera.adc.bits - 1) // 8))

"""Integral non-linearity of the ADC: a curve with an end-point linearity error (ILE), S·γ^(−S/V_FS)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Self

from pydantic import Field, model_validator

from ...core import Array, Frame, arrays
from ...core.special import largest, root
from ..datasheet import FileTable, optional
from ..gains import full_scale_v
from ..stage import Datasheet, Stage


class IntegralNonlinearityFields(FileTable):
    """Curve of the converter."""

    gamma: Annotated[float, Field(gt=0, lt=2.718281828459045, strict=True)] | None = optional(
        "integral non-linearity γ: gain at zero over gain at full scale, below e", 1.04
    )
    ile: Annotated[float, Field(ge=0, lt=0.25, strict=True)] | None = optional(
        "the non-linearity as an end-point error, a fraction of full scale", 0.0099
    )

    @model_validator(mode="after")
    def _one_curve(self) -> Self:
        if self.gamma is not None and self.ile is not None:
            raise ValueError(
                "give either gamma or ile, not both; gamma = 1.04 is an ile of 0.0099"
            )
        return self


@dataclass(frozen=True)
class IntegralNonlinearity(Stage):
    """S·γ^(−S/V_FS), that is A^(1−αV) = A·γ^(−V/V_FS) exactly (paper eq. 36-38).

    gamma : gain at zero over gain at full scale, below e for a monotone curve; 1.04 is an ILE of 0.99 %.
    full_scale_v : V_FS [V].
    """

    gamma: float
    full_scale_v: float
    domain = "volts"
    table = "adc"
    fields = IntegralNonlinearityFields
    terms = "integral non-linearity INL, integral linearity error ILE, γ (K)"
    no_noise = "unset adc.gamma and adc.ile"

    @classmethod
    def from_camera(cls, camera: Datasheet) -> IntegralNonlinearity | None:
        """Return None for a linear converter."""
        adc = camera.adc
        if adc.ile is not None:
            gamma = gamma_of_ile(adc.ile)
        else:
            gamma = adc.gamma
        if gamma in (None, 1.0):
            return None
        return cls(gamma, full_scale_v(camera))

    def sample(self, swing: Array, frame: Frame) -> Array:
        """Return the swing after the curve, also for A = 1, since no logarithm of the gain is needed."""
        if self.gamma == 1:
            return swing
        return swing * arrays.exp(frame.number(-self._rate) * swing)

    @property
    def _rate(self) -> float:
        return arrays.scalar_log(self.gamma) / self.full_scale_v


def gamma_of_ile(ile: float) -> float:
    """Return γ of an end-point error ``ile``, the maximum over x of x·γ^(1−x) − x; 0.04 → 1.16633."""
    if ile:
        return root(lambda gamma: end_point_ile(gamma) - ile, 1.0, 2.7)
    return 1.0


def end_point_ile(gamma: float) -> float:
    """Return the end-point error of γ, a fraction of full scale; 1.04 → 0.0099."""
    k = arrays.scalar_log(gamma)
    return largest(lambda x: x * arrays.scalar_exp(k * (1 - x)) - x, 0.0, 1.0)

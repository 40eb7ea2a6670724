"""Components of the dark signal: fractions of the pixels with a separate distribution (paper, long exposures)."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import accumulate
from typing import Annotated, Any, Literal, Self

from pydantic import Field, model_validator

from ..core import Exposure, Frame, SensorWindow, arrays
from ..core.backend import Backend, uniforms
from .dark_current_models import FIGURE_OF_MERIT_AT_K, arrhenius
from .datasheet import Chance, FileTable, Kelvin, NotNegative, Positive, optional
from .stage import Datasheet

MIDGAP_EV = 0.56
"""Half of the band gap of silicon: generation at deep centres in the depletion region, which makes the hot pixels
(Widenhorn et al., Proc. SPIE 4669, 193, 2002: 222–291 K; 0.5–0.65 eV from pixel to pixel)."""

Activation = Annotated[float, Field(ge=0, le=2, strict=True)]
Reference = Annotated[float, Field(ge=50, strict=True)]


class DarkComponentSection(FileTable):
    """A fraction of the pixels whose mean dark signal has a separate distribution."""

    weight: Chance = Field(description="fraction of the pixels", examples=[0.001])
    family: Literal["uniform", "normal"] = Field(
        description="distribution of the component", examples=["uniform"]
    )
    low: NotNegative | None = optional("lower end of a uniform component [unit]", 45)
    high: Positive | None = optional("upper end of a uniform component [unit]", 440)
    mean: Positive | None = optional("mean of a normal component [unit]", 18)
    sigma: NotNegative | None = optional("σ of a normal component [unit]", 4)
    unit: Literal["e_per_s", "e", "dn"] = Field(
        description="unit of this component; e and dn do not depend on the exposure time",
        examples=["dn"],
    )
    at_temperature_k: Annotated[Reference | None, Kelvin] = optional(
        "temperature of the numbers [K]; default: dark_current.at_temperature_k or 300 K",
        298.15,
    )
    activation_ev: Activation = optional(
        "activation energy E_a [eV]; 0 for a signal that no cooling changes", 0.56, MIDGAP_EV
    )

    @model_validator(mode="after")
    def _complete(self) -> Self:
        wanted, other = (("low", "high"), ("mean", "sigma"))[
            :: 1 if self.family == "uniform" else -1
        ]
        if any(getattr(self, name) is None for name in wanted) or any(
            getattr(self, name) is not None for name in other
        ):
            raise ValueError(
                f"a {self.family} component has {wanted[0]} and {wanted[1]}, and neither {other[0]} nor {other[1]}"
            )
        if self.low is not None and self.high is not None and self.high <= self.low:
            raise ValueError(
                f"low is {self.low:g} and high is {self.high:g}; high must be the larger"
            )
        return self


@dataclass(frozen=True)
class DarkComponent:
    """Distribution of the mean dark signal of a fraction ``weight`` of the pixels, instead of the main distribution.

    family : "uniform" on [first, second], or "normal" with mean first and σ second, cut at 0.
    e_per_unit : electrons per unit of the numbers [e-].
    per_second : True for rates; False for numbers that hold for an exposure of any time.
    at_temperature_k, activation_ev : temperature T_ref of the numbers [K]; at T they are exp(E_a/k·(1/T_ref − 1/T))
        times as large.
    """

    weight: float
    family: Literal["uniform", "normal"]
    first: float
    second: float
    e_per_unit: float = 1.0
    per_second: bool = False
    at_temperature_k: float = FIGURE_OF_MERIT_AT_K
    activation_ev: float = 0.0

    def electrons(self, quantile: Any, frame: Frame) -> Any:
        """Return the mean dark electrons for quantiles from 0 to 1, shape (H, W)."""
        if self.family == "uniform":
            value = frame.number(self.first) + frame.number(self.second - self.first) * quantile
        else:
            z = frame.window.backend.normal_of(quantile)
            value = arrays.maximum(
                frame.number(self.first) + frame.number(self.second) * z, 0.0
            )
        return frame.number(self.unit_e(frame.exposure)) * value

    def unit_e(self, exposure: Exposure) -> float:
        """Return one unit of the numbers at this time and temperature [e-]."""
        thermal = arrhenius(exposure.temperature_k, self.at_temperature_k, self.activation_ev)
        return self.e_per_unit * thermal * (exposure.time_s if self.per_second else 1.0)


def reference_temperature_k(camera: Datasheet) -> float:
    """Return the temperature of dark signals without their own: dark_current.at_temperature_k, else 300 K."""
    return float(camera.dark_current.at_temperature_k or FIGURE_OF_MERIT_AT_K)


def superimpose(parts: tuple[DarkComponent, ...], main: Any, frame: Frame) -> Any:
    """Return mean dark electrons, shape (H, W); each pixel has the main distribution or one component."""
    maps = component_maps(parts, frame.window)
    dark = main
    for number, part in enumerate(parts, start=1):
        value = part.electrons(maps["dark_component_quantile"], frame)
        dark = arrays.where(maps["dark_component"] == number, value, dark)
    return dark


def component_maps(parts: tuple[DarkComponent, ...], window: SensorWindow) -> dict[str, Any]:
    """Return ``dark_component``, the component of each pixel, and ``dark_component_quantile``, its quantile."""
    number = _Number(tuple(accumulate(part.weight for part in parts)))
    return {
        "dark_component": window.measured_or(
            "dark_component", lambda: window.fixed_map("dark_component", number)
        ),
        "dark_component_quantile": window.measured_or(
            "dark_component_quantile", lambda: window.fixed_map("dark_fpn", uniforms)
        ),
    }


@dataclass(frozen=True)
class _Number:
    """Number of the component from random bits: 1 below the first edge, 2 below the second, …, 0 above the last."""

    edges: tuple[float, ...]

    def __call__(self, backend: Backend, bits: Any) -> Any:
        chance = backend.uniform(bits)
        number = 1 + arrays.count_at_or_below(self.edges, chance)
        return arrays.where(
            chance < backend.number(self.edges[-1]), number, backend.number(0.0)
        )

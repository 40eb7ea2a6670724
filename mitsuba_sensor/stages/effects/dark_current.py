"""Dark current and its non-uniformity (DSNU of the dark signal): mean dark electrons = t·D_R(T)·X, X a fixed map."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from ...core import Array, Electrons, Exposure, Frame, SensorWindow, arrays
from ..dark_components import (
    DarkComponent,
    DarkComponentSection,
    component_maps,
    reference_temperature_k,
    superimpose,
)
from ..dark_current_models import DarkCurrentModel, Doubling, FigureOfMerit, Measured, Mpp
from ..datasheet import FileTable, Kelvin, MapCoupling, NotNegative, Positive, optional
from ..fpn_distributions import (
    Autoregressive,
    FpnDistribution,
    Gamma,
    Gaussian,
    Logistic,
    LogNormal,
    Wald,
    require_drawable,
)
from ..gains import gain_dn_per_e
from ..stage import Datasheet, Stage, cut_to_zero
from ..usual_range import AMPERES_TO_NA, PA_TO_NA, PERCENT, Usual

DISTRIBUTIONS = {
    "gaussian": Gaussian,
    "lognormal": LogNormal,
    "gamma": Gamma,
    "wald": Wald,
    "logistic": Logistic,
}


NOTED = 0.01
"""Part of the standard deviation over the pixels whose loss is worth a note."""


class DarkCurrentFields(FileTable):
    """Dark electrons: a figure of merit at 300 K, or a measured rate."""

    fom_na_per_cm2: Annotated[
        NotNegative | None, Usual.of(1e-5, 1e3, AMPERES_TO_NA, PA_TO_NA)
    ] = optional(
        "dark current per area at 300 K, instead of rate_e_per_s [nA/cm²]",
        1.0,
        title="dark-current figure of merit D_FM (J)",
    )
    diffusion_fom_na_per_cm2: NotNegative | None = optional(
        "dark current per area at 300 K from the bulk of an MPP pixel [nA/cm²]",
        0.01,
        title="MPP dark current: diffusion part",
    )
    rate_e_per_s: NotNegative | None = optional(
        "dark current at at_temperature_k, instead of fom_na_per_cm2 [e-/s per pixel]", 5
    )
    at_temperature_k: Annotated[Annotated[float, Field(ge=50, strict=True)] | None, Kelvin] = (
        optional("temperature of rate_e_per_s [K]", 298.15)
    )
    doubling_k: Annotated[Positive | None, Usual(2, 30)] = optional(
        "temperature rise that doubles the rate [K]; default: the rate follows silicon",
        7.0,
        title="doubling temperature T_d (E)",
    )
    cv: Annotated[NotNegative, Usual.of(0, 10, PERCENT)] = optional(
        "non-uniformity D_N of the dark current: σ over mean",
        0.1,
        0.0,
        title="dark-current FPN D_N (J), DCNU",
    )
    distribution: Literal["gaussian", "lognormal", "gamma", "wald", "logistic", "ar"] = (
        optional("distribution of the dark current over the pixels", "lognormal", "lognormal")
    )
    coupling: MapCoupling = optional(
        "correlation a of neighbouring pixels, for the distribution ar",
        0.25,
        0.0,
    )
    components: tuple[DarkComponentSection, ...] = optional(
        "superimposed components of the distribution",
        [{"weight": 0.001, "family": "uniform", "low": 45, "high": 440, "unit": "dn"}],
        (),
        title="hot pixels, superimposed distributions",
    )

    @model_validator(mode="after")
    def _one_model(self) -> Self:
        figure, rate = self.fom_na_per_cm2 is not None, self.rate_e_per_s is not None
        if figure and rate:
            raise ValueError(
                "give either fom_na_per_cm2 or rate_e_per_s (with at_temperature_k), not both"
            )
        if not figure and not rate:
            raise ValueError(
                "the dark current is missing; give rate_e_per_s [e-/s] with at_temperature_k [K], or fom_na_per_cm2 "
                "[nA/cm²]; rate_e_per_s = 0 is none"
            )
        if self.rate_e_per_s and self.at_temperature_k is None:
            raise ValueError(
                f"rate_e_per_s is {self.rate_e_per_s:g}, but its temperature is missing; give at_temperature_k [K], "
                "e.g. 298.15 for 25 °C"
            )
        if self.at_temperature_k is not None and not rate:
            raise ValueError(
                "at_temperature_k is the temperature of rate_e_per_s; fom_na_per_cm2 is at 300 K: omit at_temperature_k"
            )
        if self.doubling_k is not None and not rate:
            raise ValueError(
                "doubling_k needs rate_e_per_s and at_temperature_k; fom_na_per_cm2 has its own temperature dependence"
            )
        if self.diffusion_fom_na_per_cm2 is not None and not figure:
            raise ValueError(
                "diffusion_fom_na_per_cm2 needs fom_na_per_cm2, the depletion part; give both"
            )
        if (weights := sum(component.weight for component in self.components)) > 1:
            raise ValueError(f"the weights of components add up to {weights:g}; at most 1")
        if self.distribution != "ar" and self.coupling:
            raise ValueError(
                'coupling needs distribution = "ar"; the other distributions have independent pixels'
            )
        require_drawable(
            "cv",
            self.cv,
            DISTRIBUTIONS.get(self.distribution, Autoregressive),
            self.distribution,
        )
        return self

    @classmethod
    def notes_of(cls, camera: Datasheet) -> tuple[str, ...]:
        """A note if the finite random numbers lose more than 1 % of the standard deviation over the pixels."""
        dark = camera.dark_current
        if dark.distribution != "lognormal" or not dark.cv:
            return ()
        drawn = LogNormal(dark.cv).drawn_cv
        if drawn >= (1 - NOTED) * dark.cv:
            return ()
        return (
            f"dark_current.cv is {dark.cv:g}, but σ over mean of the drawn pixels is {drawn:.3g}: the rest lies beyond "
            "6.3 σ of the log-normal distribution, where random numbers of 32 bits end; use a lower cv, or "
            'distribution = "wald"',
        )


@dataclass(frozen=True)
class DarkCurrent(Stage):
    """Adds mean dark electrons t·D_R(T)·X, X a fixed map of mean 1 (paper eq. 16, 18).

    model : D_R(T) in e-/s.  distribution : of X; its coefficient of variation is D_N, 0.1–0.4 typical.
    components : fractions of the pixels with another distribution instead, also if a map is given.
    """

    model: DarkCurrentModel
    distribution: FpnDistribution
    components: tuple[DarkComponent, ...] = ()
    domain = "electrons"
    table = "dark_current"
    fields = DarkCurrentFields
    terms = "dark current μ_I (E), D_R (J), dark electrons"

    @classmethod
    def from_camera(cls, camera: Datasheet) -> DarkCurrent:
        """Return the stage with the temperature model, distribution and components of the datasheet."""
        dark = camera.dark_current
        if dark.distribution == "ar":
            distribution = Autoregressive(dark.cv, dark.coupling)
        else:
            distribution = None
        return cls(
            dark_current_model(camera),
            distribution or DISTRIBUTIONS[dark.distribution](dark.cv),
            dark_components(camera),
        )

    def sample(self, electrons: Electrons, frame: Frame) -> Electrons:
        """Return photoelectrons and the mean dark electrons of this exposure."""
        mean = self.mean_e(frame)
        flat = self.distribution.cv == 0 and "dark_fpn" not in frame.window.given
        dark = 0.0
        if mean:
            dark = frame.number(mean)
        if mean and not flat:
            dark = arrays.product(dark, self.fpn_maps(frame.window)["dark_fpn"])
        if self.components:
            dark = superimpose(self.components, dark, frame)
        return replace(electrons, dark=electrons.dark + dark)

    def mean_e(self, frame: Frame) -> float:
        """Return the mean dark electrons of a pixel of the main component in this exposure."""
        return frame.exposure.time_s * self.model.rate_e_per_s(frame.exposure.temperature_k)

    def fpn_maps(self, window: SensorWindow) -> dict[str, Array]:
        """Return ``dark_fpn``, the dark current of every pixel over the mean, and the maps of the components."""
        main = window.measured_or(
            "dark_fpn", lambda: self.distribution.map_of(window, "dark_fpn")
        )
        return {"dark_fpn": main} | (
            component_maps(self.components, window) if self.components else {}
        )

    def marked(self, signal: Array, frame: Frame) -> dict[str, Array]:
        """Return the mask of pixels whose dark current would be negative."""
        return cut_to_zero(self, "dark_fpn", self.distribution.cv, frame.window)


def mean_dark_e(camera: Datasheet, exposure: Exposure) -> float:
    """Return the mean dark electrons of a pixel of the main component; 0 if dark current is switched off."""
    if DarkCurrent.key() in camera.sensor.without:
        return 0.0
    return exposure.time_s * dark_current_model(camera).rate_e_per_s(exposure.temperature_k)


def dark_current_model(camera: Datasheet) -> DarkCurrentModel:
    """Return the temperature dependence of this camera's dark current."""
    dark = camera.dark_current
    area_cm2 = camera.pixel.pitch_x_um * camera.pixel.pitch_y_um * 1e-8
    if dark.fom_na_per_cm2 is not None:
        if dark.diffusion_fom_na_per_cm2 is not None:
            return Mpp(dark.diffusion_fom_na_per_cm2, dark.fom_na_per_cm2, area_cm2)
        return FigureOfMerit(dark.fom_na_per_cm2, area_cm2)
    rate, at = dark.rate_e_per_s or 0.0, dark.at_temperature_k or 300.0
    if dark.doubling_k is None:
        return Measured(rate, at)
    return Doubling(rate, at, dark.doubling_k)


def dark_components(camera: Datasheet) -> tuple[DarkComponent, ...]:
    """Return the superimposed dark signals, in electrons."""
    unit = {"e": 1.0, "e_per_s": 1.0, "dn": 1 / gain_dn_per_e(camera)}
    return tuple(
        DarkComponent(
            part.weight,
            part.family,
            *((part.low, part.high) if part.family == "uniform" else (part.mean, part.sigma)),
            e_per_unit=unit[part.unit],
            per_second=part.unit == "e_per_s",
            at_temperature_k=part.at_temperature_k or reference_temperature_k(camera),
            activation_ev=part.activation_ev,
        )
        for part in camera.dark_current.components
    )

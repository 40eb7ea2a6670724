"""Types and ranges of the fields of camera files, and the tables of sensor and pixel; effects/ declares the others."""

from __future__ import annotations

import math
from collections.abc import Mapping
from itertools import pairwise
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal, Self

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, model_validator

from ..core import InputError
from .pixel_aperture import PixelAperture, aperture_value
from .usual_range import (
    CELSIUS,
    METRES_TO_NM,
    METRES_TO_UM,
    MM_TO_UM,
    MS_TO_US,
    NM_TO_UM,
    NS_TO_US,
    PERCENT,
    SECONDS_TO_US,
    UM_TO_NM,
    Usual,
)

if TYPE_CHECKING:
    from ..camera.camera import Camera

Positive = Annotated[
    float, Field(ge=1e-30, le=1e30, strict=True)
]  # beyond, variances under- and overflow
NotNegative = Annotated[float, Field(ge=0, le=1e30, strict=True)]
Fraction = Annotated[float, Field(gt=0, le=1, strict=True)]
Count = Annotated[int, Field(ge=1, strict=True)]
Side = Annotated[int, Field(ge=1, le=10**6, strict=True)]
Chance = Annotated[float, Field(ge=0, le=1, strict=True)]
Angle = Annotated[float, Field(ge=0, lt=180, strict=True)]
LineCoupling = Annotated[float, Field(ge=0, le=0.4999, strict=True)]
MapCoupling = Annotated[float, Field(ge=0, le=0.45, strict=True)]
Pitch = Annotated[Positive, Usual.of(0.3, 200, METRES_TO_UM, MM_TO_UM, NM_TO_UM)]
Kelvin = Usual.of(65, 500, CELSIUS)
Nanometres = Usual.of(100, 3000, UM_TO_NM, METRES_TO_NM)
ByWavelength = float | tuple[float, ...]
SensitivityMap = tuple[tuple[NotNegative, ...], ...]
SAME_AREA = 0.01
"""Largest relative difference between the fill factor and the area of the pixel's aperture."""


class FileTable(BaseModel):
    """A table of a camera file: frozen, equal by value, no unknown fields, no NaN.

    cmos_only : fields that a CCD cannot have.
    """

    cmos_only: ClassVar[tuple[str, ...]] = ()
    model_config = ConfigDict(
        frozen=True, extra="forbid", allow_inf_nan=False, defer_build=True
    )

    @classmethod
    def notes_of(cls, camera: Camera) -> tuple[str, ...]:
        """Notes on allowed but unusual values of these fields in this camera."""
        return ()

    def __dir__(self) -> list[str]:
        """Public names of the table, without those of pydantic's base class."""
        return [
            name
            for name in super().__dir__()
            if name[0] != "_" and not hasattr(BaseModel, name)
        ]

    def __setattr__(self, name: str, value: object) -> None:
        """Raise InputError: fields are not changed in place."""
        if name in type(self).model_fields:
            raise InputError(
                f"{name} cannot be changed in place; camera.replace(**{{'adc.bits': 10}}) returns a changed camera."
            )
        super().__setattr__(name, value)

    def __hash__(self) -> int:
        """Hash of the values, by which tables are compared."""
        return hash(
            (type(self), *(_hashable(getattr(self, name)) for name in type(self).model_fields))
        )

    def _is_table(self, name: str, axis_name: str) -> bool:
        """Return whether values and their increasing positions are given; ValueError if they do not match."""
        values, axis = getattr(self, name), getattr(self, axis_name)
        if (values is None) != (axis is None):
            raise ValueError(f"give both {name} and {axis_name}, or neither")
        if values is None:
            return False
        if len(values) != len(axis) or len(values) < 2:
            raise ValueError(
                f"{name} has {len(values)} values for {len(axis)} {axis_name}; give as many of each, at least 2"
            )
        if any(b <= a for a, b in pairwise(axis)):
            raise ValueError(f"{axis_name} must increase from each point to the next")
        return True


def _hashable(value: object) -> object:
    """Return the value with lists as tuples and tables as sets of pairs."""
    if isinstance(value, Mapping):
        return frozenset((key, _hashable(inner)) for key, inner in value.items())
    if isinstance(value, list | tuple):
        return tuple(map(_hashable, value))
    return value


def optional(
    description: str, example: object, default: Any = None, title: str | None = None
) -> Any:
    """Declare a field that a camera file may omit.  title : its name in the literature, for the glossary."""
    return Field(default, title=title, description=description, examples=[example])


class CameraTable(FileTable):
    """A table of a camera file whose fields come from the effects of the chain (Camera combines them)."""

    if TYPE_CHECKING:

        def __getattr__(self, name: str) -> Any: ...


def _numbers_from(low: float, high: float, example: float) -> BeforeValidator:
    """Return a check of one number, or one for each wavelength, within these limits."""

    def checked(value: object) -> object:
        numbers = value if isinstance(value, list | tuple) else (value,)
        for number in numbers:
            if value is None:
                continue
            if type(number) not in (int, float) or not low <= number <= high:
                raise ValueError(
                    f"{number!r} is not a number from {low:g} to {high:g}; give one for all, or one for each of "
                    f"quantum_efficiency.wavelengths_nm, e.g. {example:g}"
                )
        if isinstance(value, list | tuple):
            return tuple(map(float, value))
        return value

    return BeforeValidator(checked)


class SensorSection(FileTable):
    """The sensor."""

    technology: Literal["cmos", "ccd"] = Field(
        title="CCD, CMOS", description="determines the stages of the chain", examples=["cmos"]
    )
    columns: Side = Field(description="pixels in a row", examples=[1900])
    rows: Side = Field(description="pixels in a column", examples=[1300])
    shutter: Literal["global", "rolling"] = optional(
        "whether all rows expose at once, or one after the other from the top",
        "rolling",
        "global",
        title="global shutter, rolling shutter",
    )
    row_time_us: Annotated[
        Positive | None, Usual.of(0.5, 1e4, SECONDS_TO_US, MS_TO_US, NS_TO_US)
    ] = optional(
        "time between the starts of successive rows of a rolling shutter [µs]",
        15.0,
        title="row time, line time",
    )
    polarizers: tuple[tuple[Angle, ...], ...] | None = optional(
        "repeating tile of the polarisers' transmission axes, counter-clockwise from the row "
        "direction in the image [°]",
        [[90, 45], [135, 0]],
        title="polariser mosaic, analyser",
    )
    extinction_ratio: Annotated[ByWavelength | None, _numbers_from(1, 1e6, 300)] = optional(
        "extinction ratio τ_max/τ_min of the polarisers: one, or one per wavelengths_nm of "
        "quantum_efficiency",
        300,
        title="extinction ratio, contrast of polarisers",
    )
    polarizer_transmission: Annotated[ByWavelength | None, _numbers_from(1e-6, 1, 0.9)] = (
        optional(
            "transmission τ_max along the axis: one, or one per wavelengths_nm of "
            "quantum_efficiency; default 1",
            0.9,
            title="transmittance of polarisers",
        )
    )
    dual_pixel: Annotated[bool, Field(strict=True)] = optional(
        "two photodiodes side by side under each microlens, each sees half of the pupil",
        True,
        False,
        title="dual pixel, dual photodiode (2PD), phase-detection autofocus (PDAF)",
    )
    without: tuple[str, ...] = optional(
        "noise sources to switch off, by the keys of their stages",
        ["shot_noise"],
        (),
        title="noise source switched off",
    )

    @property
    def polarizer_periods(self) -> tuple[int, int]:
        """Rows and columns of the polariser tile; (1, 1) without polarisers."""
        tile = self.polarizers or ((0.0,),)
        return len(tile), len(tile[0])

    @model_validator(mode="after")
    def _polarizers_are_complete(self) -> Self:
        tile = self.polarizers
        if tile is None:
            for name in ("extinction_ratio", "polarizer_transmission"):
                if getattr(self, name) is not None:
                    raise ValueError(
                        f"{name} is given without polarizers; give their angles, e.g. [[90, 45], [135, 0]], or unset "
                        f"{name}"
                    )
            return self
        if self.extinction_ratio is None:
            raise ValueError("polarizers need extinction_ratio, τ_max/τ_min, e.g. 300")
        if not tile or not tile[0] or any(len(row) != len(tile[0]) for row in tile):
            raise ValueError(
                "polarizers must be a rectangle of angles: rows of equal length, none empty"
            )
        return self

    @model_validator(mode="after")
    def _rolls_with_a_row_time(self) -> Self:
        if self.shutter == "rolling" and self.row_time_us is None:
            raise ValueError(
                "a rolling shutter needs row_time_us, the datasheet's line time [µs], e.g. 15"
            )
        return self


SlantAngle = Annotated[float, Field(ge=0, le=90, strict=True)]
SLANT_TABLES = (
    ("angular_response", "angular_response_deg"),
    ("microlens_cra_deg", "microlens_cra_heights_mm"),
)
"""Values, and their positions."""


class MicrolensFields(CameraTable):
    """The microlenses: the response to oblique light, and their shift towards the lens."""

    angular_response: tuple[Chance, ...] | None = optional(
        "relative response to light at these angles to the design angle of the microlens",
        [1.0, 0.95, 0.7, 0.3],
        title="angular response, angle of incidence",
    )
    angular_response_deg: tuple[SlantAngle, ...] | None = optional(
        "angles of angular_response, from 0 [°]",
        [0.0, 10.0, 20.0, 30.0],
    )
    microlens_cra_deg: tuple[SlantAngle, ...] | None = optional(
        "chief-ray angles that the microlenses are designed for; default: 0 everywhere [°]",
        [0.0, 12.0, 25.0],
        title="chief-ray angle (CRA), microlens shift",
    )
    microlens_cra_heights_mm: tuple[NotNegative, ...] | None = optional(
        "image heights of microlens_cra_deg, from 0 [mm]", [0.0, 1.5, 3.0]
    )

    @model_validator(mode="after")
    def _slants_are_tables(self) -> Self:
        for name, axis_name in SLANT_TABLES:
            if self._is_table(name, axis_name) and getattr(self, axis_name)[0] != 0:
                raise ValueError(f"{axis_name} must begin at 0")
        if self.angular_response is not None and self.angular_response[0] != 1:
            raise ValueError(
                f"angular_response begins with {self.angular_response[0]:g}; it must be 1 at the angle 0"
            )
        if self.microlens_cra_deg is not None and self.angular_response is None:
            raise ValueError(
                "microlens_cra_deg has no effect without angular_response; give the response to oblique light"
            )
        return self


class PixelGeometry(MicrolensFields):
    """One pixel."""

    pitch_x_um: Pitch = Field(
        title="pixel pitch, pixel width", description="width of a pixel [µm]", examples=[5.7]
    )
    pitch_y_um: Pitch = Field(
        title="pixel height", description="height of a pixel [µm]", examples=[5.7]
    )
    fill_factor: Annotated[Fraction, Usual.of(0.05, 1, PERCENT)] = Field(
        title="fill factor", description="light-sensitive fraction of the pixel", examples=[0.5]
    )
    aperture: Annotated[
        Literal["full", "square"] | tuple[Fraction, Fraction] | SensitivityMap,
        BeforeValidator(aperture_value),
    ] = optional(
        "light-collecting part of the pixel: full (a microlens), a central square of the fill"
        " factor, width and height as fractions of the pitch, or rows of relative sensitivity"
        " (also a .csv file)",
        "square",
        "full",
        title="pixel aperture, pixel MTF, sensitivity within the pixel",
    )

    @property
    def aperture_shape(self) -> PixelAperture:
        """The light-collecting part of the pixel."""
        if self.aperture == "full":
            return PixelAperture()
        if self.aperture == "square":
            side_um = math.sqrt(self.fill_factor * self.pitch_x_um * self.pitch_y_um)
            return PixelAperture((side_um / self.pitch_x_um, side_um / self.pitch_y_um))
        if isinstance(self.aperture[0], tuple):
            return PixelAperture.of_map(self.aperture)
        return PixelAperture(self.aperture)

    @model_validator(mode="after")
    def _aperture_has_the_fill_factor(self) -> Self:
        if (largest := max(self.aperture_shape.sides)) > 1 + 1e-9:
            raise ValueError(
                f"aperture is 'square' and its side would be {largest:.3g} times the smaller pitch, more than 1; give "
                "its two sides, e.g. [0.9, 0.6]"
            )
        if isinstance(self.aperture, tuple) and self.fill_factor < 1:
            area = self.aperture_shape.area
            if abs(area / self.fill_factor - 1) > SAME_AREA:
                raise ValueError(
                    f"aperture covers {area:.3g} of the pixel's area and fill_factor is {self.fill_factor:g}; make "
                    "the product of its sides, or the mean of its map over the maximum, equal to fill_factor, or set "
                    "fill_factor to 1 if the quantum efficiency is that of the whole pixel"
                )
        return self

"""Datasheet section [lens]: f-number, transmission, relative illumination, distortion, or a lens prescription."""

from collections.abc import Iterator
from itertools import pairwise
from typing import Annotated, Literal, Self

from pydantic import Field, ValidationInfo, model_validator

from ..stages.datasheet import (
    Chance,
    FileTable,
    Fraction,
    Nanometres,
    NotNegative,
    Positive,
    optional,
)
from ..stages.usual_range import METRES_TO_MM, PERCENT, Usual
from .lens_file import CIRCLES, ELLIPSES, read_lens

Number = Annotated[float, Field(ge=-1e30, le=1e30, strict=True)]
Flag = Annotated[bool, Field(strict=True)]
Index = Annotated[float, Field(ge=1, le=5, strict=True)]  # germanium has 4
Percent = Annotated[float, Field(ge=-99, le=1000, strict=True)]
Chances = tuple[Chance, ...] | None
Heights = tuple[NotNegative, ...] | None
Coefficients = tuple[Number, Number, Number, Number, Number] | None
Positives = tuple[Positive, ...] | None
Offset = Annotated[float, Field(ge=-1e6, le=1e6, strict=True)]
Power = Annotated[int, Field(ge=0, le=30, strict=True)]
Output = Literal["x", "y", "z", "dx", "dy", "dz"]
TERMS_MAX = 5456  # of three variables up to the power 30
NEEDED = ("x", "y", "dx", "dy")
TABLES = (  # values, positions, value on the axis
    ("transmission_curve", "transmission_wavelengths_nm", None),
    ("relative_illumination", "relative_illumination_heights_mm", 1.0),
    ("distortion_percent", "distortion_heights_mm", 0.0),
)


class SurfaceSection(FileTable):
    """A surface of a lens and the medium on its sensor side."""

    radius_mm: Number | None = optional(
        "radius, positive if its centre is towards the sensor; none: a plane [mm]", 29.5
    )
    thickness_mm: NotNegative = optional("distance to the next surface [mm]", 3.76, 0.0)
    semi_diameter_mm: Positive = Field(
        description="half the clear aperture [mm]", examples=[12.6]
    )
    obscuration_mm: NotNegative = optional(
        "radius of an opaque disk in the middle [mm]", 3.0, 0.0
    )
    index: Index = optional("refractive index after the surface at 587.56 nm", 1.67, 1.0)
    abbe: Positive | None = optional("Abbe number of the glass after it, for dispersion", 47.1)
    sellmeier: tuple[Number, Number, Number, Number, Number, Number] | None = optional(
        "B1, B2, B3, C1, C2, C3 of the glass (C in µm²) instead of index and abbe",
        [1.03961212, 0.231792344, 1.01046945, 0.00600069867, 0.0200179144, 103.560653],
    )
    conic: Number = optional("conic constant; -1 is a paraboloid", -1.0, 0.0)
    aspheric: tuple[Number, ...] = optional(
        "A4, A6, … of the sag A4·r⁴ + A6·r⁶ + … [mm⁻³, mm⁻⁵, …]", [1e-6], ()
    )
    stop: Flag = optional("whether this is the aperture stop", True, False)

    @model_validator(mode="after")
    def _one_glass(self) -> Self:
        if self.radius_mm == 0:
            raise ValueError("radius_mm is 0; omit it for a plane")
        if self.sellmeier is not None and (self.abbe is not None or self.index != 1):
            raise ValueError("give either sellmeier, or index and abbe, and not both")
        if self.abbe is not None and self.index == 1:
            raise ValueError("abbe needs the index of the glass; add it, e.g. index = 1.5168")
        if self.obscuration_mm >= self.semi_diameter_mm:
            raise ValueError(
                f"obscuration_mm is {self.obscuration_mm:g}; it must be below semi_diameter_mm, "
                f"{self.semi_diameter_mm:g}"
            )
        return self


class RayPolynomialSection(FileTable):
    """One coordinate of the ray on the scene side: the sum of coefficient·r^a·dx^b·dy^c."""

    output: Output = Field(description="coordinate of the ray", examples=["dy"])
    coefficients: Annotated[tuple[Number, ...], Field(min_length=1, max_length=TERMS_MAX)] = (
        Field(description="coefficient of each term; lengths in mm", examples=[[-0.02, 0.84]])
    )
    powers_r: tuple[Power, ...] = Field(
        description="a of each term: power of the distance r from the axis", examples=[[1, 0]]
    )
    powers_dx: tuple[Power, ...] = Field(
        description="b of each term: power of the direction cosine across r", examples=[[0, 0]]
    )
    powers_dy: tuple[Power, ...] = Field(
        description="c of each term: power of the direction cosine along r", examples=[[0, 1]]
    )

    @model_validator(mode="after")
    def _has_terms(self) -> Self:
        for name in ("powers_r", "powers_dx", "powers_dy"):
            if len(getattr(self, name)) != len(self.coefficients):
                raise ValueError(
                    f"{name} has {len(getattr(self, name))} numbers for {len(self.coefficients)} coefficients; "
                    "give one per coefficient"
                )
        return self


class RayTransferSection(FileTable):
    """A lens of unknown design: a map from rays on the sensor side to rays on the scene side (ISET)."""

    wavelength_nm: Positive = optional("wavelength of the fit [nm]", 550, 550.0)
    thickness_mm: NotNegative = Field(
        description="distance from the first to the last vertex [mm]", examples=[75.67]
    )
    input_plane_mm: Offset = optional(
        "distance from the last vertex to the input plane, towards the sensor [mm]", 0, 0.0
    )
    output_plane_mm: Offset = optional(
        "distance from the first vertex to the output plane, towards the scene [mm]", 0, 0.0
    )
    uses_outdz: Flag = optional(
        "true if the cosine dz has a polynomial; otherwise it follows from dx and dy",
        False,
        False,
    )
    pass_plane_mm: Positive = Field(
        description="distance from the input plane to the plane of the pass function, towards the scene [mm]",
        examples=[17],
    )
    pass_heights_mm: tuple[NotNegative, ...] | None = optional(
        "heights r of the ellipses in the input plane; rays above the last height do not pass [mm]",
        [0, 5, 10],
    )
    pass_centers_mm: tuple[Number, ...] | None = optional(
        "centre of the ellipse at each height, along r [mm]", [0, 3.5, 7.1]
    )
    pass_radii_x_mm: tuple[Positive, ...] | None = optional(
        "half axis of the ellipse at each height, across r [mm]", [5.7, 5.7, 5.1]
    )
    pass_radii_y_mm: tuple[Positive, ...] | None = optional(
        "half axis of the ellipse at each height, along r [mm]", [5.7, 5.7, 4.2]
    )
    pass_circle_radii_mm: tuple[Positive, ...] | None = optional(
        "radii of circles instead of ellipses; a ray must pass all circles [mm]", [5.74, 42.67]
    )
    pass_circle_sensitivities: tuple[Number, ...] | None = optional(
        "shift of each circle's centre along r per mm of r", [0.7154, -1.6999]
    )
    polynomials: Annotated[tuple[RayPolynomialSection, ...], Field(max_length=6)] = Field(
        description="polynomials of x, y, dx and dy, and optionally z and dz",
        examples=[
            [
                {
                    "output": "y",
                    "coefficients": [0.3, 81.0],
                    "powers_r": [1, 0],
                    "powers_dx": [0, 0],
                    "powers_dy": [0, 1],
                }
            ]
        ],
    )

    @model_validator(mode="after")
    def _is_whole(self) -> Self:
        outputs = [str(polynomial.output) for polynomial in self.polynomials]
        needed = (*NEEDED, "dz") if self.uses_outdz else NEEDED
        missing = [name for name in needed if outputs.count(name) != 1]
        if missing or len(set(outputs)) != len(outputs):
            raise ValueError(
                f"polynomials has {', '.join(outputs)}; give one for each of {', '.join(needed)}"
            )
        ellipses, circles = ([getattr(self, n) for n in names] for names in (ELLIPSES, CIRCLES))
        given, other = (ellipses, circles) if circles[0] is None else (circles, ellipses)
        if None in given or other != [None] * len(other):
            raise ValueError(
                f"give the pass function as ellipses ({', '.join(ELLIPSES)}) or as circles ({', '.join(CIRCLES)})"
            )
        if len({len(values) for values in given}) != 1 or not given[0]:
            raise ValueError(
                "the lists of the pass function are empty or differ in length; give equal lengths"
            )
        heights = self.pass_heights_mm
        if heights and (
            heights[0] != 0 or len(heights) < 2 or any(b <= a for a, b in pairwise(heights))
        ):
            raise ValueError(
                "pass_heights_mm must have at least 2 values, start with 0 and increase"
            )
        return self


class PrescriptionSection(FileTable):
    """A lens prescription: surfaces from the scene to the sensor, or a ray transfer. Both ends are in air."""

    name: str = Field(description="name of the lens", examples=["double_gauss"])
    source: str = optional("source of its numbers", "US patent 2,673,491", "")
    left_out: str = optional(
        "commands of the design file that were ignored", "COAT (surface 2)", ""
    )
    surfaces: Annotated[tuple[SurfaceSection, ...], Field(max_length=99)] = optional(
        "surfaces from the scene to the sensor, at least 2",
        [
            {"semi_diameter_mm": 3, "thickness_mm": 2, "stop": True},
            {"radius_mm": 50, "semi_diameter_mm": 9},
        ],
        (),
    )
    ray_transfer: RayTransferSection | None = optional(
        "ray transfer instead of surfaces, from a …-raytransfer.json of ISET",
        {"thickness_mm": 75.67, "pass_plane_mm": 17},
    )

    @model_validator(mode="before")
    @classmethod
    def _from_file(cls, data: object, info: ValidationInfo) -> object:
        if isinstance(data, str):
            return read_lens(data, (info.context or {}).get("folder", "."))
        return data

    @model_validator(mode="after")
    def _is_a_lens(self) -> Self:
        if self.ray_transfer is not None:
            if self.surfaces:
                raise ValueError("give either surfaces or ray_transfer, and not both")
            return self
        if len(self.surfaces) < 2:
            raise ValueError(f"surfaces has {len(self.surfaces)} surface(s); give at least 2")
        stops = [
            number for number, surface in enumerate(self.surfaces, start=1) if surface.stop
        ]
        if len(stops) != 1:
            raise ValueError(
                f"{len(stops)} surfaces are the aperture stop; mark exactly one with stop = true"
            )
        last = self.surfaces[-1]
        if last.index != 1 or last.sellmeier is not None:
            raise ValueError(
                "the last surface has glass after it, but the sensor is in air; set its index to 1"
            )
        return self


class LensSection(FileTable):
    """The lens sets the irradiance. A thin lens, `<sensor type="camera">` or the prescription sets the blur."""

    f_number: Annotated[float, Field(ge=0.01, le=1e6, strict=True), Usual(0.5, 130)] = optional(
        "focal length over pupil diameter N", 2.8, 2.8, title="f-number f/#, N"
    )
    transmission: Annotated[Fraction, Usual.of(0.01, 1, PERCENT)] = optional(
        "fraction of the light that passes", 0.95, 1.0, title="transmission T(λ)"
    )
    transmission_curve: Annotated[Chances, Usual.of(0, 1, PERCENT)] = optional(
        "factor on transmission at each wavelength", [0.8, 1.0, 0.9]
    )
    transmission_wavelengths_nm: Annotated[Positives, Nanometres] = optional(
        "wavelengths of transmission_curve, increasing [nm]", [400, 550, 700]
    )
    pupil_magnification: Positive = optional(
        "exit over entrance pupil diameter P", 1.0, 1.0, title="pupil magnification P"
    )
    diffraction: Flag = optional(
        "render the diffraction of the pupil at this f-number",
        True,
        False,
        title="diffraction, Airy disk, point spread function (PSF)",
    )
    obstruction: Annotated[float, Field(ge=0, le=0.7, strict=True)] = optional(
        "diameter of a central obstruction over the pupil diameter, for diffraction only",
        0.3,
        0.0,
        title="central obstruction ε",
    )
    veiling_glare: Annotated[Chance, Usual.of(1e-3, 0.2, PERCENT)] = optional(
        "fraction of the light that the lens scatters over the whole image",
        0.02,
        0.0,
        title="veiling glare, glare spread function (ISO 9358)",
    )
    glare_width_mm: Positive | None = optional(
        "distance on the sensor at which the scattered light has halved; none: uniform [mm]",
        2.0,
    )
    half_pupil: Literal["left", "right"] | None = optional(
        "half of the pupil that the pixels see; none: whole pupil",
        "left",
        title="dual pixel, phase-detection pixel (PDAF)",
    )
    convention: Literal["working", "planar"] = optional(
        "πLT/(4N_w²)·cos⁴, or EMVA's πLT/(1 + 4N²(1+m)²)·cos⁴",
        "working",
        "working",
        title="f-number law, cos⁴ law",
    )
    relative_illumination: Annotated[Chances, Usual.of(0, 1, PERCENT)] = optional(
        "measured fall-off instead of cos⁴, 1 on the axis",
        [1.0, 0.8, 0.5],
        title="relative illumination, vignetting",
    )
    relative_illumination_heights_mm: Heights = optional(
        "image heights of relative_illumination, from 0 [mm]", [0.0, 2.0, 4.0]
    )
    distortion: Coefficients = optional(
        "k1, k2, p1, p2, k3 of Brown and Conrady, in OpenCV's order",
        [-0.2, 0, 0, 0, 0],
        title="lens distortion k1, k2, p1, p2, k3 (OpenCV)",
    )
    distortion_percent: tuple[Percent, ...] | None = optional(
        "distortion as a table: 100·(real/ideal image height − 1)", [0, -1, -3]
    )
    distortion_heights_mm: Heights = optional(
        "ideal image heights of distortion_percent, from 0 [mm]", [0.0, 2.0, 4.0]
    )
    prescription: PrescriptionSection | None = optional(
        "lens design: name of an included one, path of a .json, .dat, .zmx or .seq file, or a table",
        "double_gauss",
        title="sequential lens, lens prescription",
    )
    focal_length_mm: Annotated[Positive | None, Usual.of(0.3, 1e4, METRES_TO_MM)] = optional(
        "scale the prescription to this focal length [mm]", 25.0
    )
    focus_m: Positive | None = optional(
        "focus distance of the prescription, instead of the scene's [m]", 2.0
    )
    dispersion: Flag = optional(
        "trace every wavelength with its own index", True, False, title="chromatic aberration"
    )

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        for name, axis_name, on_axis in TABLES:
            if not self._is_table(name, axis_name) or on_axis is None:
                continue
            if (getattr(self, axis_name)[0], getattr(self, name)[0]) != (0, on_axis):
                raise ValueError(f"{name} must start with {on_axis:g} at height 0 (the axis)")
        if self.glare_width_mm is not None and self.veiling_glare == 0:
            raise ValueError(
                "glare_width_mm needs veiling glare; add it, e.g. veiling_glare = 0.02"
            )
        if self.distortion is not None and self.distortion_percent is not None:
            raise ValueError("give either distortion or distortion_percent, and not both")
        if self.prescription is None:
            for name in ("focal_length_mm", "focus_m", "dispersion"):
                if getattr(self, name):
                    raise ValueError(
                        f"{name} needs a prescription; add it, e.g. prescription = 'double_gauss'"
                    )
            return self
        for name in ("relative_illumination", "distortion", "distortion_percent"):
            if getattr(self, name) is not None:
                raise ValueError(f"the prescription already determines {name}; omit {name}")
        if self.dispersion and not any(
            s.abbe or s.sellmeier for s in self.prescription.surfaces
        ):
            raise ValueError(
                "dispersion needs a glass with abbe or sellmeier; add either, or unset dispersion"
            )
        return self


def lens_notes(lens: LensSection) -> Iterator[str]:
    """Yield a note on ignored commands of a design file."""
    if lens.prescription is not None and lens.prescription.left_out:
        yield (
            f"lens.prescription: the reader ignored {lens.prescription.left_out} in the {lens.prescription.source}; "
            "check that this changes neither light nor geometry (set coating losses in lens.transmission)"
        )

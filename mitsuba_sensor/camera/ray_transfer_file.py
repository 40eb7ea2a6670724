"""Ray-transfer functions of ISET (``…-raytransfer.json``): their fields in a camera file, and the reader of theirs.

Goossens et al. 2022, arXiv 2202.08880; github ISET/isetrtf, doc/json. See optics/ray_transfer.py for what they mean.
"""

from __future__ import annotations

from itertools import pairwise
from typing import Annotated, Any, Literal, Self, TypeAlias

from pydantic import Field, model_validator

from ..stages.datasheet import FileTable, NotNegative, Positive, optional

Number = Annotated[float, Field(ge=-1e30, le=1e30, strict=True)]
Offset = Annotated[float, Field(ge=-1e6, le=1e6, strict=True)]
Power = Annotated[int, Field(ge=0, le=30, strict=True)]
Flag = Annotated[bool, Field(strict=True)]
Json: TypeAlias = dict[str, Any]
Output = Literal["x", "y", "z", "dx", "dy", "dz"]
MOST_TERMS = 5456  # of three variables up to the power 30
NEEDED = ("x", "y", "dx", "dy")
ELLIPSES = ("pass_heights_mm", "pass_centers_mm", "pass_radii_x_mm", "pass_radii_y_mm")
CIRCLES = ("pass_circle_radii_mm", "pass_circle_sensitivities")


class RayPolynomialSection(FileTable):
    """One number of the ray on the side of the scene: the sum of coefficient·r^a·dx^b·dy^c."""

    output: Output = Field(description="which number of the ray it is", examples=["dy"])
    coefficients: Annotated[tuple[Number, ...], Field(min_length=1, max_length=MOST_TERMS)] = (
        Field(description="of each term; lengths are in mm", examples=[[-0.02, 0.84]])
    )
    powers_r: tuple[Power, ...] = Field(
        description="a of each term, of the distance from the axis", examples=[[1, 0]]
    )
    powers_dx: tuple[Power, ...] = Field(
        description="b of each term, of the direction cosine across", examples=[[0, 0]]
    )
    powers_dy: tuple[Power, ...] = Field(
        description="c of each term, of the direction cosine along", examples=[[0, 1]]
    )

    @model_validator(mode="after")
    def _has_terms(self) -> Self:
        for name in ("powers_r", "powers_dx", "powers_dy"):
            if len(getattr(self, name)) != len(self.coefficients):
                raise ValueError(
                    f"{name} has {len(getattr(self, name))} numbers for {len(self.coefficients)} coefficients; "
                    "one for each"
                )
        return self


class RayTransferSection(FileTable):
    """A lens whose design is not known: rays on the side of the sensor, and what becomes of them (ISET)."""

    wavelength_nm: Positive = optional("at which it was fitted [nm]", 550, 550.0)
    thickness_mm: NotNegative = Field(
        description="from the first to the last vertex [mm]", examples=[75.67]
    )
    input_plane_mm: Offset = optional(
        "from the last vertex to the plane where rays enter, towards the sensor [mm]", 0, 0.0
    )
    output_plane_mm: Offset = optional(
        "from the first vertex to the plane where rays leave, towards the scene [mm]", 0, 0.0
    )
    uses_outdz: Flag = optional(
        "whether the cosine dz has its polynomial; else it follows from dx and dy", False, False
    )
    pass_plane_mm: Positive = Field(
        description="from the input plane to that of the pass function, towards the scene [mm]",
        examples=[17],
    )
    pass_heights_mm: tuple[NotNegative, ...] | None = optional(
        "heights r in the input plane of the ellipses; rays beyond the last do not pass [mm]",
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
        "radii of circles instead of ellipses, of which all pass [mm]", [5.74, 42.67]
    )
    pass_circle_sensitivities: tuple[Number, ...] | None = optional(
        "how much the centre of each circle moves along r for 1 mm of r", [0.7154, -1.6999]
    )
    polynomials: Annotated[tuple[RayPolynomialSection, ...], Field(max_length=6)] = Field(
        description="of x, y, dx, dy, and perhaps z and dz",
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
                f"polynomials has {', '.join(outputs)}; it needs one of each of {', '.join(needed)}"
            )
        ellipses, circles = ([getattr(self, n) for n in names] for names in (ELLIPSES, CIRCLES))
        given, other = (ellipses, circles) if circles[0] is None else (circles, ellipses)
        if None in given or other != [None] * len(other):
            raise ValueError(
                f"give the pass function as ellipses ({', '.join(ELLIPSES)}) or as circles ({', '.join(CIRCLES)})"
            )
        if len({len(values) for values in given}) != 1 or not given[0]:
            raise ValueError(
                "the lists of the pass function have different lengths, or are empty"
            )
        heights = self.pass_heights_mm
        if heights and (
            heights[0] != 0 or len(heights) < 2 or any(b <= a for a, b in pairwise(heights))
        ):
            raise ValueError("pass_heights_mm must be 2 or more, begin with 0 and increase")
        return self


def from_ray_transfer(data: Json, name: str) -> Json:
    """A prescription with the ray transfer of ISET's JSON.  Raises ValueError for what is not in the format."""
    where = f"the ray transfer {name!r}"
    wavelengths = data["polynomials"]
    if isinstance(wavelengths, dict):  # MATLAB writes a list of one as its element
        wavelengths = [wavelengths]
    if not isinstance(wavelengths, list) or len(wavelengths) != 1:
        raise ValueError(f"{where} must have polynomials of one wavelength; leave one of them")
    try:
        return {
            "name": str(data.get("name") or name),
            "source": str(data.get("description") or f"ISET ray transfer {name}"),
            "ray_transfer": _section(data, wavelengths[0]),
        }
    except (KeyError, TypeError, AttributeError):
        raise ValueError(
            f"{where} is not what ISET writes; it must have thickness, planeoffsetinput, planeoffsetoutput, and of its "
            "wavelength raypass and poly with outputname, coeff, termr, termdx, termdy"
        ) from None


def _section(data: Json, wavelength: Json) -> Json:
    """Fields of the camera file.  Raises KeyError, TypeError or AttributeError for another format."""
    passes = wavelength.get("raypass") or wavelength["passnopass"]
    return {
        "wavelength_nm": wavelength["wavelength_nm"],
        "thickness_mm": data["thickness"],
        "input_plane_mm": data["planeoffsetinput"],
        "output_plane_mm": data["planeoffsetoutput"],
        "uses_outdz": data.get("useDZpolynomial", False),
        "pass_plane_mm": passes["intersectPlaneDistance"],
        **_pass_function(passes),
        "polynomials": [_polynomial(polynomial) for polynomial in wavelength["poly"]],
    }


def _pass_function(passes: Json) -> Json:
    """Raises ValueError for a pass function of another kind.

    centersX is left out: it is 0 in a lens of rotational symmetry.
    """
    if passes["method"] == "minimalellipse":
        theirs = ("positions", "centersY", "radiiX", "radiiY")
        return {ours: _list(passes[n]) for ours, n in zip(ELLIPSES, theirs, strict=True)}
    if passes["method"] == "circles":
        return {CIRCLES[0]: _list(passes["radii"]), CIRCLES[1]: _list(passes["sensitivities"])}
    raise ValueError(
        f"the pass function is {passes['method']!r}; it must be 'minimalellipse' or 'circles'"
    )


def _polynomial(polynomial: Json) -> Json:
    """Terms whose coefficient is 0 are left out.  Raises ValueError for lists of different lengths."""
    columns = [_list(polynomial[n]) for n in ("coeff", "termr", "termdx", "termdy")]
    if len({len(column) for column in columns}) != 1:
        raise ValueError(
            f"coeff, termr, termdx and termdy of {polynomial['outputname']!r} have different lengths"
        )
    terms = [term for term in zip(*columns, strict=True) if term[0] != 0]
    coefficients, *powers = zip(*(terms or [(0.0, 0, 0, 0)]), strict=True)
    names = ("powers_r", "powers_dx", "powers_dy")
    return {
        "output": str(polynomial["outputname"]).removeprefix("out"),
        "coefficients": list(coefficients),
        **{name: list(column) for name, column in zip(names, powers, strict=True)},
    }


def _list(value: object) -> list[object]:
    """A list, or the only element that MATLAB wrote instead of it."""
    if isinstance(value, list):
        return value
    return [value]

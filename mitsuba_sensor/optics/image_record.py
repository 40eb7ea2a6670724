"""What is said of the image that a lens makes: intrinsics, fall-off, and how large the Airy disk is on the pixels."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from .f_number_law import numerical_aperture, shading
from .intrinsics import View, intrinsics
from .point_spread import airy_diameter_um

if TYPE_CHECKING:
    from ..camera.camera import Camera

LARGE_PX = 3.0
"""Diameter of an Airy disk that leaves a third of the contrast at Nyquist's frequency."""


def airy_diameter_px(
    camera: Camera, f_number: float | None = None, wavelength_nm: float | None = None
) -> float:
    """Diameter of the first dark ring on the axis over the pixel pitch (the smaller one).

    f_number : the working one; by default that of the camera's lens, focused at infinity.
    wavelength_nm : by default :func:`airy_wavelength_nm`.
    """
    lens, nm = camera.lens, wavelength_nm or airy_wavelength_nm(camera)
    diameter_um = airy_diameter_um(nm, f_number or lens.f_number, lens.obstruction)
    return diameter_um / min(camera.pixel.pitch_x_um, camera.pixel.pitch_y_um)


def airy_wavelength_nm(camera: Camera) -> float:
    """The middle of what the camera sees."""
    return sum(camera.band_nm) / 2


def airy_record(camera: Camera) -> dict[str, object]:
    """The Airy disk of the camera's lens, focused at infinity, and whether renders have it; ready for JSON."""
    return {
        "diameter_px": airy_diameter_px(camera),
        "wavelength_nm": airy_wavelength_nm(camera),
        "f_number": camera.lens.f_number,
        "rendered": camera.lens.diffraction,
    }


def airy_sentence(camera: Camera) -> str:
    """How large the Airy disk of the camera's lens is on its pixels, and whether renders have it."""
    size = f"{airy_diameter_px(camera):.2g} pixels across at {airy_wavelength_nm(camera):g} nm"
    rendered = "renders have it"
    if not camera.lens.diffraction:
        rendered = "lens.diffraction = true renders it"
    return f"the Airy disk of f/{camera.lens.f_number:g} is {size}; {rendered}"


def image_record(view: View, camera: Camera) -> dict[str, object]:
    """Intrinsics, ``shading``, ``point_spread`` and ``veiling_glare`` of a render, ready for JSON.

    point_spread : what displaced its rays: working f-number and obstruction of the pupil, the diameter of its Airy disk
        at a wavelength, and the sides of the pixel's aperture as shares of the pitch; None of a render without.
    veiling_glare : the share of the light, and the width of its spread [mm] or None; None of a render without.
    """
    shape = {
        "shading": shading(view, camera),
        "point_spread": _point_spread(view, camera),
        "veiling_glare": _veiling_glare(camera),
    }
    return intrinsics(view, camera) | shape


def _veiling_glare(camera: Camera) -> dict[str, float | None] | None:
    lens = camera.lens
    if lens.veiling_glare == 0:
        return None
    return {"fraction": lens.veiling_glare, "width_mm": lens.glare_width_mm}


def _point_spread(view: View, camera: Camera) -> dict[str, object] | None:
    lens, sides = camera.lens, camera.pixel.aperture_sides
    if not lens.diffraction and math.prod(sides) == 1:
        return None
    working = 1 / (2 * numerical_aperture(view, camera))
    found = {"diffraction": lens.diffraction, "pixel_aperture": list(sides)}
    if not lens.diffraction:
        return found
    return {
        **found,
        "working_f_number": working,
        "obstruction": lens.obstruction,
        "airy_diameter_px": airy_diameter_px(camera, working),
        "wavelength_nm": airy_wavelength_nm(camera),
    }

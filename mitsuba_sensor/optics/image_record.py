"""What is said of the image that a lens makes: intrinsics, fall-off, and how large the Airy disk is on the pixels."""

from __future__ import annotations

from typing import TYPE_CHECKING

from .f_number_law import numerical_aperture, shading
from .intrinsics import View, intrinsics
from .point_spread import airy_diameter_um, aperture_mtf

if TYPE_CHECKING:
    from ..camera.camera import Camera

TOLD_FREQUENCIES = (0.1, 0.2, 0.3, 0.4, 0.5)
"""Of the pixel's MTF, up to Nyquist's [cycles per pixel]."""
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


def airy_record(camera: Camera, f_number: float | None = None) -> dict[str, object]:
    """The Airy disk of the camera's lens, and whether renders have it; ready for JSON.

    f_number : the working one; by default that of the lens, focused at infinity.
    """
    return {
        "diameter_px": airy_diameter_px(camera, f_number),
        "wavelength_nm": airy_wavelength_nm(camera),
        "f_number": f_number or camera.lens.f_number,
        "rendered": camera.lens.diffraction,
    }


def pixel_mtf_record(camera: Camera) -> dict[str, list[float]]:
    """Modulation transfer function of the pixel's aperture up to Nyquist's frequency, ready for JSON."""
    aperture = camera.pixel.aperture_shape
    width, height = aperture.sides
    return {
        "cycles_per_pixel": list(TOLD_FREQUENCIES),
        "along_rows": aperture_mtf(TOLD_FREQUENCIES, width, aperture.profile(True)).tolist(),
        "along_columns": aperture_mtf(
            TOLD_FREQUENCIES, height, aperture.profile(False)
        ).tolist(),
    }


def pixel_mtf_sentence(camera: Camera) -> str:
    """What contrast the pixel's aperture leaves at Nyquist's frequency."""
    mtf = pixel_mtf_record(camera)
    along_rows, along_columns = mtf["along_rows"][-1], mtf["along_columns"][-1]
    return (
        f"the pixel's aperture leaves {along_rows:.3f} of the contrast at Nyquist's frequency along the rows and "
        f"{along_columns:.3f} along the columns"
    )


def airy_sentence(camera: Camera) -> str:
    """How large the Airy disk of the camera's lens is on its pixels, and whether renders have it."""
    size = f"{airy_diameter_px(camera):.2g} pixels across at {airy_wavelength_nm(camera):g} nm"
    rendered = "renders have it"
    if not camera.lens.diffraction:
        rendered = "lens.diffraction = true renders it"
    return f"the Airy disk of f/{camera.lens.f_number:g} is {size}; {rendered}"


def image_record(view: View, camera: Camera) -> dict[str, object]:
    """Intrinsics, ``shading``, ``airy_disk``, ``point_spread`` and ``veiling_glare`` of a render, ready for JSON.

    airy_disk : that of the working f-number at a wavelength, also of a render without diffraction.
    point_spread : what displaced its rays: whether diffraction did, and of which obstruction of the pupil; the sides of
        the pixel's aperture as shares of the pitch, and the sensitivity of its cells, if that is measured; None of a
        render without.
    veiling_glare : the share of the light, and the width of its spread [mm] or None; None of a render without.
    """
    shape = {
        "shading": shading(view, camera),
        "airy_disk": airy_record(camera, 1 / (2 * numerical_aperture(view, camera))),
        "point_spread": _point_spread(camera),
        "veiling_glare": _veiling_glare(camera),
    }
    return intrinsics(view, camera) | shape


def _veiling_glare(camera: Camera) -> dict[str, float | None] | None:
    lens = camera.lens
    if lens.veiling_glare == 0:
        return None
    return {"fraction": lens.veiling_glare, "width_mm": lens.glare_width_mm}


def _point_spread(camera: Camera) -> dict[str, object] | None:
    lens, aperture = camera.lens, camera.pixel.aperture_shape
    if not lens.diffraction and aperture.is_full:
        return None
    return {
        "diffraction": lens.diffraction,
        "obstruction": lens.obstruction,
        "pixel_aperture": list(aperture.sides),
        "sensitivity_within_pixel": None if aperture.is_even else aperture.cells,
    }

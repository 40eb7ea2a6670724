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


def airy_diameter_px(camera: Camera, f_number: float | None = None) -> float:
    """Diameter of the first dark ring on the axis over the smaller pixel pitch, in the middle of what the camera sees.

    f_number : the working one; by default that of the camera's lens, focused at infinity.
    """
    lens, pixel = camera.lens, camera.pixel
    nm = sum(camera.band_nm) / 2
    diameter_um = airy_diameter_um(nm, f_number or lens.f_number, lens.obstruction)
    return diameter_um / min(pixel.pitch_x_um, pixel.pitch_y_um)


def airy_record(camera: Camera, f_number: float | None = None) -> dict[str, object]:
    """The Airy disk of the camera's lens, and whether renders have it; ready for JSON.

    f_number : the working one; by default that of the lens, focused at infinity.
    """
    return {
        "diameter_px": airy_diameter_px(camera, f_number),
        "wavelength_nm": sum(camera.band_nm) / 2,
        "f_number": f_number or camera.lens.f_number,
        "rendered": camera.lens.diffraction,
    }


def pixel_mtf_record(camera: Camera) -> dict[str, list[float]]:
    """Modulation transfer function of the pixel's aperture up to the Nyquist frequency, ready for JSON."""
    aperture, (width, height) = camera.pixel.aperture_shape, camera.pixel.aperture_shape.sides
    along_rows = aperture_mtf(TOLD_FREQUENCIES, width, aperture.profile(True))
    along_columns = aperture_mtf(TOLD_FREQUENCIES, height, aperture.profile(False))
    return {
        "cycles_per_pixel": list(TOLD_FREQUENCIES),
        "along_rows": along_rows.tolist(),
        "along_columns": along_columns.tolist(),
    }


def optics_sentences(camera: Camera) -> tuple[str, str]:
    """How large the Airy disk of the lens is on the pixels, and what contrast the pixel's aperture leaves."""
    airy, mtf = airy_record(camera), pixel_mtf_record(camera)
    rendered = "renders have it" if airy["rendered"] else "lens.diffraction = true renders it"
    return (
        f"the Airy disk of f/{airy['f_number']:g} is {airy['diameter_px']:.2g} pixels across at "
        f"{airy['wavelength_nm']:g} nm; {rendered}",
        f"the pixel's aperture leaves {mtf['along_rows'][-1]:.3f} of the contrast at Nyquist's frequency along the "
        f"rows and {mtf['along_columns'][-1]:.3f} along the columns",
    )


def image_record(view: View, camera: Camera) -> dict[str, object]:
    """Intrinsics, ``shading``, ``airy_disk``, ``point_spread`` and ``veiling_glare`` of a render, ready for JSON.

    airy_disk : that of the working f-number at a wavelength, also of a render without diffraction.
    point_spread : what displaced its rays: whether diffraction did, and of which obstruction of the pupil; the sides of
        the pixel's aperture as shares of the pitch, and the sensitivity of its cells, if that is measured; None of a
        render without.
    veiling_glare : the share of the light, and the width of its spread [mm] or None; None of a render without.
    """
    lens, aperture = camera.lens, camera.pixel.aperture_shape
    spread = {
        "diffraction": lens.diffraction,
        "obstruction": lens.obstruction,
        "pixel_aperture": list(aperture.sides),
        "sensitivity_within_pixel": None if aperture.is_even else aperture.cells,
    }
    glare = {"fraction": lens.veiling_glare, "width_mm": lens.glare_width_mm}
    return intrinsics(view, camera) | {
        "shading": shading(view, camera),
        "airy_disk": airy_record(camera, 1 / (2 * numerical_aperture(view, camera))),
        "point_spread": spread if lens.diffraction or not aperture.is_full else None,
        "veiling_glare": glare if lens.veiling_glare else None,
    }

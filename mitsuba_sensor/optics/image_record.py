"""Records of the image of a lens: intrinsics, fall-off, Airy disk and pixel MTF."""

from __future__ import annotations

from typing import TYPE_CHECKING

from .f_number_law import numerical_aperture, shading
from .intrinsics import View, intrinsics
from .point_spread import airy_diameter_um, aperture_mtf

if TYPE_CHECKING:
    from ..camera.camera import Camera

MTF_FREQUENCIES = (0.1, 0.2, 0.3, 0.4, 0.5)
"""Of the pixel MTF, up to the Nyquist frequency [cycles per pixel]."""


def airy_diameter_px(camera: Camera, f_number: float | None = None) -> float:
    """Return the diameter of the first dark ring on the axis in smaller pixel pitches, at the centre of the band.

    f_number : working f-number; default: the lens focused at infinity.
    """
    lens, pixel = camera.lens, camera.pixel
    nm = sum(camera.band_nm) / 2
    diameter_um = airy_diameter_um(nm, f_number or lens.f_number, lens.obstruction)
    return diameter_um / min(pixel.pitch_x_um, pixel.pitch_y_um)


def airy_record(camera: Camera, f_number: float | None = None) -> dict[str, object]:
    """Return the Airy disk of the camera's lens, and whether it is rendered, for JSON.

    f_number : working f-number; default: the lens focused at infinity.
    """
    return {
        "diameter_px": airy_diameter_px(camera, f_number),
        "wavelength_nm": sum(camera.band_nm) / 2,
        "f_number": f_number or camera.lens.f_number,
        "rendered": camera.lens.diffraction,
    }


def pixel_mtf_record(camera: Camera) -> dict[str, list[float]]:
    """Return the MTF of the pixel aperture up to the Nyquist frequency, for JSON."""
    aperture, (width, height) = camera.pixel.aperture_shape, camera.pixel.aperture_shape.sides
    along_rows = aperture_mtf(MTF_FREQUENCIES, width, aperture.profile(True))
    along_columns = aperture_mtf(MTF_FREQUENCIES, height, aperture.profile(False))
    return {
        "cycles_per_pixel": list(MTF_FREQUENCIES),
        "along_rows": along_rows.tolist(),
        "along_columns": along_columns.tolist(),
    }


def optics_sentences(camera: Camera) -> tuple[str, str]:
    """Return notes on the size of the Airy disk and the contrast of the pixel aperture."""
    airy, mtf = airy_record(camera), pixel_mtf_record(camera)
    rendered = (
        "renders include it" if airy["rendered"] else "lens.diffraction = true renders it"
    )
    return (
        f"the Airy disk of f/{airy['f_number']:g} is {airy['diameter_px']:.2g} pixels across at "
        f"{airy['wavelength_nm']:g} nm; {rendered}",
        f"the MTF of the pixel aperture at the Nyquist frequency is {mtf['along_rows'][-1]:.3f} along the rows and "
        f"{mtf['along_columns'][-1]:.3f} along the columns",
    )


def image_record(view: View, camera: Camera) -> dict[str, object]:
    """Return intrinsics, ``shading``, ``airy_disk``, ``point_spread`` and ``veiling_glare`` of a render, for JSON.

    airy_disk : at the working f-number, also for renders without diffraction.
    point_spread : rendered diffraction and pupil obstruction, sides of the pixel aperture in pitches, and measured
        sensitivity of its cells; None without point spread.
    veiling_glare : fraction of the light and width of its spread [mm] or None; None without glare.
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

"""Noise-free images of charts in closed form: pixel × lens × charge diffusion × coupling, then the lens's glare.

One narrow lamp for each colour filter lights the charts, at the wavelength of the filter's highest QE.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
import scipy

from ...camera.camera import Camera
from ...camera.figures import saturation_e
from ...core.types import Float64Array
from ...optics.point_spread import diffraction_mtf
from ...optics.veiling_glare import VeilingGlare, half_width_px
from ...stages.diffusion import Diffusion
from .light import NARROW_NM, Bands

Kernel = tuple[tuple[float, ...], ...]
FINE, PERIOD_PX = 128, 512
"""Points per pixel and length of the computed edge spread: frequencies up to 64 cycles per pixel."""


def bands_of_lamps(camera: Camera) -> Bands:
    """Return a narrow band at the wavelength of highest QE of each colour filter, each wavelength once."""
    points = np.array(camera.quantum_efficiency.wavelengths_nm, np.float64)
    centres = np.unique(points[camera.qe(points).argmax(axis=1)])
    return Bands(centres, np.full(centres.shape, NARROW_NM))


def rendered_nm(camera: Camera, one_shape: bool) -> list[float]:
    """Return the rendered lamps [nm]: only the first one if the light of all lamps has the same shape."""
    centres: list[float] = bands_of_lamps(camera).wavelengths_nm.tolist()
    return centres[:1] if one_shape else centres


def levels_of_filters(camera: Camera, light: Float64Array, bands: Bands) -> Float64Array:
    """Return the photoelectrons under each colour filter, (…, F), for mean photons (…, B)."""
    efficiency = camera.qe(bands.wavelengths_nm, bands.bandwidths_nm)
    return np.asarray(light @ np.asarray(efficiency).T)


def even_photons(camera: Camera, share: float) -> Float64Array:
    """Return the mean photons of all lamps, (B,), that bring the most sensitive filter to this fraction of saturation.

    Each lamp gives the same number of electrons under its most sensitive filter.
    """
    bands = bands_of_lamps(camera)
    most_e = camera.qe(*bands).max(axis=0)
    total = levels_of_filters(camera, 1 / most_e, bands).max()
    return np.asarray(share * saturation_e(camera) / total / most_e)


def photons_of_shapes(
    camera: Camera, shapes: Sequence[Float64Array], share: float
) -> Float64Array:
    """Return the mean photons of all lamps, (H, W, B).

    shapes : light (H, W, 1) of each lamp, or one for all lamps.  share : of saturation where a shape is 1.
    """
    return np.asarray(np.concatenate(shapes, axis=-1) * even_photons(camera, share))


class Transfer(NamedTuple):
    """Modulation transfer of the light of all lamps under one colour filter.

    electrons : fraction from each lamp, (B,).  kernels : fractions of the charge that neighbours receive.
    """

    camera: Camera
    electrons: Float64Array
    kernels: tuple[Kernel, ...]

    def at(self, across: Float64Array, down: Float64Array) -> Float64Array:
        """Return the real transfer without glare at frequencies across and down [cycles per pixel]."""
        pixel, lens = self.camera.pixel, self.camera.lens
        width, height = pixel.aperture_shape.sides
        total = np.sinc(across * width) * np.sinc(down * height)
        for kernel in self.kernels:
            total = total * _of_kernel(kernel, across, down)
        wavelengths = bands_of_lamps(self.camera).wavelengths_nm
        diffusion = Diffusion.from_camera(self.camera)
        per_um = np.hypot(across / pixel.pitch_x_um, down / pixel.pitch_y_um)
        of_lamps = np.zeros(np.shape(total))
        for number, share in enumerate(self.electrons):
            of_lamp = np.asarray(share)
            if lens.diffraction:
                cut = per_um * wavelengths[number] * 1e-3 * lens.f_number
                of_lamp = of_lamp * diffraction_mtf(cut, lens.obstruction)
            if diffusion is not None:
                shares = (diffusion.shares(axis, wavelengths)[:, number] for axis in (0, 1))
                for collected, frequency in zip(shares, (down, across), strict=True):
                    of_lamp = of_lamp * _of_shares(collected, frequency)
            of_lamps = of_lamps + of_lamp
        return np.asarray(total * of_lamps)


def coupling_of(camera: Camera) -> tuple[Kernel, ...] | None:
    """Return the kernels of crosstalk and inter-pixel capacitance; None if pixels of a mosaic share charge."""
    section, readout = camera.quantum_efficiency, camera.readout
    kernels: list[Kernel] = []
    crosstalk = section.crosstalk or (section.crosstalk_from or {}).get(camera.filter_names[0])
    if crosstalk is not None:
        kernels.append(crosstalk)
    side, corner = readout.ipc_coupling, readout.ipc_corner_coupling
    if side or corner:
        outer, centre = (corner, side, corner), 1 - 4 * side - 4 * corner
        kernels.append((outer, (side, centre, side), outer))
    coupled = kernels or section.crosstalk_from or Diffusion.from_camera(camera) is not None
    if coupled and len(camera.filter_names) > 1:
        return None
    return tuple(kernels)


def is_alike(camera: Camera) -> bool:
    """Return True if all colour filters have the same transfer."""
    return not camera.lens.diffraction and Diffusion.from_camera(camera) is None


def picture_of(camera: Camera, draw: Callable[[Transfer], Float64Array]) -> Float64Array | None:
    """Return the noise-free image (1, H, W) in fractions of each filter's light; None without a closed form.

    A lens prescription, half-pupils, pixels with uneven sensitivity and a mosaic whose pixels share charge have no
    closed form.  draw : returns the image (H, W) under one filter for its transfer.
    """
    lens, kernels = camera.lens, coupling_of(camera)
    traced = lens.prescription is not None or lens.half_pupil is not None
    if traced or kernels is None or not camera.pixel.aperture_shape.is_even:
        return None
    bands = bands_of_lamps(camera)
    electrons = levels_of_filters(camera, np.diag(even_photons(camera, 1.0)), bands)
    filters = electrons.T[:1] if is_alike(camera) else electrons.T
    pictures = [
        _with_glare(camera, draw(Transfer(camera, of_filter / of_filter.sum(), kernels)))
        for of_filter in filters
    ]
    if len(pictures) == 1:
        return pictures[0][None]
    return np.asarray(np.choose(camera.filter_index(pictures[0].shape), pictures))[None]


def _with_glare(camera: Camera, picture: Float64Array) -> Float64Array:
    """Return a picture (H, W) with the lens's glare."""
    if not camera.lens.veiling_glare:
        return picture
    bands = picture[..., None].astype(np.float32)
    shape = picture.shape[0], picture.shape[1]
    glare = VeilingGlare(camera.lens.veiling_glare, shape, half_width_px(camera))
    glare.add_to_bands(bands, np.zeros_like(bands))
    return bands[..., 0].astype(np.float64)


def _of_kernel(kernel: Kernel, across: Float64Array, down: Float64Array) -> Float64Array:
    """Return the transform of a kernel over its value at 0; the real part, as of a symmetric kernel."""
    shares, reach = np.array(kernel), len(kernel) // 2
    total = np.zeros(np.broadcast_shapes(np.shape(across), np.shape(down)))
    for row, column in np.ndindex(shares.shape):
        phase = down * (row - reach) + across * (column - reach)
        total = total + shares[row, column] * np.cos(2 * math.pi * phase)
    return np.asarray(total / shares.sum())


def _of_shares(shares: Float64Array, frequency: Float64Array) -> Float64Array:
    """Return the transform of the fractions of charge that pixels 0, 1, … away collect on either side."""
    total = np.ones(np.shape(frequency))
    for distance, share in enumerate(shares[1:], start=1):
        total = total - 2 * share * (1 - np.cos(2 * math.pi * distance * frequency))
    return total


def picture_of_edge(
    transfer: Transfer, shape: tuple[int, int], normal_deg: float
) -> Float64Array:
    """Return the image (H, W) of an edge through the middle that rises from 0 to 1.

    normal_deg : direction of the rise, anticlockwise from the rows.
    """
    cosine, sine = math.cos(math.radians(normal_deg)), math.sin(math.radians(normal_deg))
    frequency = np.arange(FINE * PERIOD_PX // 2 + 1, dtype=np.float64) / PERIOD_PX
    spread_line = np.fft.irfft(transfer.at(frequency * cosine, frequency * sine)) * FINE
    spread_line = np.roll(spread_line, FINE * PERIOD_PX // 2)
    distances = np.arange(FINE * PERIOD_PX) / FINE - PERIOD_PX / 2
    spread = (np.cumsum(spread_line) - 0.5 * spread_line) / FINE
    rows, columns = (np.arange(length) + 0.5 - length / 2 for length in shape)
    distance = cosine * columns[None, :] - sine * rows[:, None]
    return np.asarray(np.interp(distance, distances, spread))


def shown(bitmap: Float64Array, dense: int) -> Float64Array:
    """Return the light of a repeating bitmap at its points after linear interpolation, which reduces its contrast.

    dense : points along a pixel.
    """
    down, across = _frequencies(bitmap, dense)
    kept = (np.sinc(down[:, None] / dense) * np.sinc(across / dense)) ** 2
    return np.asarray(scipy.fft.irfft2(scipy.fft.rfft2(bitmap) * kept, bitmap.shape))


def picture_of_bitmap(transfer: Transfer, bitmap: Float64Array, dense: int) -> Float64Array:
    """Return the image (H, W) of a bitmap.  dense : points along a pixel."""
    down, across = _frequencies(bitmap, dense)
    to_middle = 1j * math.pi * (1 - 1 / dense)  # from the first point of a pixel
    spectrum = scipy.fft.rfft2(shown(bitmap, dense)) * transfer.at(across, down[:, None])
    spectrum *= np.exp(to_middle * down)[:, None] * np.exp(to_middle * across)
    return np.asarray(scipy.fft.irfft2(spectrum, bitmap.shape)[::dense, ::dense])


def _frequencies(bitmap: Float64Array, dense: int) -> tuple[Float64Array, Float64Array]:
    """Return the frequencies of a real spectrum, down and across [cycles per pixel]."""
    rows, columns = bitmap.shape
    return scipy.fft.fftfreq(rows, 1 / dense), scipy.fft.rfftfreq(columns, 1 / dense)

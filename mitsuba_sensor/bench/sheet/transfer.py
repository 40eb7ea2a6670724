"""Modulation transfer of pixel, lens, charge and coupled pixels in closed form, and the glare of the lens."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ...camera.camera import Camera
from ...core.types import Float64Array
from ...optics.point_spread import diffraction_mtf
from ...optics.veiling_glare import VeilingGlare, half_width_px
from ...stages.diffusion import Diffusion

Kernel = tuple[tuple[float, ...], ...]
DIGITS = 9
"""Of the shares of lamps: more would differ by rounding between gain settings."""


class LampTransfer(NamedTuple):
    """One lamp behind a colour filter.

    wavelength_nm : of its light.  share : of the electrons of all lamps.
    down, across : shares of the charge that is collected 0, 1, … pixels away on either side; empty: all stays.
    """

    wavelength_nm: float
    share: float
    down: tuple[float, ...]
    across: tuple[float, ...]


@dataclass(frozen=True)
class Transfer:
    """Transfer of the light of some lamps behind one colour filter.

    lamps : that shine.  aperture : width and height of the pixel [px].  pitch_um : across and down.
    f_number : of the lens, 0 without diffraction.  obstruction : of its pupil.
    kernels : shares that pixels give to those about them.
    glare : share of the light that the lens scatters over the picture.
    glare_px : rows and columns where it has fallen to one half, None where it is even.
    """

    lamps: tuple[LampTransfer, ...]
    aperture: tuple[float, float]
    pitch_um: tuple[float, float]
    f_number: float
    obstruction: float
    kernels: tuple[Kernel, ...]
    glare: float
    glare_px: tuple[float, float] | None

    def at(self, across: Float64Array, down: Float64Array) -> Float64Array:
        """Real transfer at frequencies along the rows and along the columns [cycles per pixel], without glare."""
        total = np.sinc(across * self.aperture[0]) * np.sinc(down * self.aperture[1])
        for kernel in self.kernels:
            total = total * _of_kernel(kernel, across, down)
        per_um = np.hypot(across / self.pitch_um[0], down / self.pitch_um[1])
        of_lamps = np.zeros(np.shape(total))
        for lamp in self.lamps:
            charge = _of_shares(lamp.across, across) * _of_shares(lamp.down, down)
            of_lamps += lamp.share * charge * self._of_lens(per_um, lamp.wavelength_nm)
        return np.asarray(total * of_lamps)

    def _of_lens(self, per_um: Float64Array, wavelength_nm: float) -> Float64Array | float:
        """Diffraction of one wavelength."""
        if not self.f_number:
            return 1.0
        cut = per_um * wavelength_nm * 1e-3 * self.f_number
        return diffraction_mtf(cut, self.obstruction)

    def with_glare(self, picture: Float64Array) -> Float64Array:
        """A picture (H, W) behind the glare of the lens."""
        if not self.glare:
            return picture
        bands = picture[..., None].astype(np.float32)
        glare = VeilingGlare(self.glare, (picture.shape[0], picture.shape[1]), self.glare_px)
        glare.add_to_bands(bands, np.zeros_like(bands))
        return bands[..., 0].astype(np.float64)


def transfer_of(
    camera: Camera, wavelengths_nm: Float64Array, electrons: Float64Array
) -> Transfer | None:
    """The transfer behind one colour filter; None where it has no closed form.

    That is so for a lens prescription or half a pupil, for pixels that are more sensitive in some places, and for
    pixels of a mosaic that share charge.
    electrons : from each lamp.
    """
    lens, pixel = camera.lens, camera.pixel
    traced = lens.prescription is not None or lens.half_pupil is not None
    kernels, diffusion = coupling_of(camera), Diffusion.from_camera(camera)
    if traced or kernels is None or not pixel.aperture_shape.is_even:
        return None
    shares = np.round(electrons / electrons.sum(), DIGITS).tolist()
    charge = [((), ())] * len(shares)
    if diffusion is not None:
        down, across = (diffusion.shares(axis, wavelengths_nm).T.tolist() for axis in (0, 1))
        charge = [(tuple(own), tuple(other)) for own, other in zip(down, across, strict=True)]
    lamps = [
        LampTransfer(nm, share, *spread)
        for nm, share, spread in zip(wavelengths_nm.tolist(), shares, charge, strict=True)
    ]
    return Transfer(
        tuple(lamps),
        pixel.aperture_shape.sides,
        (pixel.pitch_x_um, pixel.pitch_y_um),
        lens.f_number if lens.diffraction else 0.0,
        lens.obstruction,
        kernels,
        lens.veiling_glare,
        half_width_px(camera),
    )


def coupling_of(camera: Camera) -> tuple[Kernel, ...] | None:
    """Kernels of crosstalk and of inter-pixel capacitance; None for pixels of a mosaic that share charge."""
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


def _of_kernel(kernel: Kernel, across: Float64Array, down: Float64Array) -> Float64Array:
    """Transform of shares over its value at 0, its real part: that of a symmetric kernel."""
    shares = np.array(kernel)
    reach = len(kernel) // 2
    total = np.zeros(np.broadcast_shapes(np.shape(across), np.shape(down)))
    for row, column in np.ndindex(shares.shape):
        phase = down * (row - reach) + across * (column - reach)
        total = total + shares[row, column] * np.cos(2 * math.pi * phase)
    return np.asarray(total / shares.sum())


def _of_shares(shares: tuple[float, ...], frequency: Float64Array) -> Float64Array:
    """Transform of shares that pixels 0, 1, … away collect on either side; 1 without any."""
    total = np.ones(np.shape(frequency))
    for distance, share in enumerate(shares[1:], start=1):
        total = total - 2 * share * (1 - np.cos(2 * math.pi * distance * frequency))
    return total

"""Modulation transfer of pixel, lens and coupled pixels in closed form, and the picture of an edge that it makes."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ...camera.camera import Camera
from ...core.types import Float64Array
from ...optics.point_spread import diffraction_mtf

Kernel = tuple[tuple[float, ...], ...]
FINE, PERIOD_PX = 128, 512
"""Points per pixel and length of the edge spread that is computed: frequencies up to 64 cycles per pixel."""
DIGITS = 9
"""Of the shares of lamps: more would differ by rounding between gain settings."""


@dataclass(frozen=True)
class Transfer:
    """Transfer of the light of some lamps behind one colour filter.

    lamps : wavelength [nm] and share of the electrons of each.  aperture : width and height of the pixel [px].
    pitch_um : across and down.  f_number : of the lens, 0 without diffraction.  obstruction : of its pupil.
    kernels : shares that pixels give to those about them.
    """

    lamps: tuple[tuple[float, float], ...]
    aperture: tuple[float, float]
    pitch_um: tuple[float, float]
    f_number: float
    obstruction: float
    kernels: tuple[Kernel, ...]

    def at(self, across: Float64Array, down: Float64Array) -> Float64Array:
        """Real transfer at frequencies along the rows and along the columns [cycles per pixel]."""
        total = np.sinc(across * self.aperture[0]) * np.sinc(down * self.aperture[1])
        for kernel in self.kernels:
            total = total * _of_kernel(kernel, across, down)
        if not self.f_number:
            return np.asarray(total)
        per_um = np.hypot(across / self.pitch_um[0], down / self.pitch_um[1])
        lens = np.zeros(np.shape(across))
        for wavelength_nm, share in self.lamps:
            cut = per_um * wavelength_nm * 1e-3 * self.f_number
            lens = lens + share * diffraction_mtf(cut, self.obstruction)
        return np.asarray(total * lens)


def transfer_of(
    camera: Camera, wavelengths_nm: Float64Array, electrons: Float64Array
) -> Transfer | None:
    """The transfer behind one colour filter; None where it has no closed form.

    That is so for charge that diffuses, for pixels of a mosaic that are coupled, for a lens prescription, half a
    pupil, glare that falls with the distance, and pixels that are more sensitive in some places.
    electrons : from each lamp.
    """
    lens, pixel = camera.lens, camera.pixel
    glare = lens.veiling_glare and lens.glare_width_mm is not None
    traced = lens.prescription is not None or lens.half_pupil is not None
    kernels = coupling_of(camera)
    if traced or glare or kernels is None or not pixel.aperture_shape.is_even:
        return None
    shares = np.round(electrons / electrons.sum(), DIGITS).tolist()
    return Transfer(
        tuple(zip(wavelengths_nm.tolist(), shares, strict=True)),
        pixel.aperture_shape.sides,
        (pixel.pitch_x_um, pixel.pitch_y_um),
        lens.f_number if lens.diffraction else 0.0,
        lens.obstruction,
        kernels,
    )


def coupling_of(camera: Camera) -> tuple[Kernel, ...] | None:
    """Kernels of crosstalk and of inter-pixel capacitance; None where they do not say how an edge is blurred."""
    section, readout = camera.quantum_efficiency, camera.readout
    kernels: list[Kernel] = []
    crosstalk = section.crosstalk or (section.crosstalk_from or {}).get(camera.filter_names[0])
    if crosstalk is not None:
        kernels.append(crosstalk)
    side, corner = readout.ipc_coupling, readout.ipc_corner_coupling
    if side or corner:
        outer, centre = (corner, side, corner), 1 - 4 * side - 4 * corner
        kernels.append((outer, (side, centre, side), outer))
    coupled = kernels or section.crosstalk_from
    diffuses = section.diffusion_um is not None and any(section.diffusion_um)
    if diffuses or (coupled and len(camera.filter_names) > 1):
        return None
    return tuple(kernels)


def _of_kernel(kernel: Kernel, across: Float64Array, down: Float64Array) -> Float64Array:
    """Transform of shares over its value at 0, its real part: that of a symmetric kernel."""
    shares = np.array(kernel)
    reach = len(kernel) // 2
    total = np.zeros(np.shape(across))
    for row, column in np.ndindex(shares.shape):
        phase = down * (row - reach) + across * (column - reach)
        total = total + shares[row, column] * np.cos(2 * math.pi * phase)
    return np.asarray(total / shares.sum())


def picture_of_edge(
    transfer: Transfer, shape: tuple[int, int], normal_deg: float
) -> Float64Array:
    """The picture (H, W) of an edge through the middle that rises from 0 to 1.

    normal_deg : direction in which it rises, from the rows, anticlockwise.
    """
    cosine, sine = math.cos(math.radians(normal_deg)), math.sin(math.radians(normal_deg))
    frequency = np.arange(FINE * PERIOD_PX // 2 + 1, dtype=np.float64) / PERIOD_PX
    line = np.fft.irfft(transfer.at(frequency * cosine, frequency * sine)) * FINE
    line = np.roll(line, FINE * PERIOD_PX // 2)
    distances = np.arange(FINE * PERIOD_PX) / FINE - PERIOD_PX / 2
    spread = (np.cumsum(line) - 0.5 * line) / FINE
    rows, columns = (np.arange(length) + 0.5 - length / 2 for length in shape)
    distance = cosine * columns[None, :] - sine * rows[:, None]
    return np.asarray(np.interp(distance, distances, spread))

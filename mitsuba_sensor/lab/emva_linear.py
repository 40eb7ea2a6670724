"""The temporal figures of EMVA 1288 R4 Linear, measured in a bench series of dark frames and flat fields."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from .dark_noise import DarkNoise, dark_noise
from .photon_transfer import PhotonTransfer, photon_transfer
from .quantity import Quantity, unknown
from .radiometric import EFFICIENCY, Radiometric, radiometric
from .saturation import Saturation, saturation
from .series import centre, series
from .snr import SignalToNoise, signal_to_noise
from .stack import Stack


@dataclass(frozen=True, eq=False)
class EmvaLinear:
    """quantities : all figures, K first, then QE and those of the parts.  notes : what was found in the frames."""

    quantities: tuple[Quantity, ...]
    photon_transfer: PhotonTransfer
    radiometric: Radiometric
    dark_noise: DarkNoise
    saturation: Saturation
    snr: SignalToNoise
    notes: tuple[str, ...]

    def __getitem__(self, symbol: str) -> Quantity:
        """A figure by its symbol: ``K``, ``η``, ``R``, ``LE``, ``σ_y.dark``, ``σ_d``, ``µ_e.sat``, ``DR``, …"""
        return {one.symbol: one for one in self.quantities}[symbol]


def emva_linear(darks: Sequence[Stack], flats: Sequence[Stack], window: int | None = None) -> EmvaLinear:
    """Measure a camera from stacks of two frames or more each.

    darks : one of each exposure time, or one for all.  flats : levels from near darkness to above saturation, with
    photons per pixel; without photons QE and what needs it stay unknown.  window : rows and columns about the centre
    that are used, all where None.

    What cannot be measured is NaN with a note. Raises InputError where the stacks do not belong together or hold a
    single frame, a mosaic, or no flat fields.
    """
    measured = series(darks, flats, window)
    transfer, light = photon_transfer(measured), radiometric(measured)
    efficiency = light.efficiency(transfer.gain)
    dark = dark_noise([one if window is None else centre(one, window) for one in darks], transfer.gain)
    ends = saturation(measured, transfer.gain, efficiency, dark.total)
    shown = efficiency or unknown(EFFICIENCY, "photons are not known")
    found = (transfer.gain, shown, *light.quantities, *dark.quantities, *ends.quantities)
    if measured.notes:
        found = tuple(replace(one, note=_with(one.note, "see the notes of the series")) for one in found)
    snr = signal_to_noise(measured, transfer.gain, efficiency, dark.total)
    return EmvaLinear(found, transfer, light, dark, ends, snr, measured.notes)


def _with(note: str, more: str) -> str:
    return f"{note}; {more}" if note else more

"""Choose float32 or float64 for an exposure."""

from ..camera.camera import Camera
from ..core import InputError
from ..core.backend import FLOAT32_LIMIT
from ..stages.gains import adc_gain_dn_per_v

COUNTABLE_E, COUNTABLE_DN = 2**24, 2**23
"""Limits of float32: whole electrons, and digital numbers, which need halves for rounding."""


def float32_counts(camera: Camera) -> bool:
    """Return whether float32 resolves single electrons of a full well and the codes of this camera."""
    countable = camera.pixel.full_well_e <= COUNTABLE_E and 2**camera.code_bits <= COUNTABLE_DN
    return countable and adc_gain_dn_per_v(camera) <= FLOAT32_LIMIT


def check_float32(camera: Camera) -> None:
    """Raise InputError if float32 cannot compute this camera's codes."""
    gain = adc_gain_dn_per_v(camera)
    if gain > FLOAT32_LIMIT:
        raise InputError(
            f"precision is 'float32', which holds numbers up to {FLOAT32_LIMIT:g}, but the converter of {camera.name} "
            f"has {gain:.3g} DN/V; omit precision, or correct the gains and adc.full_scale_v."
        )
    if camera.adc.dnl_lsb and 2**camera.adc.bits > COUNTABLE_DN:
        raise InputError(
            f"precision is 'float32', which has no halves between codes from {COUNTABLE_DN} on, but {camera.name} has "
            f"adc.dnl_lsb and {camera.adc.bits} bits; omit precision, or use at most 23 bits."
        )


def precision_of(asked: str, camera: Camera) -> str:
    """Return the precision as asked, else float32 if it resolves single electrons."""
    if asked == "float32":
        check_float32(camera)
    if asked != "auto":
        return asked
    return "float32" if float32_counts(camera) else "float64"

"""Float32 or float64: which of them an exposure is computed in."""

from ..camera.camera import Camera
from ..core import InputError
from ..core.backend import FLOAT32_LIMIT
from ..stages.gains import adc_gain_dn_per_v

COUNTABLE_E, COUNTABLE_DN = 2**24, 2**23
"""What float32 counts: whole electrons; digital numbers, which are rounded and therefore need halves too."""


def float32_counts(camera: Camera) -> bool:
    """Whether float32 holds single electrons of a full well and the codes of this camera."""
    countable = camera.pixel.full_well_e <= COUNTABLE_E and 2**camera.code_bits <= COUNTABLE_DN
    return countable and adc_gain_dn_per_v(camera) <= FLOAT32_LIMIT


def check_float32(camera: Camera) -> None:
    """Raise InputError where float32, asked for, cannot compute this camera's codes."""
    gain = adc_gain_dn_per_v(camera)
    if gain > FLOAT32_LIMIT:
        raise InputError(
            f"precision is 'float32', which holds numbers up to {FLOAT32_LIMIT:g}, and the converter of {camera.name} "
            f"makes {gain:.3g} DN of a volt; leave the precision out, or mend the gains and adc.full_scale_v."
        )
    if camera.adc.dnl_lsb and 2**camera.adc.bits > COUNTABLE_DN:
        raise InputError(
            f"precision is 'float32', which has no halves between codes from {COUNTABLE_DN} on, and {camera.name} has "
            f"adc.dnl_lsb and {camera.adc.bits} bits; leave the precision out, or take 23 bits or fewer."
        )


def precision_of(asked: str, camera: Camera) -> str:
    """ "float32" or "float64": as asked, else float32 while it can count single electrons."""
    if asked == "float32":
        check_float32(camera)
    if asked != "auto":
        return asked
    return "float32" if float32_counts(camera) else "float64"

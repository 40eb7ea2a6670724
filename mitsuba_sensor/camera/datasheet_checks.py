"""Checks of a datasheet across its tables: what a CCD cannot have, and gains whose product is too large."""

from __future__ import annotations

from ..stages.chain import ORDER
from ..stages.gains import full_well_swing_v, gain_dn_per_e, sense_gain_v_per_e
from ..stages.stage import Datasheet

LARGEST = 1e30
"""Of a product of gains: squares of larger ones leave the range of numbers on the way to a variance."""


def check_technology(camera: Datasheet) -> None:
    """Raise ValueError where a CCD is given what the amplifiers in every pixel and column of a CMOS sensor make."""
    if camera.sensor.technology != "ccd":
        return
    given, neutral = [], []
    for effect in ORDER:
        for name, without in effect.fields.cmos_only.items() if effect.fields else ():
            value = getattr(getattr(camera, effect.table), name)
            if value is not None and value != without:
                given.append(f"{effect.table}.{name} is {value!r}")
                neutral.append(f"{effect.table}.{name} to {without!r}")
    if given:
        raise ValueError(
            f"{' and '.join(given)}, and sensor.technology is 'ccd': all pixels of a CCD have one amplifier and true "
            "CDS, so they have no offsets, gains, reset or telegraph noise of their own; "
            f"set {' and '.join(neutral)}, or sensor.technology to 'cmos'"
        )


def check_gains(camera: Datasheet) -> None:
    """Raise ValueError where the gains of several tables, each in its range, have a product beyond LARGEST."""
    well, node_v = camera.pixel.full_well_e, camera.pixel.full_well_e * sense_gain_v_per_e(camera)
    swings = node_v, node_v * camera.source_follower.gain, full_well_swing_v(camera)
    if max(swings) > LARGEST:
        raise ValueError(
            f"the gains make {max(swings):.3g} V of a full well of {well:g} e-; products of gains are at most "
            f"{LARGEST:g}: take a smaller readout.sense_gain_uv_per_e, source_follower.gain or readout.cds_gain"
        )
    if (gain := gain_dn_per_e(camera)) > LARGEST:
        raise ValueError(
            f"the gains make {gain:.3g} DN of one electron; products of gains are at most {LARGEST:g}: take smaller "
            "gains or a larger adc.full_scale_v"
        )

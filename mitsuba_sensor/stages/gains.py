"""Gains of the signal chain: A_SN, V_FS, A and the overall system gain K (EMVA 1288), from the datasheet."""

import math

from ..core.units import ELEMENTARY_CHARGE_C
from .stage import Datasheet

ANY_SENSE_GAIN_V_PER_E = 50e-6
"""A_SN of a camera whose datasheet has K alone. Its full scale makes up for it, so that no frame depends on it."""

LINEAR_BELOW = 1e-12
"""A V/e non-linearity α·A_SN·N/V_REF below this at full well is none: the node is linear to that share."""


def sense_gain_v_per_e(camera: Datasheet) -> float:
    """A_SN [V/e-]: as given, or V_REF·q/k₁; any where the overall system gain K alone is given."""
    readout = camera.readout
    if readout.sense_gain_uv_per_e is not None:
        return float(readout.sense_gain_uv_per_e * 1e-6)
    if readout.ve_k1_c is None:
        return ANY_SENSE_GAIN_V_PER_E
    return float(readout.v_ref_v * ELEMENTARY_CHARGE_C / readout.ve_k1_c)


def volts_per_electron(camera: Datasheet) -> float:
    """A_SN·A_SF·A_CDS [V/e-] of electrons at the sense node."""
    return float(
        sense_gain_v_per_e(camera) * camera.source_follower.gain * camera.readout.cds_gain
    )


def ve_nonlinearity_at_full_well(camera: Datasheet) -> float:
    """α·A_SN·N/V_REF of a full well, the exponent of the V/e curve; 0 where that is below LINEAR_BELOW."""
    linear_v = camera.pixel.full_well_e * sense_gain_v_per_e(camera)
    exponent = float(camera.readout.ve_nonlinearity * linear_v / camera.readout.v_ref_v)
    if exponent > LINEAR_BELOW:
        return exponent
    return 0.0


def full_well_at_node_v(camera: Datasheet) -> float:
    """Swing of a full well at the sense node [V], after its V/e curve."""
    linear_v, x = (
        float(camera.pixel.full_well_e * sense_gain_v_per_e(camera)),
        ve_nonlinearity_at_full_well(camera),
    )
    if x:
        return linear_v * -math.expm1(-x) / x
    return linear_v


def full_well_swing_v(camera: Datasheet) -> float:
    """Swing of a full well at the converter [V]: after V/e and V/V non-linearity and both amplifiers."""
    follower = camera.source_follower
    at_node = full_well_at_node_v(camera)
    return float(at_node * follower.gain * follower.vv_nonlinearity * camera.readout.cds_gain)


def full_scale_v(camera: Datasheet) -> float:
    """V_FS, the swing that fills the code range [V]: as given, or what makes the given overall system gain K.

    Where the datasheet has neither, it is the swing of a full well.
    """
    given, gain = camera.adc.full_scale_v, camera.readout.gain_dn_per_e
    if gain is not None:
        return float(volts_per_electron(camera) * 2.0**camera.adc.bits / gain)
    if given is None:
        return full_well_swing_v(camera)
    return float(given)


def adc_gain_dn_per_v(camera: Datasheet) -> float:
    """A = 2^bits/V_FS [DN/V]."""
    return float(2.0**camera.adc.bits / full_scale_v(camera))


def excess_noise(camera: Datasheet) -> float:
    """F², the variance of shot noise behind an EM gain over that in front of it times G²; 1 without one."""
    readout = camera.readout
    if readout.em_gain is None:
        return 1.0
    return em_excess_noise(readout.em_gain, readout.em_stages)


def em_excess_noise(gain: float, elements: int) -> float:
    """F² of a register of so many elements, each of which adds an electron with the same chance."""
    return float(2 * (gain - 1) * gain ** (-(elements + 1) / elements) + 1 / gain)


def gain_dn_per_e(camera: Datasheet) -> float:
    """EMVA 1288's overall system gain K = G·A_SN·A_SF·A_CDS·2^bits/V_FS [DN/e-], of small signals in the pixel.

    G is the EM gain of an EMCCD, else 1. Of several read-outs it is that of their linear code.
    """
    if camera.readouts:
        return float(camera.combined_readouts.nominal_gain)
    em_gain = camera.readout.em_gain or 1.0
    return float(em_gain * gain_behind_register_dn_per_e(camera))


def gain_behind_register_dn_per_e(camera: Datasheet) -> float:
    """K of an EM gain of 1: of electrons at the sense node [DN/e-]."""
    given = camera.readout.gain_dn_per_e
    if given is not None:
        return float(given)
    return volts_per_electron(camera) * adc_gain_dn_per_v(camera)

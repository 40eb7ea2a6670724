"""Gains of the signal chain: A_SN, V_FS, A and the overall system gain K (EMVA 1288), from the datasheet."""

import math

from ..core.units import ELEMENTARY_CHARGE_C
from .stage import Datasheet

ANY_SENSE_GAIN_V_PER_E = 50e-6
"""A_SN of a camera whose datasheet has only K. Its full scale compensates, so no frame depends on A_SN."""

LINEAR_BELOW = 1e-12
"""A V/e non-linearity α·A_SN·N/V_REF below this at full well is ignored."""


def sense_gain_v_per_e(camera: Datasheet) -> float:
    """Return A_SN [V/e-]: as given, or V_REF·q/k₁; arbitrary if only the overall system gain K is given."""
    readout = camera.readout
    if readout.sense_gain_uv_per_e is not None:
        return float(readout.sense_gain_uv_per_e * 1e-6)
    if readout.ve_k1_c is None:
        return ANY_SENSE_GAIN_V_PER_E
    return float(readout.v_ref_v * ELEMENTARY_CHARGE_C / readout.ve_k1_c)


def volts_per_electron(camera: Datasheet) -> float:
    """Return A_SN·A_SF·A_CDS [V/e-] for electrons at the sense node."""
    return float(
        sense_gain_v_per_e(camera) * camera.source_follower.gain * camera.readout.cds_gain
    )


def ve_nonlinearity_at_full_well(camera: Datasheet) -> float:
    """Return α·A_SN·N/V_REF at full well, the exponent of the V/e curve; 0 below LINEAR_BELOW."""
    linear_v = camera.pixel.full_well_e * sense_gain_v_per_e(camera)
    exponent = float(camera.readout.ve_nonlinearity * linear_v / camera.readout.v_ref_v)
    if exponent > LINEAR_BELOW:
        return exponent
    return 0.0


def full_well_at_node_v(camera: Datasheet) -> float:
    """Return the swing of a full well at the sense node after its V/e curve [V]."""
    linear_v, x = (
        float(camera.pixel.full_well_e * sense_gain_v_per_e(camera)),
        ve_nonlinearity_at_full_well(camera),
    )
    if x:
        return linear_v * -math.expm1(-x) / x
    return linear_v


def full_well_swing_v(camera: Datasheet) -> float:
    """Return the swing of a full well at the ADC [V], after V/e and V/V non-linearity and both amplifiers."""
    follower = camera.source_follower
    at_node = full_well_at_node_v(camera)
    return float(at_node * follower.gain * follower.vv_nonlinearity * camera.readout.cds_gain)


def full_scale_v(camera: Datasheet) -> float:
    """Return V_FS, the swing of the whole code range [V]: as given, from the overall system gain K, or a full well."""
    given, gain = camera.adc.full_scale_v, camera.readout.gain_dn_per_e
    if gain is not None:
        return float(volts_per_electron(camera) * 2.0**camera.adc.bits / gain)
    if given is None:
        return full_well_swing_v(camera)
    return float(given)


def adc_gain_dn_per_v(camera: Datasheet) -> float:
    """Return A = 2^bits/V_FS [DN/V]."""
    return float(2.0**camera.adc.bits / full_scale_v(camera))


def excess_noise(camera: Datasheet) -> float:
    """Return F², the shot noise variance after an EM gain G over G² times that before it; 1 without EM gain."""
    readout = camera.readout
    if readout.em_gain is None:
        return 1.0
    return em_excess_noise(readout.em_gain, readout.em_stages)


def em_excess_noise(gain: float, elements: int) -> float:
    """Return F² of a register of elements that each add an electron with the same probability."""
    return float(2 * (gain - 1) * gain ** (-(elements + 1) / elements) + 1 / gain)


def gain_dn_per_e(camera: Datasheet) -> float:
    """Return the overall system gain K = G·A_SN·A_SF·A_CDS·2^bits/V_FS [DN/e-] (EMVA 1288) for small signals.

    G is the EM gain of an EMCCD, else 1. With several readouts, K is the gain of their linear code.
    """
    if camera.readouts:
        return float(camera.combined_readouts.nominal_gain)
    em_gain = camera.readout.em_gain or 1.0
    return float(em_gain * gain_behind_register_dn_per_e(camera))


def gain_behind_register_dn_per_e(camera: Datasheet) -> float:
    """Return K without EM gain: DN per electron at the sense node [DN/e-]."""
    given = camera.readout.gain_dn_per_e
    if given is not None:
        return float(given)
    return volts_per_electron(camera) * adc_gain_dn_per_v(camera)

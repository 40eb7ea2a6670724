"""Gains of the signal chain: A_SN, V_FS, A and the overall system gain K (EMVA 1288), from the datasheet."""

from ..core.units import ELEMENTARY_CHARGE_C
from .stage import Datasheet


def sense_gain_v_per_e(camera: Datasheet) -> float:
    """A_SN [V/e-]: as given, or V_REF·q/k₁."""
    readout = camera.readout
    if readout.sense_gain_uv_per_e is not None:
        return float(readout.sense_gain_uv_per_e * 1e-6)
    return float(readout.v_ref_v * ELEMENTARY_CHARGE_C / readout.ve_k1_c)


def volts_per_electron(camera: Datasheet) -> float:
    """A_SN·A_SF·A_CDS [V/e-]."""
    return float(sense_gain_v_per_e(camera) * camera.source_follower.gain * camera.readout.cds_gain)


def full_scale_v(camera: Datasheet) -> float:
    """V_FS, the swing that fills the code range [V]; the swing of a full well unless the datasheet says otherwise."""
    if camera.adc.full_scale_v is not None:
        return float(camera.adc.full_scale_v)
    return float(camera.pixel.full_well_e * volts_per_electron(camera))


def adc_gain_dn_per_v(camera: Datasheet) -> float:
    """A = 2^bits/V_FS [DN/V]."""
    return float(2.0**camera.adc.bits / full_scale_v(camera))


def gain_dn_per_e(camera: Datasheet) -> float:
    """EMVA 1288's overall system gain K = A_SN·A_SF·A_CDS·2^bits/V_FS [DN/e-]."""
    return volts_per_electron(camera) * adc_gain_dn_per_v(camera)

"""Checks across the tables of a datasheet: impossible fields of a CCD, contradictory gains, noise sources."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from typing import TYPE_CHECKING

from ..core import InputError, nearest
from ..stages.chain import ORDER
from ..stages.datasheet import SensorSection
from ..stages.diffusion import SIGMA_MAX_PX
from ..stages.gains import full_well_swing_v, gain_dn_per_e, sense_gain_v_per_e
from ..stages.stage import Datasheet
from .dual_pixels import wrong_dual_pixels
from .gain_ladder import wrong_gain
from .readouts import wrong_readouts

if TYPE_CHECKING:
    from .camera import Camera

VOLT_NOISES = "white_nv_per_rthz", "rtn_uv"
"""Source follower noise in volts, which the conversion gain refers to electrons."""

ADD_SENSE_GAIN = "is a voltage, so electrons need a conversion gain; add readout.sense_gain_uv_per_e, e.g. 50"

OPTICS_OFF = {
    "diffraction": "set lens.diffraction to false",
    "veiling_glare": "set lens.veiling_glare to 0",
}
"""Optical effect → how to switch it off."""

GAIN_MAX = 1e30
"""Largest product of gains: its square stays finite in a variance."""


def wrong_technology(camera: Datasheet) -> Iterator[str]:
    """Yield an error if a CCD has noise of CMOS amplifiers in pixels and columns."""
    if camera.sensor.technology != "ccd":
        return
    given, neutral = [], []
    for effect in ORDER:
        for name in effect.fields.cmos_only if effect.fields else ():
            value = getattr(getattr(camera, effect.table), name)
            off = "true_cds" if name == "reset" else 0.0
            if value is not None and value != off:
                given.append(f"{effect.table}.{name} is {value!r}")
                neutral.append(f"{effect.table}.{name} to {off!r}")
    if given:
        yield (
            f"{' and '.join(given)}, but sensor.technology is 'ccd', whose pixels share one amplifier with true CDS; "
            f"set {' and '.join(neutral)}, or sensor.technology to 'cmos'"
        )


def wrong_diffusion(camera: Datasheet) -> Iterator[str]:
    """Yield an error if electrons diffuse beyond the neighbours that are computed."""
    smaller_um = min(camera.pixel.pitch_x_um, camera.pixel.pitch_y_um)
    widest_um = max(camera.quantum_efficiency.diffusion_um or (0.0,))
    if widest_um > SIGMA_MAX_PX * smaller_um:
        yield (
            f"quantum_efficiency.diffusion_um is {widest_um:g}; it must be at most {SIGMA_MAX_PX * smaller_um:g} "
            f"({SIGMA_MAX_PX:g} pixels of {smaller_um:g} µm)"
        )


def wrong_polarizers(camera: Datasheet) -> Iterator[str]:
    """Yield an error for a polariser curve whose length differs from the wavelengths of the quantum efficiency."""
    points = len(camera.quantum_efficiency.wavelengths_nm)
    for name in ("extinction_ratio", "polarizer_transmission"):
        value = getattr(camera.sensor, name)
        if isinstance(value, tuple) and len(value) != points:
            yield (
                f"sensor.{name} has {len(value)} values for {points} quantum_efficiency.wavelengths_nm; give one "
                "number, or one per wavelength"
            )


def wrong_one_gain(camera: Datasheet) -> Iterator[str]:
    """Yield errors if the gain is given twice, or if K alone cannot refer a noise in volts to electrons."""
    readout = camera.readout
    if readout.gain_dn_per_e is None:
        return
    if camera.adc.full_scale_v is not None:
        yield (
            f"readout.gain_dn_per_e is {readout.gain_dn_per_e:g} and adc.full_scale_v is {camera.adc.full_scale_v:g}, "
            "but each sets the gain; give either, and not both"
        )
    if readout.sense_gain_uv_per_e is not None or readout.ve_k1_c is not None:
        return
    for name in VOLT_NOISES:
        if getattr(camera.source_follower, name):
            yield f"source_follower.{name} {ADD_SENSE_GAIN}"
    residual = readout.ktc_residual
    if residual if residual is not None else readout.reset != "true_cds":
        yield f"the kTC noise of readout.reset {ADD_SENSE_GAIN}, or set readout.reset to 'true_cds'"


def wrong_gains(camera: Datasheet) -> Iterator[str]:
    """Yield errors if the product of the gains of several tables exceeds GAIN_MAX."""
    well_e = camera.pixel.full_well_e
    node_v = well_e * sense_gain_v_per_e(camera)
    swing_v = max(node_v, node_v * camera.source_follower.gain, full_well_swing_v(camera))
    if swing_v > GAIN_MAX:
        yield (
            f"the gains turn a full well of {well_e:g} e- into {swing_v:.3g} V; it must be at most {GAIN_MAX:g} V: "
            "reduce readout.sense_gain_uv_per_e, source_follower.gain or readout.cds_gain"
        )
    if (gain := gain_dn_per_e(camera)) > GAIN_MAX:
        yield (
            f"the overall system gain is {gain:.3g} DN/e-; it must be at most {GAIN_MAX:g}: reduce the gains, or raise "
            "adc.full_scale_v"
        )


def wrong_resets(camera: Datasheet) -> Iterator[str]:
    """Yield errors for partial resets without counted electrons, or with several electrons per photon."""
    if not camera.pixel.partial_resets:
        return
    if "shot_noise" in camera.sensor.without:
        yield (
            "pixel.partial_resets needs the counted electrons of shot noise, which sensor.without switches off; unset "
            "either"
        )
    if camera.quantum_efficiency.quantum_yield:
        yield (
            "pixel.partial_resets and quantum_efficiency.quantum_yield cannot be combined, because the yield acts "
            "after the resets; unset either"
        )


CHECKS: tuple[Callable[[Camera], Iterator[str]], ...] = (
    *(wrong_technology, wrong_diffusion, wrong_polarizers, wrong_dual_pixels, wrong_one_gain),
    *(wrong_resets, wrong_readouts, wrong_gains, wrong_gain),
)
"""Checks across tables; the first error rejects the datasheet."""


def noise_sources() -> tuple[str, ...]:
    """Return the keys of the stages that are noise sources, in the order of the chain."""
    return tuple(effect.key() for effect in ORDER if not effect.no_noise)


def checked_source(name: object, added: Iterable[str] = ()) -> str:
    """Return the key of a noise source, written ``dsnu_column`` or ``DSNU column``; else raise InputError.

    added : keys of the user's stages.
    """
    sources = (*noise_sources(), *added)
    key = str(name).strip().lower().replace(" ", "_").replace("-", "_")
    if key in sources:
        return key
    remedies = {effect.key(): effect.no_noise for effect in ORDER} | OPTICS_OFF
    remedy = nearest(key, sources) or f" The noise sources are {', '.join(sources)}."
    if remedies.get(key):
        remedy = f" Instead, {remedies[key]}."
    raise InputError(f"without has {name!r}, which is not a noise source.{remedy}")


def with_checked_sources(section: SensorSection) -> SensorSection:
    """Return the table with the keys of its ``without`` in the order of the chain, each once. Raises InputError."""
    off = {checked_source(name) for name in section.without}
    return section.model_copy(
        update={"without": tuple(name for name in noise_sources() if name in off)}
    )

"""Checks of a datasheet across its tables: what a CCD cannot have, and gains whose product is too large."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from ..core import InputError, nearest
from ..stages.chain import ORDER
from ..stages.datasheet import SensorSection
from ..stages.diffusion import SIGMA_MAX_PX
from ..stages.gains import full_well_swing_v, gain_dn_per_e, sense_gain_v_per_e
from ..stages.stage import Datasheet

IN_VOLTS = "white_nv_per_rthz", "rtn_uv"
"""Noise of the source follower in volts, which are so many electrons by the conversion gain."""

ADD_SENSE_GAIN = (
    "a voltage, which readout.gain_dn_per_e alone does not make electrons; "
    "add readout.sense_gain_uv_per_e, e.g. 50"
)

WITHOUT_OPTICS = {
    "diffraction": "set lens.diffraction to false to render without it",
    "veiling_glare": "set lens.veiling_glare to 0 to render without it",
}

LARGEST = 1e30
"""Of a product of gains: squares of larger ones leave the range of numbers on the way to a variance."""


def wrong_technology(camera: Datasheet) -> Iterator[str]:
    """Sentences where a CCD is given what the amplifiers in every pixel and column of a CMOS sensor make."""
    if camera.sensor.technology != "ccd":
        return
    given, neutral = [], []
    for effect in ORDER:
        for name in effect.fields.cmos_only if effect.fields else ():
            value = getattr(getattr(camera, effect.table), name)
            without = "true_cds" if name == "reset" else 0.0
            if value is not None and value != without:
                given.append(f"{effect.table}.{name} is {value!r}")
                neutral.append(f"{effect.table}.{name} to {without!r}")
    if given:
        yield (
            f"{' and '.join(given)}, and sensor.technology is 'ccd': all pixels of a CCD have one amplifier and true "
            "CDS, so they have no offsets, gains, reset or telegraph noise of their own; "
            f"set {' and '.join(neutral)}, or sensor.technology to 'cmos'"
        )


def wrong_diffusion(camera: Datasheet) -> Iterator[str]:
    """Sentences where electrons diffuse further than the shares of the neighbours reach."""
    smaller_um = min(camera.pixel.pitch_x_um, camera.pixel.pitch_y_um)
    widest_um = max(camera.quantum_efficiency.diffusion_um or (0.0,))
    if widest_um > SIGMA_MAX_PX * smaller_um:
        yield (
            f"quantum_efficiency.diffusion_um is up to {widest_um:g}, {widest_um / smaller_um:.3g} pixels of "
            f"{smaller_um:g} µm; it may be up to {SIGMA_MAX_PX:g} pixels, {SIGMA_MAX_PX * smaller_um:g}"
        )


def wrong_polarizers(camera: Datasheet) -> Iterator[str]:
    """Sentences where numbers of the polarisers are not one for each wavelength of the quantum efficiency."""
    points = len(camera.quantum_efficiency.wavelengths_nm)
    for name in ("extinction_ratio", "polarizer_transmission"):
        value = getattr(camera.sensor, name)
        if isinstance(value, tuple) and len(value) != points:
            yield (
                f"sensor.{name} has {len(value)} values for {points} quantum_efficiency.wavelengths_nm; give one "
                "number, or one for each of them"
            )


def wrong_one_gain(camera: Datasheet) -> Iterator[str]:
    """Sentences where the gain is given twice, and where K alone does not say what the datasheet needs."""
    readout = camera.readout
    if readout.gain_dn_per_e is None:
        return
    if camera.adc.full_scale_v is not None:
        yield (
            f"readout.gain_dn_per_e is {readout.gain_dn_per_e:g} and adc.full_scale_v is {camera.adc.full_scale_v:g}, "
            "and each makes the gain; give either readout.gain_dn_per_e or adc.full_scale_v, and not both"
        )
    if readout.sense_gain_uv_per_e is not None or readout.ve_k1_c is not None:
        return
    for name in IN_VOLTS:
        if getattr(camera.source_follower, name):
            yield (f"source_follower.{name} is {ADD_SENSE_GAIN}")
    share = readout.ktc_residual
    if share if share is not None else readout.reset != "true_cds":
        yield (
            f"the kTC noise of readout.reset is {ADD_SENSE_GAIN}, or set readout.reset to 'true_cds'"
        )


def wrong_gains(camera: Datasheet) -> Iterator[str]:
    """Sentences where the gains of several tables, each in its range, have a product beyond LARGEST."""
    well, node_v = (
        camera.pixel.full_well_e,
        camera.pixel.full_well_e * sense_gain_v_per_e(camera),
    )
    swings = node_v, node_v * camera.source_follower.gain, full_well_swing_v(camera)
    if max(swings) > LARGEST:
        yield (
            f"the gains make {max(swings):.3g} V of a full well of {well:g} e-; products of gains are at most "
            f"{LARGEST:g}: take a smaller readout.sense_gain_uv_per_e, source_follower.gain or readout.cds_gain"
        )
    if (gain := gain_dn_per_e(camera)) > LARGEST:
        yield (
            f"the gains make {gain:.3g} DN of one electron; products of gains are at most {LARGEST:g}: take smaller "
            "gains or a larger adc.full_scale_v"
        )


def wrong_resets(camera: Datasheet) -> Iterator[str]:
    """Sentences for partial resets of a well that nobody counts, or whose electrons come in bursts."""
    if not camera.pixel.partial_resets:
        return
    if "shot_noise" in camera.sensor.without:
        yield (
            "pixel.partial_resets is set, and they are part of the shot noise that sensor.without switches off; unset "
            "one of both"
        )
    if camera.quantum_efficiency.quantum_yield:
        yield (
            "pixel.partial_resets is set and quantum_efficiency.quantum_yield too, whose electrons come in bursts "
            "behind the resets; unset one of both"
        )


def noise_sources() -> tuple[str, ...]:
    """Keys of the stages that are noise sources, in the order of the chain."""
    return tuple(effect.key() for effect in ORDER if not effect.no_noise)


def checked_source(name: object, more: Iterable[str] = ()) -> str:
    """The key of a noise source: ``dsnu_column``, or as a table of stages prints it, ``DSNU column``.

    more : keys of stages that the user added.  Raises InputError for any other name.
    """
    known = (*noise_sources(), *more)
    key = str(name).strip().lower().replace(" ", "_").replace("-", "_")
    if key in known:
        return key
    remedies = {effect.key(): effect.no_noise for effect in ORDER} | WITHOUT_OPTICS
    if remedies.get(key):
        raise InputError(f"without names {name!r}, which is no noise source; {remedies[key]}.")
    raise InputError(
        f"without names {name!r}; the noise sources are {', '.join(known)}.{nearest(key, known)}"
    )


def with_checked_sources(section: SensorSection) -> SensorSection:
    """The table with the keys of its ``without`` in the order of the chain, each once. Raises InputError."""
    off = {checked_source(name) for name in section.without}
    return section.model_copy(
        update={"without": tuple(name for name in noise_sources() if name in off)}
    )

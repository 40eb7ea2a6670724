"""Cameras that read every pixel several times, and the combination of their readouts into one linear code.

Each readout is a separate camera: the camera of the file with some changed fields (``readout_cameras``).
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Annotated, Any, Literal, Self

from pydantic import Field, model_validator

from ..core import InputError, nearest
from ..stages.combined_readouts import (
    Combination,
    CombinedReadouts,
    LinearisedReadout,
    ReadoutChain,
)
from ..stages.datasheet import FileTable, Fraction, NotNegative, Positive, optional
from ..stages.gains import gain_dn_per_e
from ..stages.stage import converter_of
from .figures import figures_if_any, full_well_dn, saturation_dn, saturation_e

if TYPE_CHECKING:
    from .camera import Camera

RATIOS = (
    ("exposure_ratio", 1, ("exposure", "photodiode")),
    ("sensitivity", 1, ("photodiode",)),
    ("gap_us", 0, ("exposure",)),
)
"""Field, its default, and the kinds of readouts that allow it."""

CHARGE_FIELDS: tuple[str, ...] = (
    *("pixel.full_well_e", "readout.", "source_follower.", "adc."),
    "dark_current.overflow",
)
"""Fields, or their beginnings, that may differ between readouts of one charge."""

CROSSTALK = tuple(
    f"quantum_efficiency.{way}"
    for way in ("crosstalk", "crosstalk_from", "crosstalk_pairs", "diffusion_um")
)
PHOTODIODE_FIELDS = ("pixel.prnu", "dark_current.", *CROSSTALK)
"""Fields that may also differ for a second photodiode."""

READOUTS_MAX = 8
HAND_OVER = 0.9
"""Default fraction of its saturation at which a readout switches to the next."""
HAND_OVER_MAX = 0.97
"""Above this fraction, noise may keep a full pixel below the hand-over."""
FULL_MARGIN = 5.0
"""Least distance of a full pixel from the hand-over, in dark noise: crossed in 3 of 10 million frames."""
STEP_MAX = 1 / 16
"""Largest step of a readout as a fraction of all linear codes."""


class Readout(FileTable):
    """A readout of every pixel: the camera above with these fields changed."""

    name: Annotated[str, Field(min_length=1, pattern=r"^[A-Za-z0-9_-]+$")] = Field(
        description="name of the readout", examples=["high"]
    )
    of: Literal["charge", "exposure", "photodiode"] = Field(
        "charge",
        title="dual conversion gain, LOFIC; staggered exposures (DOL); split pixel",
        description="what it reads: the charge of the previous readout again, a separate exposure, or a "
        "separate photodiode",
        examples=["exposure"],
    )
    exposure_ratio: Annotated[float, Field(ge=1e-6, le=1e6, strict=True)] = optional(
        "exposure time over the frame's exposure time, for a separate exposure or photodiode",
        0.0625,
        1.0,
    )
    gap_us: NotNegative = optional(
        "time from the end of the previous exposure to the start of a separate exposure [µs]",
        30,
        0.0,
        title="staggered exposures (DOL)",
    )
    sensitivity: Annotated[float, Field(ge=1e-6, le=1, strict=True)] = optional(
        "photoelectrons of its photodiode over those of the first: area times transmission",
        0.1,
        1.0,
    )
    fields: dict[str, Any] = optional(
        "dotted field of the camera → its value in this readout",
        {"readout.gain_dn_per_e": 0.05},
        {},
    )

    @model_validator(mode="after")
    def _ratios_have_a_charge(self) -> Self:
        allowed = CHARGE_FIELDS
        if self.of == "photodiode":
            allowed += PHOTODIODE_FIELDS
        for name, default, owners in RATIOS:
            if getattr(self, name) != default and self.of not in owners:
                raise ValueError(
                    f"{name} needs a separate charge; set of to {' or '.join(map(repr, owners))}, or omit {name}"
                )
        for dotted in self.fields:
            if not dotted.startswith(allowed):
                raise ValueError(
                    f"fields has {dotted!r}, which a readout of {self.of!r} cannot change; it can change "
                    f"{', '.join(allowed)}{nearest(dotted, allowed)}"
                )
        return self


class CombineSection(FileTable):
    """Combination of the readouts into one linear code."""

    bits: Annotated[int, Field(ge=1, le=24, strict=True)] = optional(
        "resolution of the linear code [bit]", 20, 20
    )
    gain_dn_per_e: Positive | None = optional(
        "linear code per electron of the first readout; default: gain of the first readout [DN/e-]",
        1.0,
    )
    black_level_dn: NotNegative | None = optional(
        "black level of the linear code; default: black level of the first readout, rescaled [DN]",
        64,
    )
    hand_over: Annotated[tuple[Fraction, ...], Field(min_length=1)] = optional(
        "fraction of its saturation at which a readout switches to the next: one, or one per "
        "readout except the last",
        [0.9],
        (HAND_OVER,),
    )
    blend_from: tuple[Fraction, ...] = optional(
        "fraction of its saturation from which a readout is averaged with the next; default: "
        "no averaging",
        [0.6],
        (),
    )


def wrong_readouts(camera: Camera) -> Iterator[str]:
    """Yield errors for readouts that do not fit the camera or each other."""
    readouts, section = camera.readouts, camera.combine
    if not readouts:
        return
    if not 2 <= len(readouts) <= READOUTS_MAX:
        yield f"readouts has {len(readouts)} table(s); give 2 to {READOUTS_MAX}, the most sensitive first"
    names = [readout.name for readout in readouts]
    if len(set(names)) < len(names):
        yield f"readouts are called {', '.join(names)}; give each a different name"
    if (readouts[0].of, readouts[0].exposure_ratio) != ("charge", 1):
        yield (
            f"the first of readouts, {names[0]!r}, always reads the frame's exposure; omit its of and exposure_ratio"
        )
    cameras = camera.readout_cameras.values()
    if any(x.pixel.hits_per_cm2_s or x.readout.em_gain not in (None, 1) for x in cameras):
        yield (
            "readouts cannot be combined with radiation hits or electron multiplication; set pixel.hits_per_cm2_s to 0 "
            "and unset readout.em_gain, or omit readouts"
        )
    if camera.sensor.technology == "ccd":
        yield "sensor.technology is 'ccd', which reads its charge once; omit readouts"
    if camera.gains:
        yield "gains and readouts cannot be combined; give each readout its gain in fields"
    if camera.quantum_efficiency.image_lag:
        yield "readouts cannot be combined with image lag; set quantum_efficiency.image_lag to 0"
    count = len(readouts) - 1
    ends = _fractions(section.hand_over, count, "hand_over")
    begins = _fractions(section.blend_from or ends, count, "blend_from")
    for begin, end in zip(begins, ends, strict=True):
        if begin > end:
            yield f"combine.blend_from is {begin:g}; it must be at most combine.hand_over, {end:g}"
    stage = camera.combined_readouts
    full_e = [
        saturation_e(readout) / chain.light_ratio
        for readout, chain in zip(cameras, stage.readouts, strict=True)
    ]
    for number in range(1, len(names)):
        if full_e[number] <= full_e[number - 1]:
            yield (
                f"readout {names[number]!r} saturates at {full_e[number]:.4g} e- of the frame's exposure, but the "
                f"previous readout {names[number - 1]!r} at {full_e[number - 1]:.4g} e-; list the most sensitive first"
            )
    linearised = stage.combination.readouts
    for name, readout, linear in zip(names[:-1], cameras, linearised, strict=False):
        if (figures := figures_if_any(readout)) is None:
            continue
        noise_dn = figures.temporal_dark_noise_e * figures.system_gain_dn_per_e
        full_dn = full_well_dn(readout)
        if full_dn - linear.end_dn < FULL_MARGIN * noise_dn:
            yield (  # a saturated readout would be used in some frames
                f"readout {name!r} saturates at {full_dn:.4g} DN and hands over at {linear.end_dn:g} DN, less than "
                f"{FULL_MARGIN:g} times its dark noise of {noise_dn:.3g} DN below; reduce combine.hand_over, or the "
                "gain of the readout"
            )
    if stage.black_level_dn >= stage.highest / 2:
        yield (
            f"the black level of the linear code is {stage.black_level_dn:.6g} DN; it must be below half of the "
            f"full-scale code {stage.highest}: raise combine.bits, or reduce combine.black_level_dn"
        )
    for name, linear in zip(names, linearised, strict=True):
        step_dn = stage.nominal_gain * linear.electrons_per_dn
        if step_dn > STEP_MAX * stage.highest:
            yield (
                f"a step of the readout {name!r} is {step_dn:.4g} linear codes; it must be at most "
                f"1/{1 / STEP_MAX:g} of the full-scale code {stage.highest}: raise combine.bits, or reduce "
                "combine.gain_dn_per_e"
            )


def _fractions(given: Sequence[float], count: int, name: str) -> tuple[float, ...]:
    """Return one fraction for every readout except the last. Raises ValueError."""
    if len(given) not in (1, count):
        raise ValueError(
            f"combine.{name} has {len(given)} values; give one value, or {count}: one per readout except the last"
        )
    return tuple(given) * (count // len(given))


def readout_cameras(camera: Camera) -> dict[str, Camera]:
    """Return readout name → camera of the same sensor unit with this readout alone. Raises ValueError."""
    plain = camera.model_copy(update={"readouts": (), "combine": CombineSection()})
    cameras: dict[str, Camera] = {}
    charge_fields: dict[str, object] = {}
    kept = (*PHOTODIODE_FIELDS, "pixel.full_well_e", "quantum_efficiency.")
    for number, readout in enumerate(camera.readouts):
        fields = dict(readout.fields)
        if readout.of == "charge" and number:
            fields = {**charge_fields, **fields}
        elif readout.sensitivity != 1:
            fields["quantum_efficiency.curves"] = {
                name: [readout.sensitivity * value for value in curve]
                for name, curve in camera.quantum_efficiency.curves.items()
            }
        charge_fields = {name: x for name, x in fields.items() if name.startswith(kept)}
        cameras[readout.name] = _with_fields(plain, readout.name, fields)
    return cameras


def camera_of_readout(camera: Camera, name: str) -> Camera:
    """Return the camera with a single readout. Raises InputError."""
    if camera.sensor.dual_pixel:
        raise InputError(
            f"{camera.name} has dual pixels, whose photodiodes are not separate cameras; omit {name!r}, and use "
            "frames.readouts['left'] or frames.readouts['right']."
        )
    if name not in camera.readout_cameras:
        raise unknown_readout(camera.name, name, camera.readout_cameras)
    return camera.readout_cameras[name]


def unknown_readout(camera: str, name: str, known: Collection[str]) -> InputError:
    """Return the error for an unknown readout.  camera : its name.  known : names of its readouts."""
    if not known:
        return InputError(
            f"{camera} reads every pixel once, so it has no readout {name!r}; omit the name, or add [[readouts]] to "
            "its file."
        )
    return InputError(
        f"{camera} has no readout {name!r}; its readouts are {', '.join(known)}.{nearest(str(name), known)}"
    )


def readout_notes(camera: Camera) -> Iterator[str]:
    """Yield notes on unusual combinations."""
    if not camera.readouts:
        return
    stage = camera.combined_readouts
    last = stage.readouts[-1]
    full_e = saturation_e(camera.readout_cameras[last.name]) / last.light_ratio
    ends_e = (stage.highest - stage.black_level_dn) / stage.nominal_gain
    if ends_e < full_e:
        yield (
            f"combine.bits is {camera.combine.bits}, so the linear code saturates at {ends_e:.4g} e-, before the "
            f"readout {last.name!r} at {full_e:.4g} e-; raise combine.bits, or reduce combine.gain_dn_per_e"
        )
    if max(camera.combine.hand_over) > HAND_OVER_MAX:
        yield (
            f"combine.hand_over is {max(camera.combine.hand_over):g}, so noise may keep a full pixel below it, and its "
            "code comes from a saturated readout; set it to 0.95 or less"
        )


def _with_fields(camera: Camera, name: str, fields: Mapping[str, object]) -> Camera:
    """Return the camera with the fields of a readout. Raises ValueError."""
    unset = dict.fromkeys(CROSSTALK if any(field in fields for field in CROSSTALK) else ())
    in_volts = camera.source_follower.white_nv_per_rthz is not None
    if in_volts and "source_follower.read_noise_e" in fields:
        unset["source_follower.white_nv_per_rthz"] = None
    try:
        changed = camera.replace(**{**unset, **fields})
    except InputError as error:
        reason = str(error).removeprefix(f"{camera.name}: ").rstrip(".")
        raise ValueError(f"readout {name!r}: {reason}") from None
    sources = dict.fromkeys(fields, f"readout {name}")
    return changed.model_copy(update={"sources": {**camera.sources, **sources}})


def combined_readouts(camera: Camera) -> CombinedReadouts:
    """Return the last stage of a camera with readouts: their chains and combination. Raises ValueError."""
    chains, cameras = list[ReadoutChain](), camera.readout_cameras
    charge, photodiode, ratios = "", "", (1.0, 1.0)
    for number, readout in enumerate(camera.readouts):
        if number and readout.of != "charge":
            charge, ratios = readout.name, (readout.exposure_ratio, readout.sensitivity)
            photodiode = charge if readout.of == "photodiode" else ""
        stages = cameras[readout.name].stages
        chains.append(ReadoutChain(readout.name, charge, photodiode, *ratios, stages))
    return CombinedReadouts(tuple(chains), _combination(camera, cameras, chains))


def _combination(
    camera: Camera, cameras: Mapping[str, Camera], chains: Sequence[ReadoutChain]
) -> Combination:
    """Return the combination of readouts by their nominal gains. Raises ValueError."""
    section, count = camera.combine, len(chains) - 1
    ends = _fractions(section.hand_over, count, "hand_over")
    begins = _fractions(section.blend_from or ends, count, "blend_from")
    linearised = list[LinearisedReadout]()
    for number, chain in enumerate(chains):
        readout = cameras[chain.name]
        black_dn = converter_of(readout.stages).black_level_dn
        per_dn_e = 1 / (gain_dn_per_e(readout) * chain.light_ratio)
        if number == count:
            linearised.append(LinearisedReadout(black_dn, per_dn_e))
            break
        span_dn = saturation_dn(readout) - black_dn
        end_dn = round(black_dn + ends[number] * span_dn)
        begin_dn = min(round(black_dn + begins[number] * span_dn), end_dn)
        linearised.append(LinearisedReadout(black_dn, per_dn_e, begin_dn, end_dn))
    first = linearised[0]
    gain = section.gain_dn_per_e or 1 / first.electrons_per_dn
    black_dn = float(round(first.black_dn * gain * first.electrons_per_dn))
    if section.black_level_dn is not None:
        black_dn = section.black_level_dn
    return Combination(tuple(linearised), section.bits, gain, black_dn)

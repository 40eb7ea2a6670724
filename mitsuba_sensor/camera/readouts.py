"""The read-outs of a camera that reads every pixel several times, and how they are combined into one linear code.

Each read-out is a camera of its own: the camera of the file with some of its fields changed (``readout_cameras``).
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
"""Field, its default, and the kinds of read-outs that may have it."""

BEHIND_CHARGE: tuple[str, ...] = (
    "pixel.full_well_e",
    "readout.",
    "source_follower.",
    "adc.",
    "dark_current.overflow",
)
"""Fields, or beginnings of fields, that read-outs of one charge may have differently."""

CROSSTALK = tuple(
    f"quantum_efficiency.{way}"
    for way in ("crosstalk", "crosstalk_from", "crosstalk_pairs", "diffusion_um")
)
OF_PHOTODIODE = ("pixel.prnu", "dark_current.", *CROSSTALK)
"""Fields that a second photodiode may have differently, too."""

MOST_READOUTS = 8
HAND_OVER = 0.9
"""Share of its saturation at which a read-out hands over to the next, unless the file says otherwise."""
LATE = 0.97
FULL_MARGIN = 5.0
"""Noise in the dark by which a full pixel is above the hand-over at least: below it in 3 of 10 million frames."""
LARGEST_STEP = 1 / 16
"""Of a read-out, as a share of all linear codes."""


class Readout(FileTable):
    """One read-out of every pixel: the camera above with these fields changed."""

    name: Annotated[str, Field(min_length=1, pattern=r"^[A-Za-z0-9_-]+$")] = Field(
        description="how the read-out is called", examples=["high"]
    )
    of: Literal["charge", "exposure", "photodiode"] = Field(
        "charge",
        title="dual conversion gain, LOFIC; staggered exposures (DOL); split pixel",
        description="the same charge as that of the read-out before, read again; an exposure of its own; or the charge "
        "of a photodiode of its own",
        examples=["exposure"],
    )
    exposure_ratio: Annotated[float, Field(ge=1e-6, le=1e6, strict=True)] = optional(
        "its exposure time over that of the frame, of an exposure or photodiode of its own",
        0.0625,
        1.0,
    )
    gap_us: NotNegative = optional(
        "from the end of the exposure before until an exposure of its own begins [µs]",
        30,
        0.0,
        title="staggered exposures (DOL)",
    )
    sensitivity: Annotated[float, Field(ge=1e-6, le=1, strict=True)] = optional(
        "photoelectrons of its photodiode over those of the first one in the same time: area times "
        "transmission",
        0.1,
        1.0,
    )
    fields: dict[str, Any] = optional(
        "dotted field of the camera → its value in this read-out",
        {"readout.gain_dn_per_e": 0.05},
        {},
    )

    @model_validator(mode="after")
    def _ratios_have_a_charge(self) -> Self:
        allowed = BEHIND_CHARGE
        if self.of == "photodiode":
            allowed += OF_PHOTODIODE
        for name, default, owners in RATIOS:
            if getattr(self, name) != default and self.of not in owners:
                raise ValueError(
                    f"{name} belongs to a charge of its own; set of to {' or '.join(map(repr, owners))}, or leave "
                    f"{name} out"
                )
        for dotted in self.fields:
            if not dotted.startswith(allowed):
                raise ValueError(
                    f"fields names {dotted!r}, which a read-out of {self.of!r} has as the camera has it; its own can "
                    f"be {', '.join(allowed)}{nearest(dotted, allowed)}"
                )
        return self


class CombineSection(FileTable):
    """How the read-outs become one linear code."""

    bits: Annotated[int, Field(ge=1, le=24, strict=True)] = optional(
        "resolution of the linear code [bit]", 20, 20
    )
    gain_dn_per_e: Positive | None = optional(
        "linear code per electron of the first read-out; default: that of the first read-out [DN/e-]",
        1.0,
    )
    black_level_dn: NotNegative | None = optional(
        "linear code of darkness; default: that of the first read-out in the steps of the linear code [DN]",
        64,
    )
    hand_over: Annotated[tuple[Fraction, ...], Field(min_length=1)] = optional(
        "share of its saturation at which a read-out hands over to the next; one for all, or one for each "
        "but the last",
        [0.9],
        (HAND_OVER,),
    )
    blend_from: tuple[Fraction, ...] = optional(
        "share of its saturation from which on a read-out is averaged with the next, up to hand_over; "
        "default: a threshold without averaging",
        [0.6],
        (),
    )


def wrong_readouts(camera: Camera) -> Iterator[str]:
    """What does not fit the camera, or one of its read-outs another."""
    readouts, section = camera.readouts, camera.combine
    if not readouts:
        return
    if not 2 <= len(readouts) <= MOST_READOUTS:
        yield (
            f"readouts has {len(readouts)} table(s); a combination has 2 to {MOST_READOUTS} of them, the most "
            "sensitive first"
        )
    names = [one.name for one in readouts]
    if len(set(names)) < len(names):
        yield f"readouts are called {', '.join(names)}; give each another name"
    if (readouts[0].of, readouts[0].exposure_ratio) != ("charge", 1):
        yield (
            f"the first of readouts, {names[0]!r}, is that of the frame's own exposure; leave out its of and its "
            "exposure_ratio"
        )
    cameras = camera.readout_cameras.values()
    if any(one.pixel.hits_per_cm2_s or one.readout.em_gain not in (None, 1) for one in cameras):
        yield (
            "readouts are combined, and the theory of a combination knows neither radiation hits nor electron "
            "multiplication; set pixel.hits_per_cm2_s to 0 and unset readout.em_gain, or leave readouts out"
        )
    if camera.sensor.technology == "ccd":
        yield "sensor.technology is 'ccd', which reads its charge once; leave readouts out"
    if camera.gains:
        yield "gains are settings of a camera with one read-out; give each read-out its gain in fields"
    if camera.quantum_efficiency.image_lag:
        yield "readouts need pixels with one charge in a frame; set quantum_efficiency.image_lag to 0"
    count = len(readouts) - 1
    ends = _shares(section.hand_over, count, "hand_over")
    for begin, end in zip(
        _shares(section.blend_from or ends, count, "blend_from"), ends, strict=True
    ):
        if begin > end:
            yield f"combine.blend_from is {begin:g} and hand_over {end:g}; averaging begins below where it ends"
    stage = camera.combined_readouts
    full_e = [
        saturation_e(one) / chain.light_ratio
        for one, chain in zip(cameras, stage.readouts, strict=True)
    ]
    for number in range(1, len(names)):
        if full_e[number] <= full_e[number - 1]:
            yield (
                f"read-out {names[number]!r} saturates at {full_e[number]:.4g} e- of the frame's exposure, and "
                f"{names[number - 1]!r} before it at {full_e[number - 1]:.4g}; give the most sensitive read-out first"
            )
    linearised = stage.combination.readouts
    for name, one, linear in zip(names[:-1], cameras, linearised, strict=False):
        if (figures := figures_if_any(one)) is None:
            continue
        noise_dn = figures.temporal_dark_noise_e * figures.system_gain_dn_per_e
        full_dn = full_well_dn(one)
        if full_dn - linear.end_dn < FULL_MARGIN * noise_dn:
            yield (  # a saturated read-out would count in some frames
                f"read-out {name!r} is full at {full_dn:.4g} DN, hands over at {linear.end_dn:g} and has "
                f"{noise_dn:.3g} DN of noise in the dark; full and hand-over must be {FULL_MARGIN:g} times that "
                "apart: take a lower combine.hand_over, or a smaller gain of the read-out"
            )
    if stage.black_level_dn >= stage.highest / 2:
        yield (
            f"the linear code of darkness is {stage.black_level_dn:.6g}, and {section.bits} bits end at "
            f"{stage.highest}; take more combine.bits, or a lower combine.black_level_dn"
        )
    for name, linear in zip(names, linearised, strict=True):
        step_dn = stage.nominal_gain * linear.electrons_per_dn
        if step_dn > LARGEST_STEP * stage.highest:
            yield (
                f"a code of the read-out {name!r} is {step_dn:.4g} linear codes, and {section.bits} bits end at "
                f"{stage.highest}, {1 / LARGEST_STEP:g} of them at least are needed: take more combine.bits, or a "
                "smaller combine.gain_dn_per_e"
            )


def _shares(given: Sequence[float], count: int, name: str) -> tuple[float, ...]:
    """One share for every read-out but the last. Raises ValueError."""
    if len(given) not in (1, count):
        raise ValueError(
            f"combine.{name} has {len(given)} values; give one, or {count}: one for each read-out but the last"
        )
    return tuple(given) * (count // len(given))


def readout_cameras(camera: Camera) -> dict[str, Camera]:
    """The camera of each read-out by its name: the same chip with one read-out. Raises ValueError."""
    plain = camera.model_copy(update={"readouts": (), "combine": CombineSection()})
    found: dict[str, Camera] = {}
    of_charge: dict[str, object] = {}
    for number, readout in enumerate(camera.readouts):
        fields = dict(readout.fields)
        in_front = (*OF_PHOTODIODE, "pixel.full_well_e", "quantum_efficiency.")
        if readout.of == "charge" and number:
            fields = {**of_charge, **fields}
        elif readout.sensitivity != 1:
            fields["quantum_efficiency.curves"] = {
                name: [readout.sensitivity * value for value in curve]
                for name, curve in camera.quantum_efficiency.curves.items()
            }
        of_charge = {name: x for name, x in fields.items() if name.startswith(in_front)}
        found[readout.name] = _with_fields(plain, readout.name, fields)
    return found


def camera_of_readout(camera: Camera, name: str) -> Camera:
    """The camera with one of its read-outs alone. Raises InputError."""
    if camera.sensor.dual_pixel:
        raise InputError(
            f"{camera.name} has dual pixels, whose photodiodes are no cameras of their own: leave {name!r} out, and "
            "take frames.readouts['left'] or ['right'] of its frames."
        )
    if name not in camera.readout_cameras:
        raise unknown_readout(camera.name, name, camera.readout_cameras)
    return camera.readout_cameras[name]


def unknown_readout(camera: str, name: str, known: Collection[str]) -> InputError:
    """The sentence on a name that no read-out has.  camera : its name.  known : names of its read-outs."""
    if not known:
        return InputError(
            f"{name!r} is no read-out of {camera}, which reads every pixel once; leave the name out, or add "
            "[[readouts]] to its file."
        )
    said = f"{name!r} is no read-out of {camera}; its read-outs are {', '.join(known)}."
    return InputError(f"{said}{nearest(str(name), known)}")


def readout_notes(camera: Camera) -> Iterator[str]:
    """Sentences on a combination that is allowed and may surprise."""
    if not camera.readouts:
        return
    stage = camera.combined_readouts
    last = stage.readouts[-1]
    full_e = saturation_e(camera.readout_cameras[last.name]) / last.light_ratio
    ends_e = (stage.highest - stage.black_level_dn) / stage.nominal_gain
    if ends_e < full_e:
        yield (
            f"combine.bits is {camera.combine.bits}, and the linear code ends at {ends_e:.4g} e-, before the read-out "
            f"{last.name!r}, at {full_e:.4g}; take more bits, or a smaller combine.gain_dn_per_e"
        )
    if max(camera.combine.hand_over) > LATE:
        yield (
            f"combine.hand_over is {max(camera.combine.hand_over):g}, and noise may keep a full pixel below it, which "
            "then has the code of a read-out that is saturated; take 0.95 or less"
        )


def _with_fields(camera: Camera, name: str, fields: Mapping[str, object]) -> Camera:
    """The camera with fields of a read-out. Raises ValueError."""
    unset = dict.fromkeys(CROSSTALK if any(field in fields for field in CROSSTALK) else ())
    in_volts = camera.source_follower.white_nv_per_rthz is not None
    if in_volts and "source_follower.read_noise_e" in fields:
        unset["source_follower.white_nv_per_rthz"] = None
    try:
        changed = camera.replace(**{**unset, **fields})
    except InputError as error:
        said = str(error).removeprefix(f"{camera.name}: ").rstrip(".")
        raise ValueError(f"read-out {name!r}: {said}") from None
    sources = dict.fromkeys(fields, f"read-out {name}")
    return changed.model_copy(update={"sources": {**camera.sources, **sources}})


def combined_readouts(camera: Camera) -> CombinedReadouts:
    """The last stage of a camera with read-outs: their chains and combination. Raises ValueError."""
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
    """The combination of read-outs by their nominal gains. Raises ValueError."""
    section, count = camera.combine, len(chains) - 1
    ends = _shares(section.hand_over, count, "hand_over")
    begins = _shares(section.blend_from or ends, count, "blend_from")
    linearised = list[LinearisedReadout]()
    for number, chain in enumerate(chains):
        one = cameras[chain.name]
        black_dn = converter_of(one.stages).black_level_dn
        per_dn_e = 1 / (gain_dn_per_e(one) * chain.light_ratio)
        if number == count:
            linearised.append(LinearisedReadout(black_dn, per_dn_e))
            break
        span_dn = saturation_dn(one) - black_dn
        end_dn = round(black_dn + ends[number] * span_dn)
        begin_dn = min(round(black_dn + begins[number] * span_dn), end_dn)
        linearised.append(LinearisedReadout(black_dn, per_dn_e, begin_dn, end_dn))
    first = linearised[0]
    gain = section.gain_dn_per_e or 1 / first.electrons_per_dn
    black_dn = float(round(first.black_dn * gain * first.electrons_per_dn))
    if section.black_level_dn is not None:
        black_dn = section.black_level_dn
    return Combination(tuple(linearised), section.bits, gain, black_dn)

"""expose(): photons in, digital numbers out."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..core.backend import BRIGHTEST, NUMPY_FLOAT32, NUMPY_FLOAT64
from ..core.checks import check_types
from ..core.errors import InputError, require_seed
from ..core.exposure import Exposure
from ..core.frame import Frame
from ..core.sensor_window import SensorWindow
from ..core.signals import Photons
from .camera import Camera
from .chain import adc_gain_dn_per_v
from .chain import chain as physical_chain
from .checks import as_photons, check_compensation, check_numbers, checked_maps, checked_names, checked_origin
from .konnik2014 import Konnik2014Settings, chain_of
from .noise_budget import NoiseBudget, noise_budget_of, stage_report
from .run import PRECISIONS, Engine, Precision, Run, choose_backend

if TYPE_CHECKING:
    from .plan import Plan

KEEP = ("photons", "photoelectrons", "dark_electrons", "electrons", "volts")
"""Intermediate signals that ``expose(keep=…)`` can return: mean photons of all bands, electrons that light and dark
current left in the well, their sum [e-], swing at the converter [V]."""


COUNTABLE = 2**24
"""Whole numbers up to here are whole in float32: electrons of a full well, digital numbers."""


@dataclass(frozen=True, eq=False)
class Frames:
    """Raw frames of one camera.

    digital : (N, H, W) uint8, uint16 or uint32, whichever holds ``adc.bits`` [DN].
    photons, photoelectrons, dark_electrons, electrons, volts : (N, H, W) float64 if asked for by ``keep``, else None.
    """

    digital: NDArray[Any]
    camera: Camera
    light: Photons
    first: Frame
    stages: tuple[Any, ...]
    photons: NDArray[np.float64] | None = None
    photoelectrons: NDArray[np.float64] | None = None
    dark_electrons: NDArray[np.float64] | None = None
    electrons: NDArray[np.float64] | None = None
    volts: NDArray[np.float64] | None = None

    @cached_property
    def report(self) -> dict[str, Any]:
        """The first frame's account, ready for JSON: what every stage must do on average, and what it did."""
        return stage_report(self.light, self.camera, self.first, self.stages)

    def minus(self, reference: Frames) -> NDArray[np.int64]:
        """Signed difference to a zero-exposure frame or a stack of as many, (N, H, W) [DN]: the paper's CDS.

        Fixed patterns cancel, temporal variances add (√2 in σ for equal frames), and nothing wraps below zero.
        Raises InputError when the frames do not fit.
        """
        if not isinstance(reference, Frames):
            raise InputError(f"the reference is a {type(reference).__name__}; pass the Frames of a zero exposure.")
        one, other = self.digital.shape, reference.digital.shape
        if one[1:] != other[1:] or other[0] not in (1, one[0]):
            raise InputError(f"the reference has shape {other}; it must be {one}, or (1, {one[1]}, {one[2]}).")
        return self.digital.astype(np.int64) - reference.digital.astype(np.int64)

    def noise_budget_of(self) -> NoiseBudget:
        """What every source put into each pixel of the first frame, in DN; the parts add up to the frame."""
        return noise_budget_of(self.light, self.first, self.stages)


def expose(
    photons: Photons | ArrayLike,
    camera: Camera,
    exposure: Exposure,
    *,
    seed: int = 1,
    serial: int = 1,
    frames: int = 1,
    first_frame: int = 0,
    keep: Iterable[str] = (),
    wavelengths_nm: ArrayLike | None = None,
    origin: tuple[int, int] | None = None,
    maps: Mapping[str, ArrayLike] | None = None,
    plan: Plan | None = None,
    chain: Literal["physical", "konnik2014"] = "physical",
    engine: Engine = "auto",
    precision: Precision = "auto",
) -> Frames:
    """Raw frames that ``camera`` delivers for these mean photons per pixel.

    photons : what :func:`collect` returns, or an array: a scalar (the whole sensor), (H, W), or (H, W, B) with
        ``wavelengths_nm`` of length B.
    seed : all noise that changes from frame to frame.  serial : the device, that is all patterns that never change.
    frames, first_frame : how many, and the number of the first; frame 12 is the same made alone or after eleven others.
    keep : any of "photons", "photoelectrons", "dark_electrons", "electrons", "volts".
    maps : measured fixed patterns in place of the serial's own, by the names that :func:`fpn_maps` returns; of this
        window, or of the whole sensor.
    origin : (row, column) of the first pixel on the sensor, by default that of the photons: a crop of a frame is the
        frame of the crop.
    plan : what :func:`plan` left of the chain; the whole chain without one.
    chain : "physical", or "konnik2014" for the published code's behaviour (comparison only; docs/konnik2014.md).
    engine : "numpy", "drjit" (one kernel for LLVM, the same bytes), "cuda" (the same words; how near its bytes are
        is not measured yet), or "auto", which compiles for LLVM where that is quicker.
    precision : "float32", "float64" (NumPy only; the reference), or "auto": what the plan found
        to be enough; without a plan float32, unless the full well or the codes go beyond 2^24, where it stops counting,
        or the gain of the converter beyond 1e30 DN/V.
    Raises InputError for NaN or negative photons, naming how many there are and where the first one is.
    """
    wanted = checked_names(keep, KEEP)
    run = _prepared(
        photons, camera, exposure, seed, serial, frames, first_frame, wavelengths_nm, origin, maps, plan, chain,
        engine, precision,
    )  # fmt: skip
    shape, code_type = run.first.window.shape, np.min_scalar_type(run.stages[-1].highest)
    kept = {name: np.empty((frames, *shape)) for name in wanted} | {"digital": np.empty((frames, *shape), code_type)}
    for _ in run.frames(first_frame, frames, lambda i: {name: x[i - first_frame] for name, x in kept.items()}):
        pass
    backend = NUMPY_FLOAT64 if run.first.window.backend is NUMPY_FLOAT64 else NUMPY_FLOAT32
    return Frames(kept.pop("digital"), camera, run.light, run.first.on(backend), run.stages, **kept)


def stream(
    photons: Photons | ArrayLike,
    camera: Camera,
    exposure: Exposure,
    *,
    seed: int = 1,
    serial: int = 1,
    frames: int = 1,
    first_frame: int = 0,
    wavelengths_nm: ArrayLike | None = None,
    origin: tuple[int, int] | None = None,
    maps: Mapping[str, ArrayLike] | None = None,
    plan: Plan | None = None,
    chain: Literal["physical", "konnik2014"] = "physical",
    engine: Engine = "auto",
    precision: Precision = "auto",
) -> Iterator[NDArray[Any]]:
    """The frames of :func:`expose` one at a time, each (H, W) [DN]: for more of them than memory holds.

    Everything is checked at once; light and maps are made with the first frame that is asked for.
    """
    run = _prepared(
        photons, camera, exposure, seed, serial, frames, first_frame, wavelengths_nm, origin, maps, plan, chain,
        engine, precision,
    )  # fmt: skip
    shape, code_type = run.first.window.shape, np.min_scalar_type(run.stages[-1].highest)
    done = run.frames(first_frame, frames, lambda _: {"digital": np.empty(shape, code_type)})
    return (sinks.pop("digital") for sinks in done)  # popped: nobody here holds a frame that was delivered


def _prepared(
    photons: Any, camera: Camera, exposure: Exposure, seed: int, serial: int, frames: int, first_frame: int,
    wavelengths_nm: Any, origin: Any, maps: Any, plan: Plan | None, chain: str, engine: str, precision: str,
) -> Run:  # fmt: skip
    """All that was asked for, checked, and ready to run."""
    check_types(camera, exposure)
    light = as_photons(photons, camera, wavelengths_nm)
    check_numbers(frames, first_frame, seed)
    stages = _stages(camera, plan, chain)
    check_compensation(light, stages, frames)
    shape = light.mean.shape[0], light.mean.shape[1]
    window = SensorWindow(serial, shape, checked_origin(light.origin if origin is None else origin))
    backend = choose_backend(engine, _precision(precision, camera, plan, chain), frames * shape[0] * shape[1])
    window = replace(window, given=checked_maps({} if maps is None else maps, stages, window, camera), backend=backend)
    return Run(stages, light, Frame(exposure, window, seed, first_frame))


def _precision(asked: str, camera: Camera, plan: Plan | None, chain: str) -> str:
    if asked not in PRECISIONS:
        raise InputError(f"precision is {asked!r}; it must be one of {', '.join(PRECISIONS)}.")
    if chain == "konnik2014":  # a comparison, in the precision of the published code
        if asked == "float32":
            raise InputError("precision is 'float32' and chain konnik2014 is float64 only; leave the precision out.")
        return "float64"
    gain = adc_gain_dn_per_v(camera)
    if asked == "float32" and gain > BRIGHTEST:
        raise InputError(
            f"precision is 'float32', which holds numbers up to {BRIGHTEST:g}, and the converter of {camera.name} "
            f"makes {gain:.3g} DN of a volt; leave the precision out, or mend the gains and adc.full_scale_v."
        )
    if asked != "auto":
        return asked
    if plan is not None:
        return plan.precision
    countable = camera.pixel.full_well_e <= COUNTABLE and 2**camera.adc.bits <= COUNTABLE
    return "float32" if countable and gain <= BRIGHTEST else "float64"


def _stages(camera: Camera, plan: Plan | None, chain: str) -> tuple[Any, ...]:
    """What the plan left of this camera's chain, or the whole chain of that name."""
    if plan is None:
        if chain == "konnik2014":
            return chain_of(Konnik2014Settings.from_camera(camera))
        if chain != "physical":
            raise InputError(f"chain is {chain!r}; it must be 'physical', or 'konnik2014' for the published code.")
        return physical_chain(camera)
    if not hasattr(plan, "whole"):
        raise InputError(f"plan is {plan!r}; pass what plan(camera, exposure, photons) returns.")
    if chain != "physical":
        raise InputError(f"chain is {chain!r} and a plan is given; a plan is for the physical chain: pass one of them.")
    if plan.whole != physical_chain(camera):
        raise InputError(
            f"plan was made for another camera, {plan.camera}; make one for this one with plan(camera, …)."
        )
    return plan.stages


def fpn_maps(
    camera: Camera, shape: tuple[int, int] | None = None, *, serial: int = 1, origin: tuple[int, int] = (0, 0),
    precision: Precision = "auto",
) -> dict[str, NDArray[np.float64]]:  # fmt: skip
    """Every fixed pattern of one device, by name: gains (1 on average), dark factors (1), offsets in electrons (0).

    shape : (rows, columns) of the window; the whole sensor by default. What comes out goes into ``expose(maps=…)``.
    precision : of :func:`expose`, so that these are the very maps that it draws.
    """
    check_types(camera, Exposure(0.0))
    size = (camera.sensor.rows, camera.sensor.columns) if shape is None else shape
    if not isinstance(size, tuple | list) or len(size) != 2 or 0 in size:
        raise InputError(f"shape is {size!r}; it must be (rows, columns) of the window, e.g. (480, 640).")
    height, width = require_seed("shape", size[0]), require_seed("shape", size[1])
    backend = choose_backend("numpy", _precision(precision, camera, None, "physical"), 0)
    window = SensorWindow(serial, (height, width), checked_origin(origin), backend=backend)
    found: dict[str, NDArray[np.float64]] = {}
    for stage in physical_chain(camera):
        if hasattr(stage, "maps"):
            found |= {name: np.asarray(x, dtype=np.float64) for name, x in stage.maps(window).items()}
    return found

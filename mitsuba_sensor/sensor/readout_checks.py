"""Checks of an exposure of a camera whose read-outs are combined: what there is of one read-out only."""

from __future__ import annotations

from collections.abc import Mapping

from ..camera.camera import Camera
from ..camera.exposure_times import later_exposures
from ..core import Exposure, InputError, Photons
from ..stages.effects.shot_noise import LEFT
from ..stages.image_lag import BEFORE
from .options import ExposeOptions


def check_options_of_readouts(camera: Camera, options: ExposeOptions) -> None:
    """Raise InputError for what there is of one read-out only, and for stages that no read-out has of its own."""
    names = ", ".join(one.name for one in camera.readouts)
    alone = f"camera.at_readout({camera.readouts[0].name!r})"
    of = f"{camera.name} combines the read-outs {names}"
    kept = [name for name in options["keep"] if name != "photons"]
    if kept:
        raise InputError(
            f"keep names {kept[0]!r}, and {of}, each of which has its own; expose one of them, {alone}."
        )
    if options["maps"]:
        raise InputError(
            f"maps are of one read-out, and {of}; leave them out, or expose {alone}."
        )
    check_added_stages(camera)


def check_added_stages(camera: Camera) -> None:
    """Raise InputError for an added stage in front of the read-out, whose charge the read-outs would not share."""
    for stage in camera.added:
        if stage.domain in ("photons", "electrons"):
            raise InputError(
                f"{camera.name} has several read-outs and an added {type(stage).__name__}, which changes the charge "
                "that they share; add stages of volts, or take the stage out."
            )


def check_light_of_readouts(given: Mapping[str, Photons], camera: Camera) -> None:
    """Raise InputError for light that no part of the pixels of this camera would collect, and where light is missing
    that later exposures collect."""
    if not isinstance(given, Mapping) or not all(
        isinstance(x, Photons) for x in given.values()
    ):
        raise InputError(
            "photons.by_readout holds something else than Photons by name; give {name: ms.Photons(mean)}."
        )
    parts = [readout.name for readout in camera.readouts[1:] if readout.of != "charge"]
    known = f"{camera.name} has light of its own for " + ", ".join(map(repr, parts))
    needed = [*later_exposures(camera, Exposure(1.0))]
    if camera.sensor.dual_pixel:
        parts, needed = [LEFT], [LEFT]
        known = f"of dual pixels it has the light of the left photodiodes alone, {LEFT!r}"
    elif camera.quantum_efficiency.image_lag:
        parts = [BEFORE]
        known = f"of a camera with image lag it has the light of the frame before, {BEFORE!r}"
    elif not parts:
        known = f"{camera.name} has one exposure of one photodiode; pass photons.changed(by_readout=None)"
    unknown = [name for name in given if name not in parts]
    if unknown:
        raise InputError(f"photons.by_readout names {unknown[0]!r}; {known}.")
    missing = [name for name in needed if name not in given]
    if missing:
        raise InputError(
            f"photons.by_readout lacks {missing[0]!r}; give the light of all of {', '.join(map(repr, needed))}, or "
            "photons.changed(by_readout=None) where it is the same in all exposures."
        )

"""Checks of an exposure of a camera whose read-outs are combined: what there is of one read-out only."""

from __future__ import annotations

from ..camera.camera import Camera
from ..core import InputError
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
    if options["chain"] != "physical":
        raise InputError(
            f"chain is {options['chain']!r}, which has one read-out, and {of}; take the physical chain, or {alone}."
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


def check_chain_of_dual_pixels(camera: Camera, chain: str) -> None:
    """Raise InputError for dual pixels in another chain than the physical one."""
    if camera.sensor.dual_pixel and chain != "physical":
        raise InputError(
            f"chain is {chain!r}, whose pixels have one photodiode, and {camera.name} has dual pixels; leave the chain "
            "out, or set sensor.dual_pixel to false."
        )

"""Which chain, precision and tolerance an exposure has, by its options."""

from __future__ import annotations

from typing import Protocol

from ..camera.camera import Camera
from ..core import Frame, InputError
from ..stages.stage import Chain, without_law
from .checks import check_float32, float32_counts
from .detection import Detected
from .options import ExposeOptions
from .run import INPUT_REFERRED

KEEP = ("photons", "photoelectrons", "dark_electrons", "electrons", "volts", INPUT_REFERRED)
"""Intermediate signals that ``expose(keep=…)`` can return: mean photons of all bands, electrons that light and dark
current left in the well, their sum [e-], swing at the converter [V], that swing as electrons at the input."""

KEPT_BY_PUBLISHED = ("photons", "electrons", "volts")
"""Those of them that chain konnik2014 has."""


class PlannedChain(Protocol):
    """What a plan leaves of a camera's chain; plans are made in theory/plan.py."""

    @property
    def camera(self) -> str:
        """Name of the camera."""

    @property
    def stages(self) -> Chain:
        """The stages that are left."""

    @property
    def whole(self) -> Chain:
        """All stages of the camera."""

    @property
    def precision(self) -> str:
        """float32, or float64 where that would move too much."""

    def check(self, light: Detected, frame: Frame) -> None:
        """Raise InputError for light, an exposure or a window that the plan was not made for."""


def tolerance_of(chosen: ExposeOptions) -> float | None:
    """The tolerance of a plan that is made for the light at hand."""
    tolerance_dn = chosen["tolerance_dn"]
    if tolerance_dn is not None and chosen["plan"] is not None:
        raise InputError(
            f"tolerance_dn is {tolerance_dn:g} and a plan is given, which has a tolerance of its own; pass one of them."
        )
    if tolerance_dn is not None and chosen["chain"] != "physical":
        raise InputError(
            f"tolerance_dn is {tolerance_dn:g}, which is for the physical chain; leave one of both out."
        )
    return tolerance_dn


def precision_of(asked: str, camera: Camera, plan: PlannedChain | None, chain: str) -> str:
    """ "float32" or "float64": as asked, else as the plan found, else float32 while it can count single electrons."""
    if chain == "konnik2014":  # a comparison, in the precision of the published code
        if asked == "float32":
            raise InputError(
                "precision is 'float32' and chain konnik2014 is float64 only; leave the precision out."
            )
        return "float64"
    if asked == "float32":
        check_float32(camera)
    if asked != "auto":
        return asked
    if plan is not None:
        return plan.precision
    if float32_counts(camera):
        return "float32"
    return "float64"


def chain_of(camera: Camera, plan: PlannedChain | None, chain: str) -> Chain:
    """What the plan left of this camera's chain, or the whole chain of that name."""
    if plan is None:
        if chain == "konnik2014":
            if camera.added:
                raise InputError(
                    f"chain is 'konnik2014' and {camera.name} has an added {type(camera.added[0]).__name__}, for which "
                    "the published chain has no place; take the camera without it, or the physical chain."
                )
            if camera.sensor.without:
                raise InputError(
                    f"chain is 'konnik2014' and {camera.name} is without {', '.join(camera.sensor.without)}, which the "
                    "published chain always has; take the whole camera, or the physical chain."
                )
            if camera.gain is not None:
                raise InputError(
                    f"chain is 'konnik2014', whose converter ends at the full well, and {camera.name} is at gain "
                    f"{camera.gain!r}; leave the gain out, or take the physical chain."
                )
            _check_published_has(camera)
            from . import konnik2014  # a chain that few ask for

            return konnik2014.chain_of(konnik2014.Konnik2014Settings.from_camera(camera))
        return camera.stages
    if not hasattr(plan, "whole"):
        raise InputError(
            f"plan is {plan!r}; pass what plan(camera, exposure, photons) returns."
        )
    if chain != "physical":
        raise InputError(
            f"chain is {chain!r} and a plan is given; a plan is for the physical chain: pass one of them."
        )
    if plan.whole != camera.stages:
        raise InputError(
            f"plan was made for another camera, {plan.camera}; make one for this one with plan(camera, …)."
        )
    return plan.stages


def _check_published_has(camera: Camera) -> None:
    """Raise InputError for an effect of the camera that chain konnik2014 does not have."""
    stages = camera.stages
    lacking = [stage for stage in stages if stage.paper == "–"]
    ways_out = {
        stage.label: stage.no_noise or f"take camera.without({stage.key()!r})"
        for stage in lacking
    }
    if stages[0].light_reach_px:
        ways_out["crosstalk"] = (
            "unset quantum_efficiency.crosstalk, crosstalk_from, crosstalk_pairs and diffusion_um"
        )
    if camera.quantum_efficiency.image_lag:
        ways_out["image lag"] = "set quantum_efficiency.image_lag to 0"
    for label, way_out in ways_out.items():
        raise InputError(
            f"chain is 'konnik2014', and {camera.name} has {label}, which the published chain lacks; "
            f"{way_out}, or take the physical chain."
        )


def check_clean(chain: str) -> None:
    """Raise InputError for a chain whose clean frame is not known."""
    if chain != "physical":
        raise InputError(
            f"chain is {chain!r}, and the clean frame is of the physical chain; leave one of both out, or average many "
            "frames."
        )


def check_law(stages: Chain, what: str, way_out: str) -> None:
    """Raise InputError for a chain with a stage whose law nobody has written.

    what : is known only with the law of a pixel.
    """
    for stage in without_law(stages):
        missing = "has no moments"
        if stage.reach_px:
            missing = "couples neighbours"
        raise InputError(
            f"{type(stage).__name__} {missing}, so that the law of a pixel is not known, and {what} of that law; "
            f"{way_out}, or {stage.no_noise or 'take the camera without that stage'}."
        )

"""Which chain, precision and tolerance an exposure has, by its options."""

from __future__ import annotations

from typing import Protocol

from ..camera.camera import Camera
from ..core import Frame, InputError
from ..stages.stage import Chain
from .checks import check_float32, float32_counts
from .detection import Detected
from .options import ExposeOptions
from .run import INPUT_REFERRED

KEEP = ("photons", "photoelectrons", "dark_electrons", "electrons", "volts", INPUT_REFERRED)
"""Intermediate signals that ``expose(keep=…)`` can return: mean photons of all bands, electrons that light and dark
current left in the well, their sum [e-], swing at the converter [V], that swing as electrons at the input."""


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
    return tolerance_dn


def precision_of(asked: str, camera: Camera, plan: PlannedChain | None) -> str:
    """ "float32" or "float64": as asked, else as the plan found, else float32 while it can count single electrons."""
    if asked == "float32":
        check_float32(camera)
    if asked != "auto":
        return asked
    if plan is not None:
        return plan.precision
    if float32_counts(camera):
        return "float32"
    return "float64"


def chain_of(camera: Camera, plan: PlannedChain | None) -> Chain:
    """What the plan left of this camera's chain, or the whole chain."""
    if plan is None:
        return camera.stages
    if not hasattr(plan, "whole"):
        raise InputError(
            f"plan is {plan!r}; pass what plan(camera, exposure, photons) returns."
        )
    if plan.whole != camera.stages:
        raise InputError(
            f"plan was made for another camera, {plan.camera}; make one for this one with plan(camera, …)."
        )
    return plan.stages

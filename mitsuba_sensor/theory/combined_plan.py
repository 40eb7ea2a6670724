"""Plans of all cameras: of one read-out, or of several, each with a plan of its own."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

from numpy.typing import ArrayLike

from ..camera.camera import Camera
from ..camera.camera_file import AnyCamera, camera_of
from ..core import Exposure, Frame, InputError, Photons, SensorWindow, check_types, require
from ..sensor.checks import as_photons
from ..sensor.detection import Detected, detect
from ..sensor.map_checks import checked_maps
from ..sensor.readouts import light_of_readout
from ..stages.chain import whole_chain
from ..stages.combined_readouts import ReadoutChain, combined_of
from ..stages.stage import Chain
from ..stages.usual_range import warn_of_temperature
from .plan import Plan, plan_for


@dataclass(frozen=True)
class CombinedPlan:
    """The plans of all read-outs of a camera. ``print(plan.explain())``; ``expose(..., plan=plan)``.

    ::

        plan = ms.plan("scmos_dual_gain", exposure, photons, tolerance_dn=0.5)
        print(plan.left_out, plan.readouts["low"].left_out)

    tolerance_dn : in the linear code, however it is combined.  readouts : the plan of each by its name.
    """

    camera: str
    tolerance_dn: float
    readouts: Mapping[str, Plan]
    stages: Chain = field(repr=False)
    whole: Chain = field(repr=False)

    def __repr__(self) -> str:
        count = sum(len(plan.effects) for plan in self.readouts.values())
        left_out = f"{len(self.left_out)} of {count} stages left out"
        return f"<CombinedPlan: {self.camera}, {left_out} within {self.tolerance_dn:g} DN>"

    @property
    def left_out(self) -> list[str]:
        """Read-out and label of the stages that are left out."""
        found = list[str]()
        for name, plan in self.readouts.items():
            found += [f"{name}: {label}" for label in plan.left_out]
        return found

    @property
    def precision(self) -> str:
        """float64 where float32 would move the code of a read-out too much."""
        if any(plan.precision == "float64" for plan in self.readouts.values()):
            return "float64"
        return "float32"

    @property
    def seconds(self) -> tuple[float, float]:
        """Measured seconds per frame of all read-outs, whole chains and plans."""
        times = [plan.seconds for plan in self.readouts.values()]
        return sum(whole for whole, _ in times), sum(planned for _, planned in times)

    def check(self, light: Detected, frame: Frame) -> None:
        """Raise InputError for an exposure, a window or light that this plan was not made for."""
        combined = combined_of(self.whole)
        assert combined is not None
        for readout in combined.readouts:
            own = light_of_readout(readout, light, frame)
            self.readouts[readout.name].check(own, readout.frame_of(frame))

    def explain(self) -> str:
        """A table for people, read-out by read-out."""
        parts = [
            f"Plans for the read-outs of {self.camera}, whose linear code changes by at most {self.tolerance_dn:g} DN:"
        ]
        for name, plan in self.readouts.items():
            parts.append(f"read-out {name}\n{plan.explain()}")
        return "\n\n".join(parts)

    def to_dict(self) -> dict[str, object]:
        """The same for programs."""
        plans = {name: plan.to_dict() for name, plan in self.readouts.items()}
        stages, float32 = list[dict[str, object]](), dict[str, object]()
        for name, plan in plans.items():
            stages += [{"readout": name, **stage} for stage in plan["stages"]]
            float32[name] = plan["float32"]
        return {
            "camera": self.camera,
            "tolerance_dn": self.tolerance_dn,
            "readouts": plans,
            "stages": stages,
            "float32": float32,
        }


def plan(
    camera: AnyCamera,
    exposure: Exposure,
    photons: Photons | ArrayLike,
    tolerance_dn: float = 0.0,
    wavelengths_nm: ArrayLike | None = None,
    maps: Mapping[str, ArrayLike] | None = None,
) -> Plan | CombinedPlan:
    """Which stages this exposure needs, from the theory of the codes over the range of light of the scene.

    ::

        plan = ms.plan(camera, exposure, photons, tolerance_dn=0.2)
        frames = ms.expose(photons, camera, exposure, plan=plan)

    photons, wavelengths_nm, maps : as for :func:`expose`.
    tolerance_dn : how far the stages left out may together move the mean, the temporal σ, the spatial σ or the mean of
        a row or column (times the root of its length) at any level of light between the darkest and the brightest
        pixel, and more than which they may not be expected to move any pixel of a law with tails [DN]; 0 leaves out
        only what changes nothing at all.
    Of a camera with several read-outs: a plan for each, whose tolerance is that of the linear code.
    Raises InputError for a negative tolerance, and for photons and maps that ``expose`` would refuse.
    """
    camera = camera_of(camera)
    check_types(camera, exposure)
    warn_of_temperature(exposure.temperature_k)
    if camera.readouts and maps:
        raise InputError(
            f"maps are of one read-out, and {camera.name} has {len(camera.readouts)}; leave them out, or plan for "
            "camera.at_readout(name)."
        )
    require("tolerance_dn", tolerance_dn, 0.0, 1e9, "digital numbers, e.g. 0.02")
    light = as_photons(photons, camera, wavelengths_nm)
    window = SensorWindow(1, (light.shape[0], light.shape[1]), light.origin)
    frame = Frame(
        exposure,
        replace(
            window,
            given=checked_maps(
                {} if maps is None else maps, whole_chain(camera), window, camera
            ),
        ),
    )
    return plan_of(
        camera,
        detect(replace(light, variance_e2=None), camera.stages[0], frame),
        frame,
        tolerance_dn,
    )


def plan_of(
    camera: Camera, light: Detected, frame: Frame, tolerance_dn: float = 0.0
) -> Plan | CombinedPlan:
    """The plan of a window in light that is detected already; of several read-outs that of each."""
    combined = combined_of(camera.stages)
    if combined is None:
        return plan_for(camera, light, frame, tolerance_dn)
    plans, chains = dict[str, Plan](), list[ReadoutChain]()
    for readout, linear in zip(combined.readouts, combined.combination.readouts, strict=True):
        step_dn = combined.nominal_gain * linear.electrons_per_dn  # of the linear code
        own = camera.readout_cameras[readout.name]
        light_of = light_of_readout(readout, light, frame)
        found = plan_for(own, light_of, readout.frame_of(frame), tolerance_dn / step_dn)
        plans[readout.name] = found
        chains.append(replace(readout, stages=found.stages))
    planned = replace(combined, readouts=tuple(chains))
    stages = (*camera.stages[:-1], planned)
    return CombinedPlan(camera.name, tolerance_dn, plans, stages, camera.stages)

"""A simple chain of the same stages in NumPy (float64, whole arrays, one thread), and a check of its results.

    python benchmarks/plain_chain.py [--mpx 0.25] [--electrons 1000] [--frames 16] [--json]

The command compares means and noise with those of ``ms.expose``, for bands of columns along a ramp.
"""

from __future__ import annotations

import argparse
import json
import math
from itertools import islice
from typing import Any

import numpy as np
from cases import EXPOSURE, full_chain, photon_map, reference_qe, shape_of, shot_read_quantise
from numpy.typing import NDArray
from timing import lines

import mitsuba_sensor as ms
from mitsuba_sensor.core.frame import Frame
from mitsuba_sensor.core.sensor_window import SensorWindow

STAGES = {
    *(
        "quantum_efficiency",
        "prnu",
        "dark_current",
        "shot_noise",
        "full_well",
        "sense_node",
        "nonlinear_sense_node",
    ),
    *(
        "reset_noise",
        "source_follower_noise",
        "source_follower",
        "nonlinear_source_follower",
        "dsnu_column",
    ),
    *("cds_gain", "integral_nonlinearity", "adc"),
}
"""The stages of the simple chain."""

IDLE = {"dsnu_row": "sigma_e", "dsnu_pixel": "sigma_e", "prnu_column": "cv"}
"""Stages that it does not have; this field of them must be 0."""


def stages_of(camera: ms.Camera) -> dict[str, Any]:
    """Return the stages of a camera by name. Raises ValueError if the simple chain lacks one of them."""
    stages = {stage.key(): stage for stage in camera.stages}
    for name, stage in stages.items():
        if name not in STAGES and (name not in IDLE or getattr(stage, IDLE[name])):
            raise ValueError(
                f"{camera.name} has a stage {name}, which the simple chain does not have."
            )
    return stages


class PlainChain:
    """An endless iterator of frames (H, W) uint16 with the parameters of a camera; FPN maps are computed once.

    Monochrome, with normal PRNU, log-normal dark-current FPN and independent columns.
    """

    def __init__(
        self,
        photons: NDArray[np.float64],
        camera: ms.Camera,
        exposure: ms.Exposure,
        seed: int = 1,
    ) -> None:
        stages = stages_of(camera)
        self.photons, self.random = photons, np.random.default_rng(seed)
        self.qe = reference_qe(camera)
        self.full_well_e = stages["full_well"].full_well_e
        self._make_fpn_maps(stages["prnu"], stages["dark_current"], stages["dsnu_column"])
        frame = Frame(exposure, SensorWindow(0, (1, 1)), seed)
        self.dark_e = stages["dark_current"].mean_e(frame)
        self.reset_v = stages["reset_noise"].sigma_v(exposure)
        self.follower_v = stages["source_follower_noise"].sigma_v
        self._curves(stages)
        adc = stages["adc"]
        self.dn_per_v, self.black_level_dn, self.highest_dn = (
            adc.gain_dn_per_v,
            adc.black_level_dn,
            adc.highest,
        )

    def _make_fpn_maps(self, prnu: Any, dark: Any, columns: Any) -> None:
        """Set gain and dark current of every pixel and offset of every column, by the names of ``ms.fpn_maps``."""
        shape, normal = self.photons.shape, self.random.standard_normal
        log_variance = math.log1p(dark.distribution.cv**2)
        self.maps = {
            "prnu": np.maximum(1 + prnu.distribution.cv * normal(shape), 0.0),
            "dark_fpn": np.exp(math.sqrt(log_variance) * normal(shape) - log_variance / 2),
            "dsnu_col_e": columns.sigma_e * normal((1, shape[1])),
        }
        self.has_prnu, self.has_columns = prnu.distribution.cv > 0, columns.sigma_e > 0
        self.dsnu_col_v = columns.residual * columns.gain_v_per_e * self.maps["dsnu_col_e"]

    def _curves(self, stages: dict[str, Any]) -> None:
        """Set gains and non-linearities; 0 means linear."""
        node = stages.get("nonlinear_sense_node") or stages["sense_node"]
        self.v_per_e, alpha = node.gain_v_per_e, getattr(node, "alpha", 0.0)
        self.node_swing_v = node.v_ref_v / alpha if alpha else 0.0
        follower = stages.get("nonlinear_source_follower") or stages["source_follower"]
        self.gain = follower.gain
        self.vv_per_v = (
            (follower.ratio - 1) / follower.full_swing_v if hasattr(follower, "ratio") else 0.0
        )
        self.cds_gain = stages["cds_gain"].gain
        inl = stages.get("integral_nonlinearity")
        self.inl_per_v = math.log(inl.gamma) / inl.full_scale_v if inl else 0.0

    def __iter__(self) -> PlainChain:
        return self

    def __next__(self) -> NDArray[np.uint16]:
        """Return one frame."""
        return self._digital(self._swing_v(self._electrons()))

    def _electrons(self) -> NDArray[np.float64]:
        """Return electrons after quantum efficiency, PRNU, dark current, shot noise and full well."""
        photoelectrons = self.photons * self.qe
        if self.has_prnu:
            photoelectrons *= self.maps["prnu"]
        electrons = self.random.poisson(photoelectrons).astype(np.float64)
        if self.dark_e:
            electrons += self.random.poisson(self.dark_e * self.maps["dark_fpn"])
        return np.minimum(electrons, self.full_well_e, out=electrons)

    def _swing_v(self, electrons: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return volts after sense node, reset noise, source follower, column DSNU, CDS gain and INL."""
        swing = self.v_per_e * electrons
        if self.node_swing_v:
            swing = -self.node_swing_v * np.expm1(swing / -self.node_swing_v)
        if self.reset_v:
            swing += self.reset_v * self.random.standard_normal(swing.shape)
        if self.follower_v:
            swing += self.follower_v * self.random.standard_normal(swing.shape)
        swing *= self.gain * (1 + self.vv_per_v * swing) if self.vv_per_v else self.gain
        if self.has_columns:
            swing += self.dsnu_col_v
        swing *= self.cds_gain
        if self.inl_per_v:
            swing *= np.exp(-self.inl_per_v * swing)
        return swing

    def _digital(self, swing_v: NDArray[np.float64]) -> NDArray[np.uint16]:
        """Return the codes of the ADC."""
        code = np.floor(self.black_level_dn + self.dn_per_v * swing_v + 0.5)
        return np.clip(code, 0, self.highest_dn).astype(np.uint16)


LIMIT = 5.0
"""Standard errors; exceeded by chance once in 1.7 million comparisons."""

BANDS = 8
"""Bands of columns, each compared separately: with a ramp these are different signal levels."""


def agreement(one: NDArray[Any], other: NDArray[Any]) -> dict[str, float | bool]:
    """Compare two stacks (N, H, W) [DN] of independent noise and equal fixed patterns.

    mean_z, variance_z : largest difference of a band, in standard errors of the difference.
    """
    bands = [
        _distance(*pair)
        for pair in zip(*(np.array_split(x, BANDS, axis=2) for x in (one, other)), strict=True)
    ]
    mean_z, variance_z = (max(values) for values in zip(*bands, strict=True))
    return {
        "mean_z": mean_z,
        "variance_z": variance_z,
        "agrees": mean_z < LIMIT and variance_z < LIMIT,
    }


def _distance(one: NDArray[Any], other: NDArray[Any]) -> tuple[float, float]:
    """Return the differences of means and of temporal variances of one band, in standard errors."""
    frames, pixels = len(one), one[0].size
    variances = [x.var(axis=0, ddof=1) for x in (one, other)]
    mean_error = np.sqrt(sum(v.mean() for v in variances) / (frames * pixels))
    variance_error = np.sqrt(sum(v.var() for v in variances) / pixels)
    return (
        _standard_errors(one.mean() - other.mean(), mean_error),
        _standard_errors(variances[0].mean() - variances[1].mean(), variance_error),
    )


def _standard_errors(difference: float, error: float) -> float:
    """Return a difference in standard errors; 0 for equal constants, as in a saturated band."""
    return (
        float(abs(difference) / error) if error else (0.0 if difference == 0 else float("inf"))
    )


def compare(
    camera: ms.Camera, electrons: float, mpx: float, frames: int
) -> dict[str, float | bool]:
    """Compare the simple chain with ``ms.expose`` for the same FPN maps and a ramp from 0 to twice ``electrons``."""
    photons = photon_map(camera, electrons, "ramp", shape_of(mpx))
    plain = PlainChain(photons, camera, EXPOSURE, seed=2)
    ours = ms.expose(photons, camera, EXPOSURE, frames=frames, maps=plain.maps)
    return agreement(np.stack([*islice(plain, frames)]), ours.digital)


def main() -> None:
    """Parse the options, compare both cameras, print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument(
        "--mpx", type=float, default=0.25, help="million pixels of a frame (default 0.25)"
    )
    parser.add_argument(
        "--electrons", type=float, default=1000, help="mean photoelectrons (default 1000)"
    )
    parser.add_argument(
        "--frames", type=int, default=16, help="frames of each stack, 2 or more (default 16)"
    )
    parser.add_argument("--json", action="store_true", help="print JSON only")
    options = parser.parse_args()
    cameras = {"full_chain": full_chain(), "shot_read_quantise": shot_read_quantise()}
    results = {
        name: compare(camera, options.electrons, options.mpx, options.frames)
        for name, camera in cameras.items()
    }
    print(json.dumps(results) if options.json else "\n".join(lines(results)))


if __name__ == "__main__":
    main()

"""Add your own noise source to an included camera: the glow of an amplifier in the corner.

    python examples/own_noise_source.py -o amp_glow/      # frame.png and frame.tiff: a dark frame with the glow

The package does not know this stage, but it runs on NumPy and as a compiled kernel, and appears in theory, plan, noise
budget and metadata. ``ms.check_stage`` measures its effect everywhere on the sensor.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

import mitsuba_sensor as ms


@dataclass(frozen=True)
class AmpGlow(ms.Stage):
    """Dark electrons of an amplifier next to the first pixel, which fall exponentially with distance.

    rate_e_per_s : in the first pixel [e-/s].  length_px : within which the glow falls by 1/e [pixels].
    """

    rate_e_per_s: float
    length_px: float
    domain = "electrons"

    def glow_e(self, frame: ms.stages.Frame) -> ms.stages.Array:
        """Return the mean electrons of the glow in every pixel of the frame, shape (H, W), for any sensor window."""
        rows, columns = np.ix_(frame.window.rows, frame.window.columns)
        corner_e = self.rate_e_per_s * frame.exposure.time_s
        return corner_e * np.exp(-np.hypot(rows, columns) / self.length_px)

    def sample(
        self, electrons: ms.stages.Electrons, frame: ms.stages.Frame
    ) -> ms.stages.Electrons:
        """Add the glow; the stage that counts all electrons draws its shot noise."""
        glow_e = frame.window.backend.from_numpy(self.glow_e(frame), frame.window)
        return replace(electrons, dark=electrons.dark + glow_e)


def main() -> None:
    """Check the stage, take a dark frame with it, and print the theory of the frame."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "-o", "--out", type=Path, default=Path("amp_glow"), help="folder of the frame"
    )
    out = parser.parse_args().out
    camera, glow = (
        ms.load_camera("konnik_table1"),
        AmpGlow(rate_e_per_s=100_000.0, length_px=80.0),
    )
    print(ms.check_stage(glow, camera=camera, after="dark_current").explain())

    glowing = camera.with_stage(glow, after="dark_current")
    exposure, darkness = ms.Exposure(time_s=0.1), np.zeros((256, 256))
    print(ms.plan(glowing, exposure, darkness, tolerance_dn=0.1).explain())
    frames = ms.expose(darkness, glowing, exposure)
    last = frames.report["stages"][-1]
    print(
        f"mean: {last['mean_frame']:.2f} DN in the frame, {last['mean_expected']:.2f} DN in theory"
    )
    print(
        f"σ: {last['sigma_frame']:.2f} DN in the frame, {last['sigma_expected']:.2f} DN in theory"
    )
    print(frames.noise_budget().explain())
    frames.save(out)
    print(out / "frame.png")


if __name__ == "__main__":
    main()

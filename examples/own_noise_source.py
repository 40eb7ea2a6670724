"""A noise source of your own: temporal row banding with a given spectrum, put into the chain of a shipped camera.

    python examples/own_noise_source.py -o banding/       # frame.png: a dark frame, left as shipped, right with banding

Nothing in the package knows of it, and yet it has its own random stream, runs on NumPy and as a compiled kernel, and
appears in theory, plan, noise budget and metadata. The tests put it through the same checks as the built-in effects.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import mitsuba_sensor as ms
from mitsuba_sensor.core.frame import Frame
from mitsuba_sensor.core.moments import Moments
from mitsuba_sensor.core.types import Array
from mitsuba_sensor.files.png import write_png


@dataclass(frozen=True)
class Banding(ms.Stage):
    """All pixels of a row share an offset that is new in each frame and varies from row to row with this spectrum.

    sigma_e : σ as electrons at the sense node [e- rms].  gain_v_per_e : volts of one electron at this place [V/e-].
    spectrum : power at evenly spaced frequencies from 0 to ½ cycle per row, in any unit.
    """

    sigma_e: float
    gain_v_per_e: float
    spectrum: tuple[float, ...]
    domain = "volts"

    @cached_property
    def kernel(self) -> NDArray[np.float64]:
        """The filter with this spectrum, Σ h² = 1."""
        h = np.fft.fftshift(np.fft.irfft(np.sqrt(self.spectrum)))
        return np.asarray(h / np.sqrt(np.sum(h**2)))

    def sample(self, swing: Array, frame: Frame) -> Array:
        """Swing [V] with the banding of this frame."""
        if self.sigma_e == 0:
            return swing
        rows = np.arange(frame.window.rows[0], frame.window.rows[-1] + len(self.kernel))
        offsets = np.convolve(frame.row_normal("banding", rows), self.kernel, "valid")[:, None]
        volts = self.sigma_e * self.gain_v_per_e
        return swing + frame.number(volts) * frame.window.backend.from_numpy(offsets, frame.window)

    def moments(self, m: Moments) -> Moments:
        """Adds σ² to the temporal variance of every pixel."""
        return m.add(temporal=(self.sigma_e * self.gain_v_per_e) ** 2)


def camera_with_banding(sigma_e: float = 20.0) -> ms.Camera:
    """konnik_table1 with banding of a period of about 16 rows behind its reset noise."""
    frequency = np.linspace(0, 0.5, 65)
    peak = np.exp(-0.5 * ((frequency - 1 / 16) / 0.01) ** 2)
    camera = ms.load_camera("konnik_table1")
    return camera.with_stage(Banding(sigma_e, 5e-6, tuple(peak)), after="reset_noise")


def main() -> None:
    """Expose both cameras to darkness and write the picture and the numbers."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("-o", "--out", type=Path, default=Path("banding"), help="folder of the picture")
    out = parser.parse_args().out
    exposure, dark = ms.Exposure(time_s=0.001), np.zeros((256, 256))
    with_banding = ms.expose(dark, camera_with_banding(), exposure, engine="numpy")
    without = ms.expose(dark, ms.load_camera("konnik_table1"), exposure)
    print(with_banding.noise_budget().explain())
    print(ms.plan(camera_with_banding(), exposure, dark).explain())
    both = np.hstack([without.digital[0], with_banding.digital[0]]).astype(float)
    out.mkdir(parents=True, exist_ok=True)
    write_png(out / "frame.png", np.uint8(np.clip(128 + 10 * (both - np.median(both)), 0, 255)))
    print(out / "frame.png")


if __name__ == "__main__":
    main()

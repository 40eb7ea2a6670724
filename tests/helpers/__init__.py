"""Where the tests find the repository, its scenes and the recorded data, and the cameras that the package ships."""

from __future__ import annotations

from pathlib import Path

import mitsuba_sensor

ROOT = Path(__file__).resolve().parents[2]
DATA = ROOT / "tests" / "data"
BENCHMARKS = ROOT / "benchmarks"
CAMERAS = Path(mitsuba_sensor.__file__).parent / "sensor" / "cameras"

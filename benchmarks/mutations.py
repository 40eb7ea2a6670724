"""Break the package in 40 places, individually, and count the breaks that no quick test notices.

    python benchmarks/mutations.py [--only TEXT] [--json]

Each row of the table is a wrong factor, sign, axis, order or flush in a temporary copy of the package, and the quick
tests that must fail with it: 2 to 10 s each, five minutes together. The exit code is the number of rows whose tests
pass, or whose text does not stand exactly once in the package.
"""

from __future__ import annotations

import argparse
import importlib.util
import json
import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).resolve().parent.parent
FAILED = 1
"""pytest's exit code where tests ran and failed; 2 to 5 are its own errors, or no test."""


class Mutation(NamedTuple):
    """A change of the package.  where : folder or file that contains ``right`` once.  tests : a path, and words of -k."""

    where: str
    right: str
    wrong: str
    tests: str


EFFECTS, OPTICS, SENSOR = "tests/sensor/effects", "tests/optics", "tests/sensor"
LAW = f"{EFFECTS}/test_laws.py"
MUTATIONS = (
    # core
    Mutation("core", "(k0 + _W0) & _MASK, (k1 + _W1)", "(k0 + _W1) & _MASK, (k1 + _W0)", "tests/core/test_counter_rng.py"),
    Mutation("core", "(bits.astype(np.float64) + 0.5) * 2.0**-32", "bits.astype(np.float64) * 2.0**-32", "tests/core/test_quantiles.py"),
    # stages
    Mutation("stages", "arrays.floor(ideal + 0.5)", "arrays.floor(ideal)", f"{EFFECTS}/test_adc.py"),
    Mutation("stages", "k - 0.5 + inl for k", "k + 0.5 + inl for k", f"{EFFECTS}/test_adc.py"),
    Mutation("stages", "(elements + 1) / elements) + 1 / gain)", "(elements + 1) / elements))", f"{EFFECTS}/test_em_gain.py excess"),
    Mutation("stages", "spread = self.excess_noise - 1", "spread = self.excess_noise", f"{LAW} em"),
    Mutation("stages", "BOLTZMANN_J_PER_K * exposure.temperature_k * self.gain_v_per_e /", "2 * BOLTZMANN_J_PER_K * exposure.temperature_k * self.gain_v_per_e /", f"{LAW} reset"),
    Mutation("stages", "self.alpha * self.gain_v_per_e / self.v_ref_v", "self.gain_v_per_e / self.v_ref_v / 2", f"{LAW} curved"),
    Mutation("stages", "(self.ratio - 1) / self.full_swing_v", "self.ratio / self.full_swing_v", f"{LAW} curved"),
    Mutation("stages", "downwards = np.floor(above / 2)", "downwards = np.floor(above / 3)", f"{EFFECTS}/test_blooming.py"),
    Mutation("stages", "return 1 - 4 * self.side - 4 * self.corner", "return 1 - 4 * self.side", f"{EFFECTS}/test_inter_pixel_capacitance.py"),
    Mutation("stages", "self.residual * self.gain_v_per_e) * offsets", "self.gain_v_per_e) * offsets", f"{LAW} dsnu"),
    Mutation("stages", 'window.number(self.cv) * window.line_map("prnu_col"', 'window.number(self.cv**2) * window.line_map("prnu_col"', f"{LAW} column"),
    Mutation("stages", "camera.pixel.pitch_x_um * camera.pixel.pitch_y_um * 1e-8", "camera.pixel.pitch_x_um * camera.pixel.pitch_x_um * 1e-8", f"{EFFECTS}/test_dark_current.py"),
    Mutation("stages", "exposure.time_s * dark_current_model(camera)", "dark_current_model(camera)", f"{EFFECTS}/test_dark_current.py"),
    Mutation("stages", "hits * frame.number(self.mean_e) + spread + 0.5", "hits * frame.number(self.mean_e) - spread + 0.5", f"{EFFECTS}/test_radiation_hits.py moyal"),
    Mutation("stages", "- knee * arrays.log1p(fall)", "+ knee * arrays.log1p(fall)", f"{EFFECTS}/test_full_well.py"),
    Mutation("stages", "1 - (1 - self.duty) * redrawn", "1 - self.duty * redrawn", f"{EFFECTS}/test_rts_pixels.py"),
    Mutation("stages", "integral[2:] - 2 * integral[1:-1] + integral[:-2]", "integral[2:] - integral[1:-1]", f"{EFFECTS}/test_diffusion.py"),
    Mutation("stages", "frame.number(1 - begin) * mean_e", "frame.number(begin) * mean_e", f"{EFFECTS}/test_partial_resets.py"),
    Mutation("stages", "mean_square *= 1 + self.cv**2", "mean_square *= 1 + self.cv", f"{LAW} read"),
    Mutation("stages", "(code - frame.number(self.black_dn))\n", "(code + frame.number(self.black_dn))\n", f"{SENSOR}/test_readouts.py hands_over"),
    # optics
    Mutation("optics", "2 * p1 * x * y + p2 * (square + 2 * x * x)", "2 * p2 * x * y + p1 * (square + 2 * x * x)", f"{OPTICS}/test_f_number_law.py"),
    Mutation("optics", "on_axis = math.pi * numerical_aperture(view, camera) ** 2", "on_axis = math.pi * numerical_aperture(view, camera)", f"{OPTICS}/test_f_number_law.py"),
    Mutation("optics", "(scale * x) ** 2 + (scale * y) ** 2) ** 2)", "(scale * x) ** 2 + (scale * y) ** 2) ** 1.5)", f"{OPTICS}/test_f_number_law.py"),
    Mutation("optics", "(4 * math.pi * (1 - obstruction**2))", "(4 * math.pi * (1 + obstruction**2))", f"{OPTICS}/test_point_spread.py"),
    Mutation("optics", "kept = (1 - scattered) * mean", "kept = mean", f"{OPTICS}/test_veiling_glare.py"),
    Mutation("optics", "1 + self.depth * np.sin(", "1 - self.depth * np.sin(", f"{OPTICS}/test_waveform.py"),
    Mutation("optics", "exit_pupil=-scale * rb / rd", "exit_pupil=scale * rb / rd", f"{OPTICS}/test_paraxial.py"),
    # camera and sensor
    Mutation("camera", "math.sqrt(still_e**2 + shot**2 / 4) + shot / 2", "math.sqrt(still_e**2 + shot**2 / 4)", f"{SENSOR}/test_figures.py"),
    Mutation("sensor", "self.share * metered_saturation_e(camera) / level_e", "metered_saturation_e(camera) / level_e", f"{SENSOR}/test_metering.py"),
    # render
    Mutation("render", "* 1e-12 * camera.pixel.fill_factor", "* 1e-12", "tests/render/test_photons.py"),
    Mutation("render", "self._first + 0.5 * aperture.x", "self._first + aperture.x", "tests/render/test_half_pupil.py"),
    Mutation("render", "squares += (relative * part.electrons) ** 2", "squares += relative * part.electrons", "tests/render/test_light_groups.py"),
    # lab
    Mutation("lab", "100 / float((in_light - in_dark).mean())", "100 / float(in_light.mean())", "tests/lab/test_nonuniformity.py"),
    Mutation("lab", "float(values.std(ddof=1)) / math.sqrt(len(values))", "float(values.std(ddof=1))", "tests/study/test_statistics.py"),
    # files and output
    Mutation("files", "os.replace(temporary, path)\n    flush(path.parent)", "os.replace(temporary, path)", "tests/files/test_whole_files.py flushed"),
    Mutation("files", "flush(temporary)\n    os.replace(temporary, path)", "os.replace(temporary, path)", "tests/files/test_whole_files.py flushed"),
    Mutation("output", "excess_noise(camera) * gain_dn_per_e", "gain_dn_per_e", f"{EFFECTS}/test_em_gain.py divided"),
    # dataset
    Mutation("dataset", "first = 1 + chips * self.names.index(split)", "first = 1 + self.names.index(split)", "tests/dataset/test_splits.py"),
)  # fmt: skip


def place_of(mutation: Mutation, package: Path) -> Path | None:
    """Return the only module that contains the text once, or None."""
    modules = (package / mutation.where).rglob("*.py")
    counts = {path: path.read_text("utf-8").count(mutation.right) for path in modules}
    return next(path for path in counts if counts[path]) if sum(counts.values()) == 1 else None


def noticed(mutation: Mutation, path: Path, copy: Path) -> str:
    """Run the tests of a broken copy; return "" if they fail, as they must."""
    text = path.read_text("utf-8")
    file, *words = mutation.tests.split()
    command = [
        sys.executable,
        "-P",
        "-m",
        "pytest",
        "-q",
        "-x",
        "-n",
        "0",
        "-p",
        "no:cacheprovider",
        file,
    ]
    try:
        path.write_text(text.replace(mutation.right, mutation.wrong), "utf-8")
        Path(importlib.util.cache_from_source(str(path))).unlink(missing_ok=True)
        done = subprocess.run(
            [*command, *(("-k", *words) if words else ())],
            cwd=ROOT,
            env={**os.environ, "PYTHONPATH": str(copy)},
            capture_output=True,
            text=True,
        )
    finally:
        path.write_text(text, "utf-8")
        Path(importlib.util.cache_from_source(str(path))).unlink(missing_ok=True)
    if done.returncode == FAILED:
        return ""
    return "no test fails" if not done.returncode else done.stdout[-300:] + done.stderr[-300:]


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--only", default="", metavar="TEXT", help="rows with this text alone")
    parser.add_argument("--json", action="store_true", help="print the result as JSON")
    asked = parser.parse_args()
    found: dict[str, str] = {}
    with tempfile.TemporaryDirectory() as folder:
        package = Path(folder, "mitsuba_sensor")
        shutil.copytree(ROOT / "mitsuba_sensor", package)
        shutil.copytree(ROOT / "scenes", Path(folder, "scenes"))
        for mutation in MUTATIONS:
            if asked.only in " ".join(mutation):
                path = place_of(mutation, package)
                text = (
                    "the text is not there once"
                    if path is None
                    else noticed(mutation, path, package.parent)
                )
                name = f"{mutation.where}: {mutation.right.strip()}"
                found[name] = text
                if not asked.json:
                    print(f"{'MISSED' if text else 'caught'}  {name}  {text}", flush=True)
    missed = {name: text for name, text in found.items() if text}
    if asked.json:
        print(json.dumps({"mutations": len(found), "missed": missed}))
    else:
        print(f"{len(found) - len(missed)} of {len(found)} are caught")
    return len(missed)


if __name__ == "__main__":
    sys.exit(main())

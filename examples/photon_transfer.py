"""Photon transfer curve of a camera: the theory's lines beside the variances of its frames, from darkness to flooding.

    python examples/photon_transfer.py [PICTURE]

Every level of light is a row; the pixels of a row differ by PRNU and DSNU. Prints a table, draws PICTURE.
"""

from __future__ import annotations

import argparse

import numpy as np

import mitsuba_sensor as ms

LEVELS_E = np.concatenate([np.geomspace(10, 25_000, 28), np.linspace(28_000, 38_000, 26)])
COLUMNS, FRAMES, SERIALS = 512, 4, 24

parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
parser.add_argument("picture", nargs="?", help="PNG file of the picture")
picture = parser.parse_args().picture

camera = ms.load_camera("konnik_table1")
light = ms.Photons(np.tile(LEVELS_E[:, None] / 0.6, COLUMNS))  # its QE is 0.6
exposure = ms.Exposure(0.1)
stacks = []
theory = []  # mean, temporal and spatial variance of the digital numbers at each level
for electrons in LEVELS_E:
    flat = ms.expose(ms.Photons(np.full((1, 1), electrons), detected=True), camera, exposure)
    theory.append(flat.theory.averages(flat.stages[-1])[:3])
theory_mean, theory_temporal, theory_spatial = np.transpose(theory)
for serial in range(SERIALS):
    frames = ms.expose(light, camera, exposure, frames=FRAMES, seed=serial, serial=serial)
    stacks.append(frames.digital.astype(np.float64))
dn = np.stack(stacks)  # (serials, frames, levels, columns)
measured_mean, temporal = dn.mean(axis=(0, 1, 3)), dn.var(axis=1, ddof=1).mean(axis=(0, 2))
spatial = np.maximum(dn.mean(axis=1).var(axis=2, ddof=1).mean(axis=0) - temporal / FRAMES, 0)

print(
    "electrons   mean DN: theory, frames   temporal σ: theory, frames   spatial σ: theory, frames"
)
for k, electrons in enumerate(LEVELS_E):
    pairs = (
        (theory_mean[k], measured_mean[k]),
        (theory_temporal[k], temporal[k]),
        (theory_spatial[k], spatial[k]),
    )
    mean, *sigmas = (
        f"{one**power:15.3f} {other**power:9.3f}"
        for (one, other), power in zip(pairs, (1, 0.5, 0.5), strict=True)
    )
    print(f"{electrons:9.0f} {mean} {sigmas[0]} {sigmas[1]}")

if picture:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9.5, 4.2), layout="constrained")
    for axes, scale in zip(figure.subplots(1, 2), ("log", "linear"), strict=True):
        for color, name, line, dots in (
            ("C0", "temporal", theory_temporal, temporal),
            ("C1", "spatial", theory_spatial, spatial),
        ):
            axes.plot(LEVELS_E, line**0.5, color=color, label=f"{name} σ, theory")
            axes.plot(LEVELS_E, dots**0.5, "o", color=color, ms=4, label=f"{name} σ, frames")
        axes.set(
            xscale=scale, yscale=scale, xlabel="mean photoelectrons per pixel", ylabel="σ [DN]"
        )
        axes.axvline(camera.pixel.full_well_e, color="0.6", lw=1, ls=":", label="full well")
    figure.axes[0].set(ylim=(1, 30))
    figure.axes[1].set(xlim=(27_500, 38_000), ylim=(0, 26))
    figure.axes[0].legend(frameon=False, fontsize=8)
    figure.savefig(picture, dpi=110)

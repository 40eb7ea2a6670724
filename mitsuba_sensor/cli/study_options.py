"""Flags of the studies."""

# Without `from __future__ import annotations`: core/options.py reads these declarations at run time.
from pathlib import Path
from typing import Annotated, TypedDict

import typer

from ..core.errors import require_seed
from ..core.options import Option
from ..render.passes import MOST_IN_ALL

StudyOut = Annotated[Path, typer.Option("-o", "--out", metavar="DIR", help="Folder for the page; made if need be.")]
Force = Annotated[bool, typer.Option("--force", help="Measure again what the folder holds already.")]


class WorkPrecisionFlags(TypedDict, total=False):
    """Flags of ``study work-precision``."""

    tolerance: Annotated[
        float, Option("Relative error of a pixel's irradiance for which a setting is recommended.", 0.01)
    ]
    seeds: Annotated[
        int, Option("Independent runs of each setting; their spread makes the intervals.", 4, low=2, example="4")
    ]
    sides: Annotated[
        list[str] | None,
        Option("render or sensor: only this half. Repeatable. Default: both.", flag="--side", text=list[str]),
    ]
    variants: Annotated[
        list[str] | None,
        Option(
            "A Mitsuba variant to compare. Repeatable. Default: every one that works.", flag="--variant", text=list[str]
        ),
    ]


class AblationFlags(TypedDict, total=False):
    """Flags of ``study ablation``."""

    tolerance_dn: Annotated[float, Option("Of the plan that is put to the test, in DN.", 0.02)]
    frames: Annotated[int, Option("Frames of each of the 64 cameras that are measured.", 24, low=2, example="24")]
    spp: Annotated[int, Option("Samples per pixel of every render.", 32, low=1, high=MOST_IN_ALL, example="32")]
    seed: Annotated[
        int | None, Option("Seed of the first frame. Default: the scene file's, else 1.", check=require_seed)
    ]
    serial: Annotated[
        int | None, Option("Serial number of the first camera. Default: the scene file's, else 1.", check=require_seed)
    ]

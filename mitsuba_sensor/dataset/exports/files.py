"""The files of each sample in SCENE/NUMBER-KEY, and the files of its light in SCENE/light-TASK: `dataset unpack`."""

from __future__ import annotations

from .export import Job

HOW = """import json
from pathlib import Path

for path in Path("DIR").glob("*/*/sample.json"):  # the folder of this file
    print(path.parent, json.loads(path.read_text("utf-8"))["values"])
"""


def write(job: Job) -> str:
    """Write the unchanged files. Returns code that reads them."""
    for number, sample in enumerate(job.samples):
        scene = sample.facts["view"]["scene"]
        for name, content in sample.files.items():
            job.bytes(f"{scene}/{number:06d}-{sample.key[:8]}/{name}", content)
        for name, content in sample.view_files.items():
            place = f"{scene}/light-{sample.task[:8]}/{name}"
            if not job.place(place).exists():
                job.bytes(place, content)
        job.done()
    return HOW

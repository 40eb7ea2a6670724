"""Runs the studies and writes what they found as a page in Markdown, with a picture and the command of each.

python examples/study_pages.py                        # one small study, into study_pages/
python examples/study_pages.py docs/studies --all     # all studies: docs/studies/README.md

Each study is a command of its own, which is printed. The full pages stay in ``work/`` in the folder.
"""

from __future__ import annotations

import argparse
import json
import shlex
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

from mitsuba_sensor.pages.html_page import text

ROOT = Path(__file__).resolve().parent.parent
SCENES = ("cornell_box", "color_checker", "still_life", "step_wedge")
TINY = (
    "--width",
    "12",
    "--frames",
    "4",
    "--variant",
    "scalar_spectral",
)  # which compiles nothing
PRECISE = ("cornell_box", "step_wedge")
SMALL = {"work-precision": ("--width", "48"), "ablation": ("--width", "64")}
SHORT = (
    "--camera",
    "bayer_2mp",
    "--exposure-s",
    "0.02",
    *SMALL["ablation"],
)  # its dark current cannot be seen
QUICK = [("ablation-step_wedge", ("ablation", "scenes/step_wedge.xml", *TINY))]
EVERY = [
    ("paper", ()),
    ("stress", ("stress",)),
    *(
        (
            f"work-precision-{name}",
            ("work-precision", f"scenes/{name}.xml", *SMALL["work-precision"]),
        )
        for name in PRECISE
    ),
    *(
        (f"ablation-{name}", ("ablation", f"scenes/{name}.xml", *SMALL["ablation"]))
        for name in SCENES
    ),
    ("ablation-color_checker-bayer_2mp", ("ablation", "scenes/color_checker.xml", *SHORT)),
]


STUDY = ("-m", "mitsuba_sensor", "study")
PAPER = ("reproduction/paper_pages.py",)


def main() -> None:
    """Run the studies, copy their pictures, write README.md."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path, nargs="?", default=Path("study_pages"))
    parser.add_argument("--all", action="store_true", help="every study of every scene")
    given = parser.parse_args()
    given.folder.mkdir(parents=True, exist_ok=True)
    lines = ["# Studies", "", "Made by `python examples/study_pages.py`.", ""]
    for name, arguments in EVERY if given.all else QUICK:
        lines += studied(name, arguments, given.folder)
    (given.folder / "README.md").write_text("\n".join(lines), encoding="utf-8")
    print(given.folder / "README.md")


def studied(name: str, arguments: tuple[str, ...], folder: Path) -> list[str]:
    """One study in Markdown; its picture is copied into the folder, of the paper's every picture."""
    program = STUDY if arguments else PAPER
    command = shlex.join(
        ("mitsuba-sensor", "study", *arguments) if arguments else ("python", *PAPER)
    )
    print(command, flush=True)
    work = (folder / "work" / name).resolve()
    done = subprocess.run(
        [sys.executable, *program, *arguments, "-o", str(work)],
        cwd=ROOT,
        stdout=subprocess.DEVNULL,
    )
    if done.returncode not in (
        0,
        1,
    ):  # 1: something that must hold does not, which the page says
        raise SystemExit(f"{command} ended with {done.returncode}")
    found = json.loads((work / "study.json").read_text(encoding="utf-8"))
    numbered = sorted(
        work.glob("paper-*.png"), key=lambda path: int(path.stem.partition("-")[2])
    )
    pictures = {f"{name}.png": work / f"{arguments[0] if arguments else name}.png"}
    pictures |= {path.name: path for path in numbered}
    for file, picture in pictures.items():
        shutil.copy(picture, folder / file)
    verdict, made = "all holds" if found["passed"] else "**not all holds**", found["machine"]
    return [
        f"## {found['title']}: {verdict}",
        *(
            "",
            f"`{command}` ({found['seconds']:.0f} s on {made['cpus']} processors, {made['processor']})",
        ),
        "",
        *(f"![{file.removesuffix('.png')}]({file})" for file in pictures),
        "",
        *(f"- {finding}" for finding in found["findings"]),
        "",
        *(line for part in found["parts"] if compared(part) for line in in_markdown(part)),
    ]


def compared(part: dict[str, Any]) -> bool:
    """Whether it is a table of what others have published."""
    return part["kind"] == "table" and any(
        "published" in name or name == "why" for name in part["columns"]
    )


def in_markdown(part: dict[str, Any]) -> list[str]:
    """A table of a study, with its title and its note."""
    rows = (
        part["columns"],
        ["---"] * len(part["columns"]),
        *([text(cell) for cell in row] for row in part["rows"]),
    )
    return [
        f"**{part['title']}.** {part['note']}",
        "",
        *(f"| {' | '.join(row)} |" for row in rows),
        "",
    ]


if __name__ == "__main__":
    main()

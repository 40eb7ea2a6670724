"""The pages of the studies, their pictures, and an index with what they found.

python examples/study_pages.py                        # one small study, into study_pages/
python examples/study_pages.py docs/studies --all     # the pages of the README: all studies of four scenes

Each study is a command of its own, which is printed; one that was stopped goes on where it was. The measurements stay
in a folder of their own (``--work``).
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

ROOT = Path(__file__).resolve().parent.parent
SCENES = ("cornell_box", "color_checker", "still_life", "step_wedge")
SHOTS = {  # what each study looks at: small pictures do
    "left-out": ("--columns", "64"),
    "error-time": ("--columns", "48"),
}
DIM = ("--camera", "bayer_2mp", "--exposure-s", "0.02", *SHOTS["left-out"])
"""Where most can be left out: the dark current of so short an exposure cannot be seen."""
QUICK = ("--columns", "12", "--frames", "8")
PICTURED = "cornell_box"
TITLES = {
    "error-time": "Error against run time",
    "extremes": "Stiff and extreme cases",
    "left-out": "What was left out",
}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path, nargs="?", default=Path("study_pages"))
    parser.add_argument("--all", action="store_true", help="every study of every scene")
    parser.add_argument("--work", type=Path, help="where measurements are kept (default: work/ in the folder)")
    words = parser.parse_args()
    words.folder.mkdir(parents=True, exist_ok=True)
    work = words.work or words.folder / "work"
    found = list(everything(work)) if words.all else [studied(work, "left-out", "step_wedge", QUICK)]
    for page in found:
        shutil.copy(page["page"], words.folder / f"{page['name']}.html")
        shutil.copy(page["picture"], words.folder / f"{page['name']}.png")
    (words.folder / "README.md").write_text(index(found), encoding="utf-8")
    print(words.folder / "README.md")


def everything(work: Path) -> Any:
    """Every study of every scene, one after the other."""
    yield studied(work, "extremes", None, ())
    for study, words in SHOTS.items():
        for scene in SCENES:
            yield studied(work, study, scene, words)
    yield studied(work, "left-out", "color_checker", DIM, "left-out-color_checker-bayer_2mp")


def studied(work: Path, study: str, scene: str | None, words: tuple[str, ...], name: str = "") -> dict[str, Any]:
    """One study: its command, and where it left page, picture and numbers."""
    name = name or (study if scene is None else f"{study}-{scene}")
    file = [] if scene is None else [f"scenes/{scene}.xml"]
    command = ["mitsuba-sensor", "study", study, *file, *words]
    print(shlex.join(command), flush=True)
    program = [sys.executable, "-m", "mitsuba_sensor", *command[1:], "-o", str(work.resolve() / name), "--json"]
    done = subprocess.run(program, cwd=ROOT, stdout=subprocess.PIPE, text=True)
    if done.returncode not in (0, 1):  # 1: something that must hold does not, which the page says
        raise SystemExit(f"{shlex.join(command)} ended with {done.returncode}")
    numbers = json.loads(done.stdout)
    folder = work / name
    return {
        "name": name, "study": study, "scene": scene, "command": shlex.join(command), "passed": numbers["passed"],
        "findings": numbers["findings"], "seconds": numbers["seconds"], "machine": numbers["machine"],
        "page": folder / "study.html", "picture": folder / f"{study}.png",
    }  # fmt: skip


def index(found: list[dict[str, Any]]) -> str:
    """The pages with what they found, in Markdown."""
    lines = ["# Studies", "", f"Made by `python examples/study_pages.py` on {machine(found)}.", ""]
    for study, title in TITLES.items():
        pages = [page for page in found if page["study"] == study]
        if not pages:
            continue
        shown = next((page for page in pages if page["scene"] == PICTURED), pages[0])
        lines += [f"## {title}", "", f"![{title}, {shown['scene'] or 'all stages'}]({shown['name']}.png)", ""]
        for page in pages:
            verdict = "all holds" if page["passed"] else "**not all holds**"
            lines += [f"### [{title_of(page)}]({page['name']}.html): {verdict}", ""]
            lines += [f"`{page['command']}` ({page['seconds']:.0f} s)", ""]
            lines += [f"- {finding}" for finding in page["findings"]] + [""]
    return "\n".join(lines)


def title_of(page: dict[str, Any]) -> str:
    """The scene, and what else is not as usual."""
    return page["name"].removeprefix(f"{page['study']}-") if page["scene"] else "every stage and engine"


def machine(found: list[dict[str, Any]]) -> str:
    """What the seconds were measured on."""
    said = found[0]["machine"]
    return f"{said['cpus']} processors, {said['processor']}"


if __name__ == "__main__":
    main()

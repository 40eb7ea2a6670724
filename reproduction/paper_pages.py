"""Tables and figures of section 4 of Konnik & Welsh 2014 for Table 1's camera, beside what is printed.

    python reproduction/paper_pages.py -o DIR          # all pages, about a minute
    python reproduction/paper_pages.py -o DIR --small  # fewer pixels, frames and chips: a few seconds

Radiometric function, photon transfer, SNR, PRNU, spectrograms and non-whiteness, dark signal with fits; linear and with
the paper's curves; closed forms that must hold; a sentence wherever the text cannot be met. Writes study.html,
study.json and a PNG of every figure; the exit code is 1 where a closed form does not hold.
"""

from __future__ import annotations

import argparse
import sys
from functools import partial
from pathlib import Path

from paper import SMALL, measure_paper
from paper.camera import FULL

from mitsuba_sensor.study.kit import run_study


def main(arguments: list[str] | None = None) -> int:
    """Measure, write the pages, print the findings."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("-o", "--out", type=Path, default=Path("study/paper"))
    parser.add_argument("--small", action="store_true", help="fewer pixels, frames and chips")
    given = parser.parse_args(arguments)
    size = SMALL if given.small else FULL
    command = f"python reproduction/paper_pages.py{' --small' if given.small else ''}"
    measure = partial(measure_paper, size=size)
    study = run_study(given.out, measure, {"command": command}, tell, every_picture=True)
    print(
        "\n".join(
            (
                study.title,
                *study.findings,
                f"{study.data['seconds']} s, page: {given.out / 'study.html'}",
            )
        )
    )
    return 0 if study.passed else 1


def tell(now: str, share: float) -> None:
    """Print what is measured next, and how much is done."""
    print(f"{now}: {share:.0%} done", file=sys.stderr)


if __name__ == "__main__":
    sys.exit(main())

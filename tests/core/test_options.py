"""core/options.py: one declaration gives signature, help, check, metadata and flag."""

# Without `from __future__ import annotations`: options are declared here.
from pathlib import Path
from typing import Annotated, Any, Literal, TypedDict

import numpy as np
import pytest
import typer
from typer.testing import CliRunner

import mitsuba_sensor as ms
from mitsuba_sensor.capture_options import CaptureOptions
from mitsuba_sensor.cli.options import flags
from mitsuba_sensor.core.errors import require_seed
from mitsuba_sensor.core.options import Option, complete, declared, used


class Lens(TypedDict, total=False):
    f_number: Annotated[
        float, Option("Focal length over diameter.", 2.8, low=0.5, high=64, example="2.8")
    ]
    blades: Annotated[
        int | None, Option("Blades of the aperture.", low=3, high=20, example="7")
    ]


class Picture(Lens, total=False):
    mode: Annotated[Literal["grey", "colour"], Option("Kind of picture.", "grey")]
    flip: Annotated[bool, Option("Upside down.", False)]
    name: Annotated[str | None, Option("Of the picture.", example="'sunset'")]
    seed: Annotated[int | None, Option("Seed.", check=require_seed)]
    maps: Annotated[Any, Option("Only for Python.", flag=None)]


REFUSED: dict[str, tuple[dict[str, object], str]] = {
    "unknown": ({"f_numbr": 2}, "'f_numbr' is not an option. Did you mean 'f_number'"),
    "too small": ({"f_number": 0.1}, "0.1; it must be a number from 0.5 to 64, e.g. 2.8"),
    "NaN": ({"f_number": float("nan")}, "f_number is nan"),
    "a text for a number": ({"f_number": "wide"}, "f_number is 'wide'; it must be a number"),
    "a fraction for a count": ({"blades": 6.5}, "6.5; it must be a whole number"),
    "True for a number": ({"blades": True}, "blades is True"),
    "no choice": ({"mode": "color"}, "one of grey, colour. Did you mean 'colour'"),
    "None where there is a default": ({"mode": None}, "mode is None"),
    "1 for True": ({"flip": 1}, "flip is 1; it must be True or False"),
    "no text": ({"name": 3}, "name is 3; it must be a text, e.g. 'sunset'"),
    "its own check": ({"seed": -1}, "seed is -1"),
}


@pytest.mark.parametrize(("given", "said"), REFUSED.values(), ids=REFUSED)
def test_a_wrong_option_gives_one_sentence(given: dict[str, object], said: str) -> None:
    with pytest.raises(ms.InputError, match=said):
        complete(Picture, given)


def test_metadata_contain_every_option_as_a_plain_value() -> None:
    given = {"maps": {"prnu": np.ones(3)}, "name": "x", "flip": True}
    found = used(Picture, given)
    assert list(found) == [one.name for one in declared(Picture)]
    assert (
        found["maps"] == ["prnu"]
        and found["name"] == "x"
        and found["flip"] is True
        and found["f_number"] == 2.8
    )
    assert used(Picture, {"maps": Path("a") / "b"})["maps"] == str(Path("a") / "b")


def test_a_command_has_a_flag_for_every_option() -> None:
    app, seen = typer.Typer(), {}

    @app.command()
    @flags(Picture)
    def take(scene: str, **options: Any) -> None:
        seen.update(options, scene=scene)

    done = CliRunner().invoke(app, ["x", "--f-number", "4", "--mode", "colour", "--flip"])
    assert done.exit_code == 0, done.output
    assert seen == {
        "scene": "x", "f_number": 4.0, "blades": None, "mode": "colour", "flip": True, "name": None, "seed": None,
    }  # fmt: skip
    assert "Blades of the aperture." in CliRunner().invoke(app, ["--help"]).output


@pytest.mark.parametrize("one", declared(CaptureOptions), ids=lambda one: one.name)
def test_every_capture_option_has_help_and_a_valid_default(one: Any) -> None:
    assert one.option.help[0].isupper() or one.option.help.split()[0].strip(":,") in map(
        str, one.choices
    )
    assert one.option.help.endswith(".")
    assert one.checked(one.option.default) == one.option.default

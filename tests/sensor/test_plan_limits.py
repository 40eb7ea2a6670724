"""A plan holds for what it was made for, and says so; `tolerance_dn` makes one for the light at hand."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from helpers.marks import exhaustive, one_in

import mitsuba_sensor as ms

EXPOSURE = ms.Exposure(0.1)
CAMERA = ms.load_camera("konnik_table1")
DIM = np.linspace(1.0, 100.0, 30 * 40).reshape(30, 40)

REFUSED: dict[str, tuple[Any, ms.Exposure, dict[str, Any], str]] = {
    "a longer exposure": (
        DIM,
        ms.Exposure(0.2),
        {},
        r"made for 0.1 s at 298.15 K, and this exposure is 0.2 s at 298.15",
    ),
    "a warmer one": (
        DIM,
        ms.Exposure(0.1, 320.0),
        {},
        "this exposure is 0.1 s at 320 K; make a plan for this one",
    ),
    "45 000 photons": (
        np.full((30, 40), 45_000.0),
        EXPOSURE,
        {},
        r"… 60.* mean photoelectrons per pixel, and this light",
    ),
    "one bright pixel": (
        np.where(DIM == 1.0, 200.0, DIM),
        EXPOSURE,
        {},
        "this light has 0.6.* … 120",
    ),
    "darkness": (np.zeros((30, 40)), EXPOSURE, {}, r"this light has 0 … 0; make a plan"),
    "a larger window": (
        np.full((31, 40), 50.0),
        EXPOSURE,
        {},
        "made for 30 × 40 pixels, and this window has 31 × 40",
    ),
    "a wider window": (
        np.full((3, 41), 50.0),
        EXPOSURE,
        {},
        "made for 30 × 40 pixels, and this window has 3 × 41",
    ),
    "measured maps": (
        DIM,
        EXPOSURE,
        {"maps": {"dsnu_col_e": np.ones((1, 40))}},
        r"\(none\) than this .* \(dsnu_col_e\)",
    ),
}


@pytest.mark.parametrize("case", one_in(4, REFUSED))
@pytest.mark.parametrize("ask", [ms.expose, ms.stream], ids=["expose", "stream"])
def test_a_plan_refuses_what_it_was_not_made_for_and_names_both(case: str, ask: Any) -> None:
    light, exposure, options, sentence = REFUSED[case]
    plan = ms.plan(CAMERA, EXPOSURE, DIM, 0.02)
    with pytest.raises(ms.InputError, match=sentence):
        ask(light, CAMERA, exposure, plan=plan, **options)


def test_a_plan_serves_the_same_light_in_another_order_and_a_part_of_it() -> None:
    plan = ms.plan(CAMERA, EXPOSURE, DIM, 0.02)
    for light in (DIM, DIM[::-1], DIM[:10, 5:20], np.full((30, 40), 50.0)):
        assert ms.expose(light, CAMERA, EXPOSURE, plan=plan).plan is plan


def test_a_plan_of_a_map_serves_that_map_alone() -> None:
    one, other = ({"dsnu_col_e": np.full((1, 40), value)} for value in (1.0, 2.0))
    plan = ms.plan(CAMERA, EXPOSURE, DIM, 0.02, maps=one)
    assert ms.expose(DIM, CAMERA, EXPOSURE, plan=plan, maps=one).plan is plan
    with pytest.raises(ms.InputError, match="other measured maps"):
        ms.expose(DIM, CAMERA, EXPOSURE, plan=plan, maps=other)


@pytest.mark.parametrize("tolerance", [exhaustive(0.0), 0.02, exhaustive(2.0)])
def test_tolerance_dn_is_the_plan_of_that_light(tolerance: float) -> None:
    plan = ms.plan(CAMERA, EXPOSURE, DIM, tolerance)
    frames = ms.expose(DIM, CAMERA, EXPOSURE, tolerance_dn=tolerance, frames=2)
    assert (
        frames.plan is not None
        and frames.plan.left_out == plan.left_out
        and frames.stages == plan.stages
    )
    np.testing.assert_array_equal(
        frames.digital, ms.expose(DIM, CAMERA, EXPOSURE, plan=plan, frames=2).digital
    )
    streamed = list(ms.stream(DIM, CAMERA, EXPOSURE, tolerance_dn=tolerance, frames=2))
    np.testing.assert_array_equal(frames.digital, streamed)


def test_without_tolerance_there_is_no_plan_and_nothing_is_left_out() -> None:
    frames = ms.expose(DIM, CAMERA, EXPOSURE)
    assert frames.plan is None and frames.stages == CAMERA.stages


REFUSED_OPTIONS: dict[str, tuple[dict[str, Any], str]] = {
    "negative": ({"tolerance_dn": -0.1}, "tolerance_dn is -0.1"),
    "no number": ({"tolerance_dn": "0.1"}, "tolerance_dn is '0.1'"),
    "beside a plan": (
        {"tolerance_dn": 0.1, "plan": True},
        "a plan is given, which has a tolerance of its own",
    ),
}


@pytest.mark.parametrize("case", REFUSED_OPTIONS)
def test_a_tolerance_that_makes_no_sense_is_refused(case: str) -> None:
    options, sentence = REFUSED_OPTIONS[case]
    if "plan" in options:
        options = {**options, "plan": ms.plan(CAMERA, EXPOSURE, DIM)}
    with pytest.raises(ms.InputError, match=sentence):
        ms.expose(DIM, CAMERA, EXPOSURE, **options)


def test_capture_writes_what_was_left_out_into_the_metadata(light: Any) -> None:
    with_plan = ms.capture(light, CAMERA, EXPOSURE, tolerance_dn=0.5)
    found = with_plan.metadata
    assert (
        found["left_out"] == with_plan.frames.plan.left_out and "CDS gain" in found["left_out"]
    )
    assert [e["stage"] for e in found["effects"] if not e["kept"]] == found["left_out"]
    assert found["options"]["tolerance_dn"] == 0.5
    assert {line["name"] for line in found["stages"]}.isdisjoint(found["left_out"])
    without = ms.capture(light, CAMERA, EXPOSURE).metadata
    assert without["left_out"] == without["effects"] == [] and without["float32"] is None

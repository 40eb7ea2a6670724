"""Suggestions: for misspellings, but not for names that merely look alike."""

from __future__ import annotations

import pytest

from mitsuba_sensor.core.near_names import closest

KNOWN = ("one_file", "exposure_s", "bayer_2mp", "konnik_table1", "pixel.full_well_e", "spp")


@pytest.mark.parametrize(
    ("written", "meant"),
    [
        ("bayer_2pm", "bayer_2mp"),
        ("BAYER_2MP", "bayer_2mp"),
        ("exposure", "exposure_s"),
        ("exposre_s", "exposure_s"),
        ("full_well", "pixel.full_well_e"),
        ("table1", "konnik_table1"),
        ("konnik", "konnik_table1"),
        ("spq", "spp"),
    ],
)
def test_misspellings_and_parts_of_names_are_close(written: str, meant: str) -> None:
    assert closest(written, KNOWN) == meant


@pytest.mark.parametrize("written", ["nofile", "exposure_stop", "exposure_time", "x", "lamp"])
def test_names_that_only_share_letters_are_not_close(written: str) -> None:
    """`nofile` does not suggest one_file, nor `exposure_stop` exposure_s."""
    assert closest(written, KNOWN) is None

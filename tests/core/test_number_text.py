"""core/number_text.py: what people write for a number, and the number."""

import pytest

from mitsuba_sensor.core.number_text import number_hint


@pytest.mark.parametrize(
    ("text", "hint"),
    [
        ("0.5 %", "'0.5 %' is 0.005"),
        (".5%", "'.5%' is 0.005"),
        ("10 500", "'10 500' is 10500"),
        ("10'500.5", '"10\'500.5" is 10500.5'),
        ("10,500", "'10,500' is 10500, or 10.500"),
        ("1,000,000", "'1,000,000' is 1000000"),
        ("0,5", "'0,5' is 0.5"),
        ("10k", "'10k' is 10000"),
        ("1e3 e-", "write the number alone, without 'e-'"),
        ("3.45µm", "write the number alone, without 'µm'"),
        ("four", ""),
        ("", ""),
        (14, ""),
    ],
)
def test_a_text_in_place_of_a_number_is_understood(text: object, hint: str) -> None:
    assert number_hint("pixel.prnu", text) == hint


def test_percent_of_a_number_in_percent_is_that_number() -> None:
    assert number_hint("lens.distortion_percent", "0.5 %") == "'0.5 %' is 0.5"

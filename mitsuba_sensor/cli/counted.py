"""What the counts of frame.json are called in the terminal."""

COUNTED = {
    "clipped_full_well": "at the full well",
    "clipped_adc_high": "at the highest code",
    "clipped_adc_low": "at code 0",
    "cut_to_zero_prnu": "whose gain would be negative by its distribution, taken as 0",
    "cut_to_zero_prnu_col": "whose column's gain would be negative by its distribution, taken as 0",
    "cut_to_zero_dark_fpn": "whose dark current would be negative by its distribution, taken as 0",
    "compensated_short": "with more render noise than the compensation can take out",
    "negative": "with negative light, taken as none",
    "non_finite": "with light that is no number",
}
"""Count → what so many pixels are."""


def counted(name: str) -> str:
    """What the pixels of a count are."""
    return COUNTED.get(name) or name.replace("_", " ")

"""Cameras from files of other programs: noise models, calibration tables, reports and presets → a datasheet of ours."""

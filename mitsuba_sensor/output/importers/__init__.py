"""Importers: noise models, calibrations, reports and presets of other programs → a camera."""

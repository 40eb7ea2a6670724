"""A Mitsuba scene to spectral irradiance and photons; the only package that imports Mitsuba."""

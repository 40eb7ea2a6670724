"""The sensor: mean photons per pixel become digital numbers, without Mitsuba."""

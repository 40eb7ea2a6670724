"""Lens models without Mitsuba: f-number law, measured distortion, sequential ray trace; and the shutter."""

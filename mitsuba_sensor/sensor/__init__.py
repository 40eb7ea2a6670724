"""From photons to digital numbers: electrons, volts, digital. Pure physics; it never heard of Mitsuba."""

"""Largest and smallest values of the options of a render."""

SHORTEST_NM, LONGEST_NM = 200.0, 2500.0  # ranges of silicon, InGaAs and HgCdTe sensors
NARROWEST_NM = 0.5  # below it the float32 nodes of a band lose accuracy
MOST_SPP = 1024  # per pass: the float32 film loses about 1e-8 per sample
MOST_REPEATABLE = 8  # per pass, where the sum must not depend on threads: what a vector of AVX2 or AVX-512 holds
MOST_IN_ALL = 2**24  # samples per pixel, over all passes

SHORTEST_METERED_S = 1e-5
"""Exposure time below which light is brighter than the electronic shutters of most cameras allow."""

MITSUBA_NM = (360.0, 830.0)
"""Where Mitsuba's own emitters and its spectra of colours are not zero."""

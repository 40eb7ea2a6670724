"""A Mitsuba scene to spectral irradiance and photons; the only package that imports Mitsuba.

variants.py chooses the variant that renders, options.py declares what can be asked of a render. Then, as light goes:
scene/ reads and loads a scene, lint/ checks it, passes/ renders it, denoise/ filters it, light/ is what comes out, and
motion/ moves it. plugins/ does the same inside plain Mitsuba; doctor.py tries what works on this machine.
"""

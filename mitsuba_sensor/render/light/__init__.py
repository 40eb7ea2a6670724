"""Irradiance at the focal plane and what is collected from it: mean photons per pixel.

bands.py chooses the spectral channels of a film. irradiance.py is the result of a render; photons.py turns it, or any
other light, into photons, which remember their light: light_source.py says how good that is for a frame.
foreign_light.py takes other programs' light.
"""

"""Instruments: each measures stacks of frames and returns quantities with intervals (EMVA 1288 R4).

measurement.py is the start and runs all of them on one bench. In light: photon_transfer.py, radiometric.py and
saturation.py, combined in emva_linear.py, and nonuniformity.py. In the dark: dark_noise.py, dark_current.py,
dark_signal.py, rts_pixels.py. Lines and pixels: line_noise.py, spectrogram.py, profiles.py, correlation.py, defects.py.
image_quality/ measures images of charts (edges, stars, textures, steps), colour_and_geometry/ colours, light over the
field and distortion, automotive/ contrast and flicker.
"""

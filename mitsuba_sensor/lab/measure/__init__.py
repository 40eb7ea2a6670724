"""Instruments: each measures one thing on stacks of frames and returns quantities with intervals (EMVA 1288 R4).

measurement.py runs all of them on one bench and is the place to begin. In light: photon_transfer.py, radiometric.py,
saturation.py, together in emva_linear.py, and nonuniformity.py. In the dark: dark_noise.py, dark_current.py,
dark_signal.py, rts_pixels.py. Lines and pixels: line_noise.py, spectrogram.py, profiles.py, correlation.py, defects.py.
image_quality/ has those of pictures of charts: edges, stars, textures, steps; colour_and_geometry/ those of colours and
light over the field; automotive/ those of contrast and flicker.
"""

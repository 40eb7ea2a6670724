"""Frames, light and cameras in files: metadata, previews, colours, DNGs, and cameras of other programs.

frame_files.py writes a folder of frames and their metadata, preview.py develops them, dng.py writes DNGs.
exr.py writes and reads irradiance and AOVs, light_files.py reads the light of other programs.
importers/ makes a camera from noise models, calibrations and presets of other programs.
"""

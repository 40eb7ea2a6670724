"""What frames, light and cameras are in files: their metadata, previews, colours, DNGs; cameras of other programs.

frame_files.py is what a folder of frames holds and what is said of them, preview.py how they are developed.
exr.py writes and reads irradiance and AOVs, light_files.py the light of other programs; dng.py writes DNGs of a camera.
importers/ makes a camera from noise models, calibrations and presets of other programs.
"""

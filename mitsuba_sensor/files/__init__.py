"""Bytes and arrays in files: EXR, TIFF, PNG, NumPy, FITS and camera raw, text, tar shards, folders; knows no camera.

Read appearing.py and whole_folder.py first: a file or folder appears whole or not at all.
disk_errors.py makes one sentence of what the disk refuses, durable.py flushes and hashes. Each format has a module.
scene_references.py lists the files of a scene.
"""

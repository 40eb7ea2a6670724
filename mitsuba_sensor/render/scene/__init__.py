"""Scenes of Mitsuba: read, checked for what they ask of camera and exposure, changed, and loaded with our film.

parse_scene.py parses a file without building it (old_text.py and old_formats.py convert older versions) into what
scene_file.py holds; scene_nodes.py does the same of scenes that are no file. scene_settings.py reads camera, exposure
and seeds from them; scene.py loads the scene and replaces its film, and lens_sensor.py its sensor. plugin_names.py has
the plugins and their parameters.
"""

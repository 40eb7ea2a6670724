"""Scenes of Mitsuba: parsed, checked for what they ask of camera and exposure, changed, and loaded with our film.

parse_scene.py makes a ParsedScene (parsed_scene.py) of a path, XML text, a dict or a loaded scene (loaded_scene.py);
scene_settings.py reads camera, exposure and seeds of it; scene.py replaces its film and builds the Scene that is
rendered, lens_sensor.py and its neighbours its sensor. plugin_names.py has the plugins, plugin_parameters.py ours.
"""

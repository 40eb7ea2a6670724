"""Plugins for plain Mitsuba: <sensor type="camera">, <film type="photosensor"> and <integrator type="raw_frame">.

plugin_hook.py registers them. The package imports it and puts a finder into sys.meta_path; plugins.py (sensor and film)
and raw_film.py (integrator and raw frames) are imported when a scene needs them.
"""

"""A parsed scene becomes a Scene: built by Mitsuba with our film, and seen through the camera's lens and polarisers.

scene.py has the steps. lens_sensor.py wraps the scene's sensor; displaced_rays.py, half_pupil.py and polarizer_rays.py
change its rays, and weight_noise.py takes away noise that their weights add.
"""

"""The laboratory: frames of any camera in, quantities with intervals and a twin of the camera out; no simulator.

>>> import mitsuba_sensor as ms
>>> twin = ms.lab.fit("bench/")                             # bias, dark and flat frames in a folder
>>> camera = ms.load_camera(twin.tables())                  # a camera that takes such frames
>>> frames = ms.expose(0.0, camera, ms.Exposure(0.01), maps=twin.maps)
"""

import lazy_loader

# __init__.pyi lists the public names.
__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)

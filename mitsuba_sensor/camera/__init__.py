"""The datasheet of a camera, and what follows from it alone.

camera.py puts the tables of all effects together; lens_datasheet.py is that of the lens, gain_ladder.py its gain
settings. camera_file.py finds and reads cameras (cameras/, lenses/ are those that ship), field_catalogue.py writes
them and lists their fields; camera_check.py says all that is wrong or unusual in one. figures.py has the
figures of EMVA 1288, colour_matrix.py the colours behind its filters.
"""

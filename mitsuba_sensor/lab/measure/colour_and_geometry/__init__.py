"""Instruments for colour and geometry: images of charts in, quantities with 95 % intervals out.

colour_chart.py measures colour differences of a chart of known colours, flat_field.py relative illumination and colour
shading, distortion.py distortion and lateral colour of known points.
"""

"""Statistics that instruments and fits share; only mean_squares.py uses frames.

estimators.py has medians, ratios, limits and the interval of a noncentral χ² distribution; line_fits.py straight lines;
mean_squares.py mean squares of rows, columns and pixels with intervals; outliers.py outlying pixels of an image.
"""

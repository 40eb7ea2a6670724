"""Statistics that instruments and fits share; all but mean_squares.py know no frames.

estimators.py has medians, ratios, limits and the interval of a noncentral χ² law; line_fits.py straight lines;
mean_squares.py the mean squares of rows, columns and pixels, with intervals; outliers.py the pixels that stand out from
an image.
"""

"""Renders: passes are added until a stop criterion is met, with the variance of each pixel.

prepared.py, the whole render of a scene, is the place to begin; renderer.py adds its passes (passes.py, row_strip.py,
interleaved.py), stop_criterion.py and noise_goals.py end them, statistics.py describes them. per_frame.py renders anew
for every frame, noisy_pixels.py gives single pixels more samples, requirements.py tries what a scene needs.
"""

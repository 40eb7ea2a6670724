"""What the frames of a camera are expected to be: one theory, of a pixel, and what is said with it.

``pixel_moments`` has the law of a pixel: its count (``pixel_counts``), the swing behind curves (``swing``), the codes
(``pixel_codes``, ``pixel_table``, ``steps_shown``). ``frame_theory`` averages it over ``sampled_pixels``, with the
``response`` of a pixel without fixed-pattern noise; ``measured_theory`` samples a chain with a stage that has no law,
and ``coupled_theory`` one that couples neighbouring pixels.
On top stand ``report``, ``noise_budget``, ``plan`` with ``plan_effects`` and ``plan_sample``, ``input_noise`` and the
EMVA ``figures``.
"""

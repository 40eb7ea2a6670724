"""One effect of the signal chain per file; add one here, and a line in the order of chain.py.

In the order of the chain: quantum_efficiency, prnu (pixels), dark_current, rts_pixels, shot_noise, quantum_yield,
full_well, sense_node, reset_noise, source_follower_noise, rtn_pixels, source_follower, dsnu, prnu (columns),
temporal_line_noise, source_follower (CDS gain), integral_nonlinearity, adc.
"""

"""Real lenses: surfaces of glass traced ray by ray, and the distortion of lenses that are known by measurement."""

"""Each stage of the sensor and each feature of the render off in turn."""

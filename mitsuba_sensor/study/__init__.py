"""Studies of the tool itself: error against run time, stiff and extreme cases, and what was left out."""

"""Studies of the tool itself: error against run time, what can be left out, stiff and extreme cases."""

"""What the physics stands on: quantities, arrays, named random words, quantile functions, moments, one frame."""

"""What every stage is computed with: units, signals, arrays, random numbers, backends, moments, frames, errors."""

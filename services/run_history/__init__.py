"""What each run cost: running time and traction energy from positions alone, and what could have been saved."""

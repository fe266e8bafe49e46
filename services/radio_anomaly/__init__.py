"""Radio along the line: what is normal, what leaves it, and what will."""

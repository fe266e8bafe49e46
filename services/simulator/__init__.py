"""A train on a line with simulated sensors, against one truth."""

"""A reference station on the wayside: corrections of pseudoranges from a place that is known."""

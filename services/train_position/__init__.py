"""The train's place on its line: one position with its bound, from every source."""

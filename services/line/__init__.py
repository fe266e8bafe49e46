"""The line: its axis in metres, its kilometrage, places projected onto it, and the files that hold it."""

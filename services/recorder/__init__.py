"""Keeps everything on the bus in MCAP files, and plays it back."""

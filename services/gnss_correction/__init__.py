"""Turns GNSS epochs into positions, with a verdict on every satellite."""

"""Reads a GNSS receiver, or a recording of one, onto the bus."""

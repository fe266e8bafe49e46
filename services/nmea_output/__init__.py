"""Gives positions to equipment that listens to NMEA 0183 over TCP."""

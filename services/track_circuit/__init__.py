"""Track circuits: spread-spectrum, CDMA-QAM and frequency-coded telegrams through the rail, occupied or clear."""

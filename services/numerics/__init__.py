"""What several rooms reckon with: how loops are compiled, the figure of the Earth."""

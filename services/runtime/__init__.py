"""What every service stands on: node, clock, configuration, life cycle."""

"""Curves as virtual balises: recognised by their curvature, they say where the train is (docs/landmark_matching.md)."""

"""Kirotei's running parts and the pure algorithms beside them."""

"""What runs left, read back, and what belongs together."""

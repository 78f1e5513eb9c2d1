"""Comparison with the full model."""

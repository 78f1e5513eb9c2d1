"""Compilation with numba, and small dense algebra in compiled code."""

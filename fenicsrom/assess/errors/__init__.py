"""Estimates of errors, and the verdicts that follow from them."""

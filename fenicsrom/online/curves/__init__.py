"""Curves of periodic motions and damped nonlinear modes, followed by continuation."""

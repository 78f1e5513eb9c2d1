"""Many runs of a scene: comparisons of bases, sweeps, and stability at extremes."""

"""How far an answer can be trusted: error estimates, verdicts, comparisons, extremes."""

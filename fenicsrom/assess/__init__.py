"""How far an answer can be trusted: error estimates, verdicts, comparisons, extremes.

Imports run one way, between the modules and packages of this one too:

    jobs < errors < full < curves < rotation < studies
"""

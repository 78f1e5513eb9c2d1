"""The reduced model in time: polynomial, contact, time stepping. Nothing here needs dolfinx.

Imports run one way, between the packages of this one too:

    kernels < contact < model < step < motion < stress < derivative < periodic < run < store
        < curves
"""

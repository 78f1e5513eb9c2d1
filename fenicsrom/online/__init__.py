"""The reduced model in time: polynomial, contact, time stepping. Nothing here needs dolfinx."""

"""From a structure to a reduced model: modes, derivatives, selection, basis and projection."""

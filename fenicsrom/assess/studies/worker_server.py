"""Imports of the server process of `fenicsrom.assess.processes`; no other module imports this one.

The processes that the server forks have these modules at once, and their collectors of garbage
leave them out. The server ignores SIGTERM, which
batch systems send to all processes: the processes end on their own, and the server ends with the
process that started it.
"""

import gc
import signal

gc.disable()

import fenicsrom.assess.studies.sweep_runs  # noqa: E402, F401

gc.freeze()
gc.enable()
signal.signal(signal.SIGTERM, signal.SIG_IGN)

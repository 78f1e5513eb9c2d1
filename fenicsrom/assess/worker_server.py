"""What the server process of `fenicsrom.assess.processes` imports; nothing else imports it.

The processes that the server forks have these modules at once. The server ignores SIGTERM, which
batch systems send to all processes: the processes end on their own, and the server ends with the
process that started it.
"""

import signal

import fenicsrom.assess.sweep_runs  # noqa: F401

signal.signal(signal.SIGTERM, signal.SIG_IGN)

"""The entry of the command line: a child process computes, and this process sees that it ends.

Python runs the handler of a signal between two of its own instructions. A library that needs
minutes for one call, such as a factorisation, makes a signal wait for its return. Therefore this
process passes each signal on to the child, and kills a child that does not end in time.
"""

import ctypes
import io
import os
import signal
import sys
from contextlib import suppress

from fenicsrom.cli import main
from fenicsrom.cli.ranks import is_idle, stopped
from fenicsrom.cli.termination import WORDS

PATIENCE = 9.0  # s in which a child that was interrupted must keep its results and end
DIES_WITH_PARENT = 1  # PR_SET_PDEATHSIG of Linux


def run() -> int:
    """Run the command of `sys.argv` in a child process; return its exit code.

    A program that uses MPI already, and runs the command by `runpy`, runs it itself: a child of it
    would hang in MPI. So does a system that cannot fork, such as Windows. Characters that the
    encoding of the terminal lacks become question marks.
    """
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):  # not of a caller that collects the text
            stream.reconfigure(errors="replace")
    if "mpi4py.MPI" in sys.modules or not hasattr(os, "fork"):
        return main()
    signal.pthread_sigmask(signal.SIG_BLOCK, WORDS)  # until both processes have their handlers
    child = os.fork()
    if child == 0:
        if sys.platform == "linux":
            ctypes.CDLL(None).prctl(DIES_WITH_PARENT, signal.SIGKILL)
        return main()  # which lets the signals in
    return _exit_code_of(child)


def _exit_code_of(child: int) -> int:
    """Pass signals on to a child until it ends, within `PATIENCE` of the first; its exit code."""
    received: list[int] = []
    killed = False

    def pass_on(number: int, frame: object) -> None:
        if not received:
            signal.setitimer(signal.ITIMER_REAL, PATIENCE)
        received.append(number)
        with suppress(ProcessLookupError):
            os.kill(child, number)

    def kill(number: int, frame: object) -> None:
        nonlocal killed
        killed = True
        with suppress(ProcessLookupError):
            os.kill(child, signal.SIGKILL)

    signal.signal(signal.SIGALRM, kill)
    for number in WORDS:
        if signal.getsignal(number) is not signal.SIG_IGN:
            signal.signal(number, pass_on)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, WORDS)
    code = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
    signal.setitimer(signal.ITIMER_REAL, 0.0)
    if not killed:
        return code if code >= 0 else 128 - code
    word, code = WORDS[received[0]]
    sentence = f"{word}, and killed within a long computation; what the output folder has was kept"
    return code if is_idle() else stopped(sentence, code)

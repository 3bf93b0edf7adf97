"""How the command `sdhj` ends when it is told to: at once, with one sentence, and with no half file left behind."""

import os
import signal
from contextlib import suppress
from pathlib import Path
from types import FrameType

TEMPORARIES: set[Path] = set()  # files that are being written


def stop(number: int, frame: FrameType | None) -> None:
    """Clean up and end the process, status 128 + the signal's number; an exception might be swallowed on its way."""
    for temporary in list(TEMPORARIES):
        with suppress(OSError):
            temporary.unlink()
    what = "interrupted" if number == signal.SIGINT else "told to end"
    with suppress(OSError):
        os.write(2, f"\nsdhj was {what}; what it was writing is not there, older files are as they were\n".encode())
    os._exit(128 + number)


def stop_at_signals() -> None:
    """Have Ctrl-C and SIGTERM end this process so."""
    for number in (signal.SIGINT, signal.SIGTERM):
        with suppress(ValueError):  # only the main thread may
            if signal.getsignal(number) in (signal.SIG_DFL, signal.default_int_handler):
                signal.signal(number, stop)

"""Ctrl-C, which is to end a command wherever it comes."""

import _thread
import signal
import sys
import threading

AGAIN_S = 0.05  # after which an interrupt that was swallowed is given again


def end_wherever_interrupted() -> None:
    """Give an interrupt again that came where Python cannot raise it, as in a callback of the garbage collector.

    JAX has one, so about one in five was lost, and the command ran on to its end.
    """
    usual = sys.unraisablehook

    def hook(unraisable: "sys.UnraisableHookArgs") -> None:
        if issubclass(unraisable.exc_type, KeyboardInterrupt):
            threading.Timer(AGAIN_S, _interrupt).start()
        else:
            usual(unraisable)

    sys.unraisablehook = hook


def _interrupt() -> None:
    main = threading.main_thread().ident
    if main is not None and hasattr(signal, "pthread_kill"):
        signal.pthread_kill(main, signal.SIGINT)  # wakes it, too, where it waits
    else:
        _thread.interrupt_main()

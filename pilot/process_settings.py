"""Settings of a whole process: threads and memory. Only commands choose them, and for the processes they start.

The library itself never changes them: who imports it keeps the settings of his own program.
"""

import contextlib
import ctypes
import sys
import warnings


def for_pictures() -> None:
    """One thread for each of OpenCV's calls: pictures are worked on by threads of our own, which it would fight."""
    import cv2  # noqa: PLC0415 - the others of this file need not wait for it

    cv2.setNumThreads(1)


def for_training(threads: int) -> None:
    """Settings for a process that trains.

    Args:
        threads: of the main thread's own operations; OpenMP's helpers keep a core busy for a while after each of them.
    """
    import torch  # noqa: PLC0415

    for_pictures()
    _keep_memory()
    torch.set_num_threads(threads)


def for_driving() -> None:
    """Settings for a process that drives.

    One thread: a second one gains half a millisecond on an idle machine, but where the simulator wants the cores too,
    both threads wait for the one that has none: 120 ms instead of 10 in the slowest hundredth.
    """
    import torch  # noqa: PLC0415

    for_pictures()
    torch.set_num_threads(1)


def for_serving() -> None:
    """Settings for a process that serves the simulator: no warning about eventlet, which its old protocol needs."""
    warnings.filterwarnings("ignore", message=r"\s*Eventlet is deprecated")


def _keep_memory() -> None:
    """Have glibc keep freed memory, for all threads together.

    Giving 100 MB back and taking it anew each step costs a fifth of it; a thread's own arena cannot keep more than
    64 MB at all.
    """
    if sys.platform == "linux":
        with contextlib.suppress(OSError, AttributeError):
            libc = ctypes.CDLL("libc.so.6")
            libc.mallopt(-3, 1 << 30)  # M_MMAP_THRESHOLD
            libc.mallopt(-1, 1 << 30)  # M_TRIM_THRESHOLD
            libc.mallopt(-8, 1)  # M_ARENA_MAX

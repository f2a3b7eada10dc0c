"""Process-wide settings: threads, memory and warnings, applied by the commands, their workers and training sessions.

The rest of the library never changes them, so that programs which import it keep their own settings.
"""

import contextlib
import ctypes
import gc
import sys
import warnings


def for_images() -> None:
    """Let OpenCV use a single thread per call: images are processed by several threads, which would compete with it."""
    import cv2  # noqa: PLC0415 - the other functions do not need it

    cv2.setNumThreads(1)


def for_training() -> None:
    """Apply the settings of a process that trains, before it allocates memory or starts threads."""
    for_images()
    _keep_memory()


def use_threads(threads: int) -> None:
    """Set the number of threads of each of PyTorch's operations in the main thread.

    OpenMP's helper threads keep a core busy for some time after each operation.
    """
    import torch  # noqa: PLC0415 - the other functions need not wait for it

    torch.set_num_threads(threads)


def for_driving() -> None:
    """Apply the settings for a process that drives: a single PyTorch thread.

    A second thread saves 0.5 ms on an idle machine. If the simulator needs the cores too, however, each operation waits
    for the thread without a core, which raises the 99th percentile of the response time from 10 to 120 ms.
    """
    import torch  # noqa: PLC0415

    for_images()
    torch.set_num_threads(1)


def after_loading() -> None:
    """Exempt all that is loaded from garbage collection: PyTorch's objects would delay an answer by 0.1 s each time."""
    gc.collect()
    gc.freeze()


def for_serving() -> None:
    """Suppress the deprecation warning of eventlet, which the simulator's old Socket.IO protocol requires."""
    warnings.filterwarnings("ignore", message=r"\s*Eventlet is deprecated")


def _keep_memory() -> None:
    """Make glibc keep freed memory, in one arena for all threads.

    Returning 100 MB to the system and allocating it again takes a fifth of the time of a training step. One arena,
    because those of single threads cannot keep more than 64 MB.
    """
    if sys.platform == "linux":
        with contextlib.suppress(OSError, AttributeError):
            libc = ctypes.CDLL("libc.so.6")
            libc.mallopt(-3, 1 << 30)  # M_MMAP_THRESHOLD
            libc.mallopt(-1, 1 << 30)  # M_TRIM_THRESHOLD
            libc.mallopt(-8, 1)  # M_ARENA_MAX

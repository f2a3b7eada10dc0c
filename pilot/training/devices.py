"""Where the network is trained: the device, and how the cores of a CPU share the work."""

import contextlib
import ctypes
import sys
from collections.abc import Callable, Iterable
from concurrent.futures import Future, ThreadPoolExecutor
from typing import TypeVar

import torch
from torch import nn

CORES = torch.get_num_threads()  # before anything changes it; OMP_NUM_THREADS limits it
SMALLEST_MICRO_BATCH = 16  # pictures; with fewer, what each call of a layer costs beside its arithmetic begins to count

Job = TypeVar("Job")
Result = TypeVar("Result")


def choose_device(name: str, local_rank: int = 0) -> torch.device:
    """The device of this name; "auto" takes the fastest there is. With several GPUs, each process has its own.

    Raises:
        ValueError: this machine has no such device.
    """
    cuda, mps = torch.cuda.is_available(), torch.backends.mps.is_available()
    chosen = name if name != "auto" else "cuda" if cuda else "mps" if mps else "cpu"
    available = {"cpu": True, "cuda": cuda, "mps": mps}
    if not available.get(chosen.split(":")[0], False):
        here = ", ".join(device for device, is_here in available.items() if is_here)
        raise ValueError(f"--device {name}: not on this machine; here are: auto, {here}")
    return torch.device("cuda", local_rank) if chosen == "cuda" else torch.device(chosen)


def autocast(device: torch.device) -> torch.autocast:
    """bfloat16 where the device gains by it: on GPUs that have it; CPUs were slower with it."""
    gains = device.type == "cuda" and torch.cuda.is_bf16_supported()
    return torch.autocast(device.type, torch.bfloat16, enabled=gains)


def keep_memory() -> None:
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


def micro_batches_of(network: nn.Module, device: torch.device, size: int) -> int:
    """Into how many parts a batch of this size is best divided, for as many threads.

    One for a GPU, and for networks that normalise over the whole batch.
    """
    whole = device.type != "cpu" or any(isinstance(layer, nn.BatchNorm2d) for layer in network.modules())
    return 1 if whole else max(min(CORES, size // SMALLEST_MICRO_BATCH), 1)


class Cores:
    """Threads that work on the parts of a batch, each with its share of the cores.

    Torch's own way is to divide each operation among all cores. Those wait for each other hundreds of times in a
    step: for the slowest, if another program has one of the cores. These meet once in a step.
    """

    def __init__(self, micro_batches: int) -> None:
        """Prepare for batches of `micro_batches` parts."""
        share = max(CORES // micro_batches, 1)
        # the calling thread's operations, too: OpenMP's helpers keep a core busy for a while after each of them
        torch.set_num_threads(share)
        self._threads = ThreadPoolExecutor(micro_batches, initializer=torch.set_num_threads, initargs=(share,))

    def start(self, work: Callable[[Job], Result], jobs: Iterable[Job]) -> list[Future[Result]]:
        """Have jobs done side by side, after those that were started before."""
        return [self._threads.submit(work, job) for job in jobs]

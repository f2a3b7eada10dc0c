"""Where the network is trained: the device, and how the cores of a CPU share the work."""

from collections.abc import Callable, Iterable
from concurrent.futures import Future, ThreadPoolExecutor
from typing import TypeVar

import torch
from torch import nn

CORES = torch.get_num_threads()  # before anything changes it; OMP_NUM_THREADS limits it
RANDOM_LAYERS = (nn.Dropout, nn.Dropout1d, nn.Dropout2d, nn.Dropout3d, nn.AlphaDropout, nn.RReLU)
SMALLEST_MICRO_BATCH = 16  # pictures; with fewer, what each call of a layer costs beside its arithmetic begins to count

Item = TypeVar("Item")
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


def micro_batches_of(network: nn.Module, device: torch.device, size: int) -> int:
    """Into how many micro-batches a batch of this size is best divided, for as many threads.

    One for a GPU, for networks that normalise over the whole batch, and for those that draw at random.
    """
    whole = device.type != "cpu" or draws_at_random(network) or _has(network, (nn.BatchNorm2d,))
    return 1 if whole else max(min(CORES, size // SMALLEST_MICRO_BATCH), 1)


def draws_at_random(network: nn.Module) -> bool:
    """Whether a network has layers that draw random numbers while it is trained, such as dropout."""
    return _has(network, RANDOM_LAYERS)


def _has(network: nn.Module, kinds: tuple[type[nn.Module], ...]) -> bool:
    return any(isinstance(layer, kinds) for layer in network.modules())


class CoreThreads:
    """Threads that work on the parts of a batch, each with its share of the cores.

    Torch's own way is to divide each operation among all cores. Those wait for each other hundreds of times in a
    step: for the slowest, if another program has one of the cores. These meet once in a step.
    """

    def __init__(self, micro_batches: int) -> None:
        """Prepare for batches of `micro_batches` micro-batches."""
        self.threads_each = max(CORES // micro_batches, 1)
        initialise = (self.threads_each,)
        self._threads = ThreadPoolExecutor(micro_batches, initializer=torch.set_num_threads, initargs=initialise)

    def start(self, work: Callable[[Item], Result], micro_batches: Iterable[Item]) -> list[Future[Result]]:
        """Have micro-batches worked on side by side, after those that were started before."""
        return [self._threads.submit(work, each) for each in micro_batches]

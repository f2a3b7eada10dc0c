"""Device selection, mixed precision, and threads that compute the micro-batches of a batch on a CPU."""

from collections.abc import Callable, Iterable
from concurrent.futures import Future, ThreadPoolExecutor
from typing import TypeVar

import torch
from torch import nn

CORES = torch.get_num_threads()  # read at import, before torch.set_num_threads changes it; limited by OMP_NUM_THREADS
RANDOM_LAYERS = (nn.Dropout, nn.Dropout1d, nn.Dropout2d, nn.Dropout3d, nn.AlphaDropout, nn.RReLU)
SMALLEST_MICRO_BATCH = 16  # samples; with fewer, the fixed overhead of each layer's call becomes significant

Item = TypeVar("Item")
Result = TypeVar("Result")


def choose_device(name: str, local_rank: int = 0) -> torch.device:
    """Return the device of this name.

    Args:
        name: cpu, cuda, cuda:N or mps; auto: the fastest one available.
        local_rank: number of this process on this machine; "cuda" is the GPU of this number.

    Raises:
        ValueError: the device is not available on this machine.
    """
    cuda, mps = torch.cuda.is_available(), torch.backends.mps.is_available()
    chosen = name if name != "auto" else "cuda" if cuda else "mps" if mps else "cpu"
    available = {"cpu": True, "cuda": cuda, "mps": mps}
    if not available.get(chosen.split(":")[0], False):
        here = ", ".join(device for device, is_here in available.items() if is_here)
        raise ValueError(f"--device {name}: not on this machine; here are: auto, {here}")
    return torch.device("cuda", local_rank) if chosen == "cuda" else torch.device(chosen)


def autocast(device: torch.device) -> torch.autocast:
    """Return a context of bfloat16 autocast, enabled on GPUs that support it only: on CPUs it was slower."""
    gains = device.type == "cuda" and torch.cuda.is_bf16_supported()
    return torch.autocast(device.type, torch.bfloat16, enabled=gains)


def micro_batches_of(network: nn.Module, device: torch.device, size: int) -> int:
    """Return the number of micro-batches, one per thread, into which a batch of `size` samples should be divided.

    It is 1 on GPUs, for networks with batch normalisation, and for networks with random layers.
    """
    whole = device.type != "cpu" or draws_at_random(network) or _has(network, (nn.BatchNorm2d,))
    return 1 if whole else max(min(CORES, size // SMALLEST_MICRO_BATCH), 1)


def draws_at_random(network: nn.Module) -> bool:
    """Return whether a network has layers that draw random numbers during training, such as dropout."""
    return _has(network, RANDOM_LAYERS)


def _has(network: nn.Module, kinds: tuple[type[nn.Module], ...]) -> bool:
    return any(isinstance(layer, kinds) for layer in network.modules())


class CoreThreads:
    """Threads that compute the micro-batches of a batch in parallel, each with an equal share of the cores.

    PyTorch's intra-op parallelism divides every operation among the cores, which then synchronise hundreds of times
    per step and wait for the slowest core, such as one that another program uses. These threads synchronise once.

    Attributes:
        threads_each: number of PyTorch threads per micro-batch.
    """

    def __init__(self, micro_batches: int) -> None:
        """Create one thread for each of the `micro_batches` of a batch."""
        self.threads_each = max(CORES // micro_batches, 1)
        initialise = (self.threads_each,)
        self._threads = ThreadPoolExecutor(micro_batches, initializer=torch.set_num_threads, initargs=initialise)

    def start(self, work: Callable[[Item], Result], micro_batches: Iterable[Item]) -> list[Future[Result]]:
        """Submit a call of `work` for each micro-batch, after those submitted before, and return the futures."""
        return [self._threads.submit(work, each) for each in micro_batches]

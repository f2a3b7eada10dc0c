"""Training on several processes started by torchrun: ranks, and sums over all processes."""

import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass

import torch
from torch import Tensor, nn
from torch import distributed as group


@dataclass(frozen=True)
class Processes:
    """The group of training processes; the defaults are those of a single process.

    Attributes:
        rank: number of this process, from 0.
        world_size: number of processes.
        local_rank: number of this process on its machine, from 0.
    """

    rank: int = 0
    world_size: int = 1
    local_rank: int = 0

    @property
    def is_main(self) -> bool:
        """Whether this is the main process, which prints and writes files."""
        return self.rank == 0

    def sum(self, values: Tensor) -> Tensor:
        """Sum a tensor over all processes, in place, and return it."""
        if self.world_size > 1:
            group.all_reduce(values)
        return values

    def sum_gradients(self, parameters: Sequence[nn.Parameter]) -> None:
        """Sum the parameters' gradients over all processes, in place, with a single all-reduce."""
        if self.world_size > 1:
            gradients = [p.grad for p in parameters if p.grad is not None]
            flat = self.sum(torch.cat([gradient.flatten() for gradient in gradients]))
            for gradient, total in zip(gradients, torch.split(flat, [g.numel() for g in gradients]), strict=True):
                gradient.copy_(total.view_as(gradient))

    def average_statistics(self, network: nn.Module) -> None:
        """Average the running means and variances of batch normalisation over all processes, in place."""
        if self.world_size > 1:
            for name, statistic in network.named_buffers():
                if name.endswith(("running_mean", "running_var")):
                    self.sum(statistic).div_(self.world_size)

    def barrier(self) -> None:
        """Wait until all processes have reached this call."""
        if self.world_size > 1:
            group.barrier()


@contextmanager
def join_processes() -> Iterator[Processes]:
    """Join the group of processes started by torchrun, and leave it at the end; without torchrun, a single process."""
    if "RANK" not in os.environ:
        yield Processes()
        return
    local_rank = int(os.environ.get("LOCAL_RANK", "0"))
    has_gpu = local_rank < torch.cuda.device_count()
    if has_gpu:
        torch.cuda.set_device(local_rank)  # before the first barrier, which would else use the first GPU everywhere
    # predictions are summed on the CPU, which NCCL does not support
    group.init_process_group("cpu:gloo,cuda:nccl" if has_gpu else "gloo")
    try:
        yield Processes(group.get_rank(), group.get_world_size(), local_rank)
    finally:
        group.destroy_process_group()

"""One training on several processes (torchrun): who am I, and sums over all of us."""

import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass

import torch
from torch import Tensor, nn
from torch import distributed as group


@dataclass(frozen=True)
class Processes:
    """This process's number and how many there are; one process alone is rank 0 of 1."""

    rank: int = 0
    world_size: int = 1
    local_rank: int = 0

    @property
    def is_main(self) -> bool:
        """Whether this is the process that prints and writes."""
        return self.rank == 0

    def sum(self, values: Tensor) -> Tensor:
        """The sum of a tensor over all processes, in place."""
        if self.world_size > 1:
            group.all_reduce(values)
        return values

    def sum_gradients(self, parameters: Sequence[nn.Parameter]) -> None:
        """Add up the parameters' gradients over all processes, in one message."""
        if self.world_size > 1:
            gradients = [p.grad for p in parameters if p.grad is not None]
            flat = self.sum(torch.cat([gradient.flatten() for gradient in gradients]))
            for gradient, total in zip(gradients, torch.split(flat, [g.numel() for g in gradients]), strict=True):
                gradient.copy_(total.view_as(gradient))

    def average_statistics(self, network: nn.Module) -> None:
        """Give all processes the same means and variances in batch normalisation: the mean of what each has seen."""
        if self.world_size > 1:
            for name, statistic in network.named_buffers():
                if name.endswith(("running_mean", "running_var")):
                    self.sum(statistic).div_(self.world_size)

    def barrier(self) -> None:
        """Until all processes are here."""
        if self.world_size > 1:
            group.barrier()


@contextmanager
def join_processes() -> Iterator[Processes]:
    """Join the processes that torchrun started; alone if it did not start this one."""
    if "RANK" not in os.environ:
        yield Processes()
        return
    local_rank = int(os.environ.get("LOCAL_RANK", "0"))
    has_gpu = local_rank < torch.cuda.device_count()
    if has_gpu:
        torch.cuda.set_device(local_rank)  # before the first barrier: else all processes meet on the first GPU
    # predictions are summed on the CPU, which NCCL cannot do
    group.init_process_group("cpu:gloo,cuda:nccl" if has_gpu else "gloo")
    try:
        yield Processes(group.get_rank(), group.get_world_size(), local_rank)
    finally:
        group.destroy_process_group()

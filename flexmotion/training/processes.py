"""`Processes`: the one process of a training, or those that `torchrun` started, one a GPU."""

from __future__ import annotations

import os
from contextlib import AbstractContextManager, nullcontext

import torch
from torch import nn


class Processes:
    """Device, rank and what the processes do together.

    Attributes:
        rank, count: of this process, and how many there are.
        device: GPU of this process, else the CPU.
    """

    def __init__(self) -> None:
        self.rank, self.count = int(os.environ.get("RANK", 0)), int(os.environ.get("WORLD_SIZE", 1))
        cuda = torch.cuda.is_available()
        self.device = torch.device("cuda", int(os.environ.get("LOCAL_RANK", 0))) if cuda else torch.device("cpu")
        if self.count > 1 and not torch.distributed.is_initialized():
            torch.distributed.init_process_group("nccl" if cuda else "gloo")

    @property
    def first(self) -> bool:
        """Whether this process writes the files."""
        return self.rank == 0

    def mixed_precision(self) -> AbstractContextManager[object]:
        """bfloat16 where a GPU does the work."""
        return torch.autocast("cuda", torch.bfloat16) if self.device.type == "cuda" else nullcontext()

    def any(self, here: bool) -> bool:
        """Whether something is so in any of the processes: all must stop at the same step."""
        if self.count == 1:
            return here
        flag = torch.tensor(float(here), device=self.device)
        torch.distributed.all_reduce(flag)
        return float(flag) > 0

    def average_gradients(self, network: nn.Module) -> None:
        """The mean of all processes' gradients, in place."""
        if self.count == 1:
            return
        gradients = [parameter.grad for parameter in network.parameters() if parameter.grad is not None]
        # One message: on a CPU a hundred small ones take longer than what they carry.
        together = torch.cat([gradient.flatten() for gradient in gradients])
        torch.distributed.all_reduce(together)
        together /= self.count
        for gradient, mean in zip(gradients, together.split([g.numel() for g in gradients]), strict=True):
            gradient.copy_(mean.view_as(gradient))


def use_threads(count: int) -> None:
    """How many threads of the CPU the networks run on."""
    torch.set_num_threads(count)

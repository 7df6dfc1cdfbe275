"""`Processes`: the one process of a training, or those that `torchrun` started, one per GPU."""

from __future__ import annotations

import os
from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext

import torch
from torch import Tensor, nn
from torch.nn.parallel import DistributedDataParallel

Losses = Callable[[int], tuple[Tensor, dict[str, Tensor]]]
"""Step to the loss of its batch and the named parts of that loss."""


class Processes:
    """Device and rank of this process, and what all processes do together.

    Attributes:
        rank, count: rank of this process, number of processes.
        device: GPU of this process, else the CPU.
    """

    def __init__(self) -> None:
        self.rank, self.count = int(os.environ.get("RANK", 0)), int(os.environ.get("WORLD_SIZE", 1))
        cuda = torch.cuda.is_available()
        self.device = torch.device("cuda", int(os.environ.get("LOCAL_RANK", 0))) if cuda else torch.device("cpu")
        if self.count > 1 and not torch.distributed.is_initialized():
            if cuda:
                torch.cuda.set_device(self.device)
            torch.distributed.init_process_group("nccl" if cuda else "gloo")

    @property
    def first(self) -> bool:
        """Whether this process writes the files."""
        return self.rank == 0

    def mixed_precision(self) -> AbstractContextManager[object]:
        """Autocast to bfloat16 on a GPU, and on a CPU with instructions for it; no change on other CPUs."""
        if self.device.type == "cuda" or torch.cpu._is_avx512_bf16_supported():
            return torch.autocast(self.device.type, torch.bfloat16)
        return nullcontext()

    def any(self, here: bool) -> bool:
        """Whether `here` is true in any process: all processes must stop at the same step."""
        if self.count == 1:
            return here
        flag = torch.tensor(float(here), device=self.device)
        torch.distributed.all_reduce(flag)
        return float(flag) > 0

    def close(self) -> None:
        """Leave the process group, at the end of the program."""
        if torch.distributed.is_available() and torch.distributed.is_initialized():
            torch.distributed.destroy_process_group()

    def synchronised(self, network: nn.Module, losses: Losses) -> Losses:
        """Losses whose backward pass leaves the mean of all processes' gradients in the network's parameters.

        Args:
            network: whose parameters are trained; gets the weights of the first process.
            losses: of this process' batches.
        """
        if self.count == 1:
            return losses
        # Buffers are constants, so only parameters are synchronised.
        return DistributedDataParallel(_Forward(network, losses), broadcast_buffers=False)


class _Forward(nn.Module):
    """Losses as a forward pass: `DistributedDataParallel` hooks into the backward pass of a module's forward."""

    def __init__(self, network: nn.Module, losses: Losses) -> None:
        super().__init__()
        self.network = network
        self._losses = losses

    def forward(self, step: int) -> tuple[Tensor, dict[str, Tensor]]:
        return self._losses(step)


def use_threads(count: int) -> None:
    """Set the number of CPU threads of the networks."""
    torch.set_num_threads(count)

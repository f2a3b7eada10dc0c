"""Processes that torchrun starts, as far as one without a GPU can tell."""

import pytest
import torch

from pilot.training import distributed


@pytest.fixture
def said(monkeypatch: pytest.MonkeyPatch) -> list[tuple[str, object]]:
    """What torch is told, in order, in the second of two processes."""
    said: list[tuple[str, object]] = []
    monkeypatch.setenv("RANK", "1")
    monkeypatch.setenv("LOCAL_RANK", "1")
    monkeypatch.setattr(torch.cuda, "set_device", lambda device: said.append(("device", device)))
    monkeypatch.setattr(distributed.group, "init_process_group", lambda backend: said.append(("group", backend)))
    monkeypatch.setattr(distributed.group, "get_rank", lambda: 1)
    monkeypatch.setattr(distributed.group, "get_world_size", lambda: 2)
    monkeypatch.setattr(distributed.group, "destroy_process_group", lambda: None)
    return said


def test_gpus_are_chosen_first_and_cpu_tensors_can_be_summed_too(
    said: list[tuple[str, object]], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(torch.cuda, "is_available", lambda: True)
    monkeypatch.setattr(torch.cuda, "device_count", lambda: 2)
    with distributed.join_processes() as processes:
        assert (processes.rank, processes.world_size, processes.local_rank) == (1, 2, 1)
        assert not processes.is_main
    assert said == [("device", 1), ("group", "cpu:gloo,cuda:nccl")]


def test_without_gpus_gloo_is_enough(said: list[tuple[str, object]], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(torch.cuda, "device_count", lambda: 0)
    with distributed.join_processes():
        assert said == [("group", "gloo")]

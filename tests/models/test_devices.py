"""A training on two devices, here processes of the processor, takes the steps of a training on one."""

from pathlib import Path

import pytest
import torch
from safetensors.torch import load_file, save_file
from torch import distributed, nn

from clearance.windows.window_set import BatchOrder
from tests.models.conftest import configured


def test_devices_share_every_batch_in_equal_parts():
    whole = list(BatchOrder(70, 16, (1, 2)))
    parts = [list(BatchOrder(70, 16, (1, 2), (part, 4))) for part in range(4)]
    assert [len(batch) for batch in whole] == [16, 16, 16, 16, 6]
    for index, batch in enumerate(whole):
        shares = [part[index] for part in parts]
        assert {len(share) for share in shares} == {-(-len(batch) // 4)}
        assert set(torch.cat(shares).tolist()) == set(batch.tolist())


class Witness(nn.Module):
    """A network that leaves the weights it validates with, by the rank of its process."""

    def __init__(self, net, folder):
        super().__init__()
        self.net, self.folder = net, Path(folder)

    def forward(self, signals):
        if not self.training and distributed.is_initialized():
            save_file(self.net.state_dict(), self.folder / f"{distributed.get_rank()}.safetensors")
        return self.net(signals)


@pytest.mark.slow  # each process imports everything
@pytest.mark.filterwarnings("ignore")  # of a library's start of processes, not ours
def test_two_processes_come_to_the_weights_of_one(make_data, open_run, tmp_path):
    def fit(devices):
        estimator = configured("lstm", "trainer.epochs=3", f"trainer.devices={devices}")
        make = estimator._make
        estimator._make = lambda channels, length, outputs: Witness(
            make(channels=channels, length=length, outputs=outputs), tmp_path
        )
        seconds = estimator.fit(make_data(), open_run(f"on {devices}"))
        assert seconds > 0
        return estimator.net.net.state_dict()

    alone, both = fit(1), fit(2)
    ranks = [load_file(tmp_path / f"{rank}.safetensors") for rank in range(2)]
    for name, weight in alone.items():
        assert torch.equal(ranks[0][name], ranks[1][name]), name
        # Sums in another order: single precision over some dozen steps.
        torch.testing.assert_close(both[name], weight, rtol=1e-3, atol=1e-5, msg=name)

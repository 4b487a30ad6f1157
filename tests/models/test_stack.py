import pytest
import torch
from torch import nn

from clearance.errors import InputError
from clearance.models.recurrent import GRU, LSTM
from clearance.models.stack import stacked
from tests.models.conftest import NEURAL, configured
from tests.models.fused_cells import on_the_processor


def nets_of(model, count=3, channels=2, length=60):
    torch.manual_seed(0)
    nets = []
    for _ in range(count):
        estimator = configured(model)
        estimator._build(channels, length, 2)
        nets.append(estimator.net)
    return nets


def passed(compute, nets, signals):
    """Outputs, and gradients of each network's weights, of the sum of the squares of all outputs."""
    output = compute(signals)
    output.square().sum().backward()
    return output.detach()


@pytest.mark.parametrize("model", NEURAL)
def test_a_stack_computes_what_each_network_does(model):
    nets, signals = nets_of(model), torch.randn(3, 5, 60, 2)
    stack = stacked(nets)
    output = passed(stack, nets, signals)
    apart = passed(
        lambda each: torch.stack([net(one) for net, one in zip(nets, each, strict=True)]), nets, signals
    )
    assert torch.equal(output, apart)
    for name, weight in zip(dict(nets[0].named_parameters()), stack.weights, strict=True):
        own = torch.stack([dict(net.named_parameters())[name].grad for net in nets])
        assert torch.equal(weight.grad, own), name


@pytest.mark.parametrize("kind", [LSTM, GRU])
@pytest.mark.parametrize("fold", [1, 2])
def test_networks_that_step_together_are_the_library_s(kind, fold):
    torch.manual_seed(0)
    nets = [kind(2, 20, 2, hidden_size=7, layers=3, fold=fold) for _ in range(4)]
    for net in nets:
        net.double()
    signals = torch.randn(4, 5, 20, 2, dtype=torch.float64)
    cells = on_the_processor()
    stack = stacked(nets)
    output = passed(stack.stepped, nets, signals)
    apart = passed(
        lambda each: torch.stack([net(one) for net, one in zip(nets, each, strict=True)]), nets, signals
    )
    torch.testing.assert_close(output, apart, rtol=1e-12, atol=1e-13)  # double precision's rounding, 20 steps
    for name, weight in zip(dict(nets[0].named_parameters()), stack.weights, strict=True):
        own = torch.stack([dict(net.named_parameters())[name].grad for net in nets])
        torch.testing.assert_close(weight.grad, own, rtol=1e-10, atol=1e-12, msg=name)
    del cells


@pytest.mark.gpu
@pytest.mark.skipif(not torch.cuda.is_available(), reason="needs a CUDA device")
@pytest.mark.parametrize("kind", [LSTM, GRU])
def test_networks_that_step_together_on_a_gpu_are_cudnn_s(kind):
    torch.manual_seed(0)
    nets = [kind(4, 200, 2, fold=1).cuda() for _ in range(3)]
    signals = torch.randn(3, 64, 200, 4, device="cuda")
    stack = stacked(nets).cuda()
    output = passed(stack, nets, signals)
    apart = passed(
        lambda each: torch.stack([net(one) for net, one in zip(nets, each, strict=True)]), nets, signals
    )
    # Ten bits of a product are kept (TF32), and 200 steps follow one another.
    torch.testing.assert_close(output, apart, rtol=1e-2, atol=1e-3)
    for name, weight in zip(dict(nets[0].named_parameters()), stack.weights, strict=True):
        own = torch.stack([dict(net.named_parameters())[name].grad for net in nets])
        assert (weight.grad - own).norm() < 1e-2 * own.norm(), name


def test_the_fused_cells_are_called_as_the_library_declares_them():
    for name, arguments in {
        "_thnn_fused_lstm_cell": ["input_gates", "hidden_gates", "cx", "input_bias", "hidden_bias"],
        "_thnn_fused_lstm_cell_backward_impl": ["grad_hy", "grad_cy", "cx", "cy", "workspace", "has_bias"],
        "_thnn_fused_gru_cell": ["input_gates", "hidden_gates", "hx", "input_bias", "hidden_bias"],
        "_thnn_fused_gru_cell_backward": ["grad_hy", "workspace", "has_bias"],
    }.items():
        schema = getattr(torch.ops.aten, name).default._schema
        assert [argument.name for argument in schema.arguments] == arguments


@pytest.mark.parametrize("optimizer", [torch.optim.Adam, torch.optim.AdamW, torch.optim.RMSprop])
def test_networks_that_are_dropped_leave_the_others_as_they_would_have_been(optimizer):
    nets, signals = nets_of("tcn"), torch.randn(3, 5, 60, 2)
    stacks = [stacked(nets), stacked(nets)]
    optimizers = [optimizer(stack.parameters(), lr=1e-2) for stack in stacks]
    for step in range(4):
        for stack, one in zip(stacks, optimizers, strict=True):
            one.zero_grad()
            stack(signals[[0, 2]] if len(stack) == 2 else signals).square().sum().backward()
            one.step()
        if step == 1:
            stacks[1].keep([0, 2], optimizers[1])
            assert len(stacks[1]) == 2
    for whole, part in zip(*(stack.weights for stack in stacks), strict=True):
        assert torch.equal(whole[[0, 2]], part)


def test_a_network_with_running_statistics_is_refused():
    with pytest.raises(InputError, match="seeds"):
        stacked([nn.BatchNorm1d(3)])

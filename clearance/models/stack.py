"""Several networks of one architecture with their weights stacked, as one network."""

from collections.abc import Iterable, Iterator, Sequence
from copy import deepcopy
from typing import Any

import torch
from torch import Tensor, nn
from torch.func import functional_call

from clearance.errors import InputError
from clearance.models.recurrent import RecurrentNetwork
from clearance.models.stepping import Cell, GRUCell, LSTMCell, SteppedLayer

_CELLS: dict[type[nn.Module], Cell] = {nn.LSTM: LSTMCell, nn.GRU: GRUCell}


class NetworkStack(nn.Module):
    """Each weight of M networks is one tensor (M, ...): one optimiser, element by element as M of them.

    The networks compute one after another with the library's layers: on a processor these are busy with
    products already, and batched ones with what lies between them were slower; a convolution fills a GPU.
    """

    def __init__(self, nets: Sequence[nn.Module]) -> None:
        super().__init__()
        if any(True for _ in nets[0].buffers()):
            raise InputError(
                "seeds: a network with running statistics is not trained together with others; set seed"
            )
        states = [dict(net.named_parameters()) for net in nets]
        self._names = list(states[0])
        self.weights = nn.ParameterList(
            nn.Parameter(torch.stack([state[name].detach() for state in states])) for name in self._names
        )
        # What computes without weights of its own; in a list, so that it is no part of this module.
        self._template: list[Any] = [deepcopy(nets[0]).to("meta")]

    def __len__(self) -> int:
        return len(self.weights[0])

    def forward(self, signals: Tensor) -> Tensor:
        """(networks, batch, time, channel) scaled -> (networks, batch, outputs) scaled clearances."""
        each = zip(*(weight.unbind() for weight in self.weights), strict=True)
        return torch.stack(
            [
                functional_call(self._template[0], dict(zip(self._names, own, strict=True)), (windows,))
                for own, windows in zip(each, signals, strict=True)
            ]
        )

    def keep(self, places: Sequence[int], optimizer: torch.optim.Optimizer) -> None:
        """Drop all networks but those at ``places``, and what ``optimizer`` remembers of the others."""
        (group,) = optimizer.param_groups
        for number, old in enumerate(list(self.weights)):
            # A new parameter: autograd may still hold the old one's shape.
            new = nn.Parameter(old.detach()[list(places)])
            memory = optimizer.state.pop(old, {})
            optimizer.state[new] = {
                key: value[list(places)] if torch.is_tensor(value) and value.shape == old.shape else value
                for key, value in memory.items()
            }
            self.weights[number] = group["params"][number] = new

    def resize(self, networks: int) -> None:
        """Become as many networks, of any weights: those of a checkpoint are to follow."""
        for number, old in enumerate(list(self.weights)):
            self.weights[number] = nn.Parameter(old.new_zeros(networks, *old.shape[1:]))

    def states(self, weights: Iterable[Tensor]) -> Iterator[dict[str, Tensor]]:
        """State dictionaries of the networks whose stacked weights are ``weights``."""
        for own in zip(*(weight.unbind() for weight in weights), strict=True):
            yield dict(zip(self._names, own, strict=True))


class RecurrentStack(NetworkStack):
    """Recurrent networks: on a GPU they step through time together."""

    def forward(self, signals: Tensor) -> Tensor:
        """(networks, batch, time, channel) scaled -> (networks, batch, outputs) scaled clearances."""
        return self.stepped(signals) if signals.is_cuda else super().forward(signals)

    def stepped(self, signals: Tensor) -> Tensor:
        """The same, all networks a time step at once."""
        template = self._template[0]
        weights = dict(zip(self._names, self.weights, strict=True))
        states = template.folded(signals).transpose(1, 2)
        cell = _CELLS[type(template.recurrence)]
        for layer in range(template.recurrence.num_layers):
            own = [
                weights[f"recurrence.{name}_l{layer}"]
                for name in ("weight_ih", "weight_hh", "bias_ih", "bias_hh")
            ]
            states = SteppedLayer.apply(cell, states.contiguous(), *own)
        return torch.baddbmm(weights["output.bias"].unsqueeze(1), states[:, -1], weights["output.weight"].mT)


def stacked(nets: Sequence[nn.Module]) -> NetworkStack:
    """The stack for networks of this kind."""
    steps = isinstance(nets[0], RecurrentNetwork) and type(nets[0].recurrence) in _CELLS
    return RecurrentStack(nets) if steps else NetworkStack(nets)


class Replayed:
    """A stack whose forward and backward pass a GPU replays: two launches, not thousands of small ones.

    Recorded at the first batch; one of another size, as an epoch's last may be, is computed as it is.
    """

    def __init__(self, stack: NetworkStack) -> None:
        self._stack = stack
        self._shape: torch.Size | None = None
        self._recorded: Any

    def __call__(self, signals: Tensor) -> Tensor:
        """(networks, batch, time, channel) scaled -> (networks, batch, outputs) scaled clearances."""
        if not signals.is_cuda:
            return self._stack(signals)
        if self._shape is None:
            self._shape = signals.shape
            self._recorded = torch.cuda.make_graphed_callables(_Pass(self._stack), (signals.clone(),))
        return self._recorded(signals) if signals.shape == self._shape else self._stack(signals)


class _Pass(nn.Module):
    """What is recorded: PyTorch replaces its ``forward``, and the stack keeps its own."""

    def __init__(self, stack: NetworkStack) -> None:
        super().__init__()
        self.stack = stack

    def forward(self, signals: Tensor) -> Tensor:
        """As the stack."""
        return self.stack(signals)

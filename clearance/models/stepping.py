"""Recurrent layers of several networks, stepped through time together on a GPU.

The library's own layers (cuDNN) compute one network at a time, and a batch of 64 leaves most of a GPU idle.
Here a time step of all networks is two launches: one batched product, and the library's fused cell.
"""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any, ClassVar

import torch
from torch import Tensor
from torch.autograd.function import once_differentiable

_aten = torch.ops.aten
States = Sequence[Any]  # tensors (rows, hidden) of all networks' batches; None where a gradient is zero


class LSTMCell:
    """Equations (13)-(18); gates in the library's order: input, forget, cell, output."""

    adds_hidden_bias: ClassVar[bool] = False  # both biases go with the input: a launch a step less

    @staticmethod
    def forward(inputs: Tensor, hidden: Tensor, state: States) -> tuple[States, States]:
        """Gates (rows, 4 hidden) of inputs and of the state -> next state, and what ``backward`` needs."""
        output, cell, gates = _aten._thnn_fused_lstm_cell(inputs, hidden, state[1])
        return [output, cell], [state[1], cell, gates]

    @staticmethod
    def backward(gradient: States, saved: States) -> tuple[Tensor, Tensor, States]:
        """Gradients of input gates, of hidden gates, and of the state beside the way through hidden gates."""
        gates, cell, _ = _aten._thnn_fused_lstm_cell_backward_impl(*gradient, *saved, False)
        return gates, gates, [None, cell]


class GRUCell:
    """Equations (19)-(22) with the reset gate after the product; gates: reset, update, new."""

    adds_hidden_bias: ClassVar[bool] = True  # the reset gate multiplies it

    @staticmethod
    def forward(inputs: Tensor, hidden: Tensor, state: States) -> tuple[States, States]:
        """Gates (rows, 3 hidden) of inputs and of the state -> next state, and what ``backward`` needs."""
        output, gates = _aten._thnn_fused_gru_cell(inputs, hidden, state[0])
        return [output], [gates]

    @staticmethod
    def backward(gradient: States, saved: States) -> tuple[Tensor, Tensor, States]:
        """Gradients of input gates, of hidden gates, and of the state beside the way through hidden gates."""
        inputs, hidden, state, _, _ = _aten._thnn_fused_gru_cell_backward(gradient[0], saved[0], False)
        return inputs, hidden, [state]


Cell = type[LSTMCell] | type[GRUCell]


class SteppedLayer(torch.autograd.Function):
    """One layer of M networks: steps (M, time, batch, inputs) -> states (M, time, batch, hidden).

    Weights are the library's with M in front: (M, gates, inputs), (M, gates, hidden), and biases (M, gates).
    What each step needs of the others is in the loop; products over all steps are one each, outside of it.
    """

    @staticmethod
    def forward(
        ctx: Any,
        cell: Cell,
        steps: Tensor,
        from_input: Tensor,
        from_state: Tensor,
        bias: Tensor,
        hidden_bias: Tensor,
    ) -> Tensor:
        """Through time; keeps the gates of every step."""
        models, times, batch, _ = steps.shape
        size = from_state.shape[2]
        outside = bias if cell.adds_hidden_bias else bias + hidden_bias
        with _precision_of_cudnn():
            inputs = torch.baddbmm(outside.unsqueeze(1), steps.flatten(1, 2), from_input.mT)
            # Time first: a step's gates are one piece of memory, as the fused cell wants them.
            inputs = inputs.unflatten(1, (times, batch)).transpose(0, 1).contiguous().flatten(1, 2)
            state: States = [steps.new_zeros(models * batch, size)] * 2
            states, kept = [], []
            for now in inputs:
                before = state[0].unflatten(0, (models, batch))
                if cell.adds_hidden_bias:
                    hidden = torch.baddbmm(hidden_bias.unsqueeze(1), before, from_state.mT)
                else:
                    hidden = torch.bmm(before, from_state.mT)
                state, saved = cell.forward(now, hidden.flatten(0, 1), state)
                states.append(state[0].unflatten(0, (models, batch)))
                kept.append(saved)
        output = torch.stack(states, dim=1)
        ctx.cell, ctx.kept = cell, kept
        ctx.save_for_backward(steps, from_input, from_state, output)
        return output

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, *gradients: Tensor) -> tuple[Tensor | None, ...]:
        """Back through time, then the weights' gradients over all steps at once."""
        steps, from_input, from_state, output = ctx.saved_tensors
        models, times, batch, size = output.shape
        (of_output,) = gradients
        of_inputs: list[Tensor] = []
        of_hidden: list[Tensor] = []
        rest: States = [None, output.new_zeros(models * batch, size)]
        with _precision_of_cudnn():
            for time in reversed(range(times)):
                of_state = of_output[:, time]
                if of_hidden:
                    of_state = torch.baddbmm(of_state, of_hidden[-1], from_state)
                whole = of_state.reshape(models * batch, size)
                if rest[0] is not None:
                    whole = whole + rest[0]
                inputs, hidden, rest = ctx.cell.backward([whole, *rest[1:]], ctx.kept[time])
                of_inputs.append(inputs.unflatten(0, (models, batch)))
                of_hidden.append(hidden.unflatten(0, (models, batch)))
            by_input = torch.stack(of_inputs[::-1], dim=1).flatten(1, 2)  # (models, time * batch, gates)
            by_state = by_input
            if ctx.cell.adds_hidden_bias:
                by_state = torch.stack(of_hidden[::-1], dim=1).flatten(1, 2)
            later = by_state[:, batch:]  # the first step's state is zero
            return (
                None,
                torch.bmm(by_input, from_input).view_as(steps) if ctx.needs_input_grad[1] else None,
                torch.bmm(by_input.mT, steps.flatten(1, 2)),
                torch.bmm(later.mT, output[:, :-1].flatten(1, 2)),
                by_input.sum(1),
                by_state.sum(1),
            )


@contextmanager
def _precision_of_cudnn() -> Iterator[None]:
    """Round products as cuDNN's recurrent layers do, which is not how other products are rounded."""
    products = torch.backends.cuda.matmul
    before, products.allow_tf32 = products.allow_tf32, torch.backends.cudnn.allow_tf32
    try:
        yield
    finally:
        products.allow_tf32 = before

"""Recurrent networks that read a window from first to last step (paper, Sections 3.2.2, 3.2.3 and 4.4.2)."""

from torch import Tensor, nn

from clearance.errors import InputError


class RecurrentNetwork(nn.Module):
    """A recurrent layer stack whose last hidden state is mapped to the clearances.

    Args:
        recurrence: Batch-first stack whose output is (batch, time, hidden).
        hidden_size: Size of its hidden state.
        fold: Consecutive samples that are read as one step. 1 is the paper; with 4, the window is 50 steps
            of 4 samples, which costs a quarter and shortens the way of the gradient.
        length: Time steps of the input.
        outputs: Clearances that are estimated.
    """

    def __init__(self, recurrence: nn.Module, hidden_size: int, fold: int, length: int, outputs: int) -> None:
        super().__init__()
        if fold < 1 or length % fold:
            raise InputError(
                f"model.net.fold={fold}: must divide the window of {length} samples; set model.net.fold"
            )
        self.fold = fold
        self.recurrence = recurrence
        self.output = nn.Linear(hidden_size, outputs)

    def forward(self, signals: Tensor) -> Tensor:
        """(batch, time, channel) scaled -> (batch, outputs) scaled clearances."""
        states, _ = self.recurrence(self.folded(signals))
        return self.output(states[:, -1])

    def folded(self, signals: Tensor) -> Tensor:
        """(..., time, channel) -> (..., time / fold, fold * channel): samples that are read as one step."""
        return signals.unflatten(-2, (-1, self.fold)).flatten(-2)


class LSTM(RecurrentNetwork):
    """Long short-term memory, equations (13)-(18) input gate a sigmoid; two layers of 256 in the paper."""

    def __init__(
        self,
        channels: int,
        length: int,
        outputs: int,
        hidden_size: int = 256,
        layers: int = 2,
        fold: int = 1,
    ) -> None:
        recurrence = nn.LSTM(channels * fold, hidden_size, layers, batch_first=True)
        super().__init__(recurrence, hidden_size, fold, length, outputs)


class GRU(RecurrentNetwork):
    """Gated recurrent unit, equations (19)-(22); three layers of 256 in the paper.

    The library applies the reset gate after the matrix product, equation (21) before it.
    """

    def __init__(
        self,
        channels: int,
        length: int,
        outputs: int,
        hidden_size: int = 256,
        layers: int = 3,
        fold: int = 1,
    ) -> None:
        recurrence = nn.GRU(channels * fold, hidden_size, layers, batch_first=True)
        super().__init__(recurrence, hidden_size, fold, length, outputs)

"""What `train` and `predict` need of any model, neural or shallow."""

from pathlib import Path
from typing import Protocol

import numpy as np

from clearance.models.run_folder import RunFolder
from clearance.windows.datamodule import WindowData
from clearance.windows.window_set import WindowSet


class Estimator(Protocol):
    """Maps scaled windows to scaled clearances."""

    @property
    def parameters(self) -> int:
        """Numbers that training has set: weights, or nodes of trees."""
        ...

    @property
    def processors(self) -> tuple[int | None, bool]:
        """Threads that compute it, where these are set, and whether a GPU does where there is one."""
        ...

    def check(self, data: WindowData) -> None:
        """Refuse sensors, windows and targets that the model cannot read; ``data`` need not be set up.

        Raises:
            InputError: it cannot.
        """
        ...

    def check_devices(self) -> None:
        """Refuse what shall compute a training and is not there.

        Raises:
            InputError: it is not.
        """
        ...

    def fit(self, data: WindowData, run: RunFolder) -> float:
        """Train on the training windows, choosing by the validation windows; return the seconds it took."""
        ...

    def begin(self, folder: Path) -> None:
        """Let ``fit`` go on from what ``save`` left in the folder of another training.

        Raises:
            InputError: a model that cannot, or weights of another one.
        """
        ...

    def predict(self, windows: WindowSet) -> np.ndarray:
        """Scaled clearances (windows, targets), float64."""
        ...

    def save(self, folder: Path) -> None:
        """Write what ``load`` needs, atomically and as plain data."""
        ...

    def load(self, folder: Path) -> None:
        """Become what was saved; runs no code from the files."""
        ...

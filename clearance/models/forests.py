"""Ensembles of trees on flattened windows (paper, Sections 3.1 and 4.3, Table 4)."""

import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import xgboost
from joblib import effective_n_jobs
from safetensors import SafetensorError
from safetensors.numpy import load_file, save_file
from sklearn.ensemble import RandomForestRegressor

from clearance.errors import InputError
from clearance.mechanism.parameters import require
from clearance.models.run_folder import RunFolder
from clearance.whole_files import write_atomically
from clearance.windows.datamodule import WindowData
from clearance.windows.window_set import WindowSet

_ROWS = 2048  # windows at a time: bounds the memory to 2048 x trees nodes


@dataclass(frozen=True)
class Trees:
    """Binary trees as plain arrays: what a file of numbers can hold, and a few lines can evaluate.

    Arrays are (nodes,) where nothing else is said, the trees one after another; a leaf is its own child on
    both sides.
    """

    left: np.ndarray
    right: np.ndarray
    feature: np.ndarray
    threshold: np.ndarray  # of the feature; not above it goes left
    value: np.ndarray  # (nodes, targets) of a leaf
    roots: np.ndarray  # (trees,) first node of each
    depth: np.ndarray  # (1,) of the deepest

    @classmethod
    def of(cls, forest: RandomForestRegressor) -> "Trees":
        """Copy a fitted forest."""
        trees = [tree.tree_ for tree in forest.estimators_]
        roots = np.cumsum([0] + [tree.node_count for tree in trees])
        children = []
        for side in ("children_left", "children_right"):
            parts = [getattr(t, side) + root for t, root in zip(trees, roots[:-1], strict=True)]
            leaf = np.concatenate([t.children_left < 0 for t in trees])
            children.append(np.where(leaf, np.arange(roots[-1]), np.concatenate(parts)))
        return cls(
            left=children[0],
            right=children[1],
            feature=np.concatenate([np.maximum(t.feature, 0) for t in trees]),
            threshold=np.concatenate([t.threshold for t in trees]),
            value=np.concatenate([t.value[:, :, 0] for t in trees]),
            roots=roots[:-1],
            depth=np.array([max(t.max_depth for t in trees)]),
        )

    def __post_init__(self) -> None:
        if self.value.ndim != 2:
            raise ValueError("value is not (nodes, targets)")
        nodes = len(self.value)
        if any(len(getattr(self, name)) != nodes for name in ("left", "right", "feature", "threshold")):
            raise ValueError("arrays are not one entry a node")
        if self.depth.shape != (1,) or not 0 <= self.depth[0] <= nodes:
            raise ValueError("no depth that these trees could have")
        if self.feature.dtype != np.int64 or self.feature.min() < 0:
            raise ValueError("feature does not point at features")
        for name in ("left", "right", "roots"):
            index = getattr(self, name)
            if index.dtype != np.int64 or index.size == 0 or index.min() < 0 or index.max() >= nodes:
                raise ValueError(f"{name} does not point at nodes")

    def predict(self, rows: np.ndarray) -> np.ndarray:
        """Mean of the trees for (windows, features): (windows, targets).

        Raises:
            InputError: trees of other, larger windows.
        """
        if self.feature.max() >= rows.shape[1]:
            raise InputError(
                f"model.safetensors: trees of {self.feature.max() + 1} features or more, where windows have "
                f"{rows.shape[1]}; set checkpoint"
            )
        return np.concatenate(
            [self._predict(part) for part in np.array_split(rows, -(-len(rows) // _ROWS) or 1)]
        )

    def _predict(self, rows: np.ndarray) -> np.ndarray:
        node = np.repeat(self.roots[None, :], len(rows), axis=0)  # (windows, trees)
        window = np.arange(len(rows))[:, None]
        for _ in range(int(self.depth[0])):
            goes_left = rows[window, self.feature[node]] <= self.threshold[node]
            node = np.where(goes_left, self.left[node], self.right[node])
        return self.value[node].mean(axis=1)


class RandomForest:
    """Random forest, equation (10).

    A forest is not resumed after a kill: it starts anew, and gives the same trees.

    Args:
        trees: Number of trees.
        depth: Largest depth.
        features: Share of the features that each split considers; 1.0 is the paper's library default.
        jobs: Threads; -1 takes ``trainer.threads`` or, where that is null, all cores.
    """

    def __init__(self, trees: int = 100, depth: int = 20, features: float = 1.0, jobs: int = -1) -> None:
        require(self, 1, 100_000, whole=True, trees=trees, depth=depth)
        require(self, 0.0, 1.0, strict=True, features=features)
        require(self, -1, 1024, whole=True, jobs=jobs)
        if jobs == 0:
            raise InputError("model.jobs = 0: must be -1 (all cores) or 1 ... 1024; set model.jobs")
        self._settings = {"n_estimators": trees, "max_depth": depth, "max_features": features, "n_jobs": jobs}
        self.trees: Trees

    @property
    def parameters(self) -> int:
        """Nodes of all trees."""
        return len(self.trees.value)

    @property
    def processors(self) -> tuple[int | None, bool]:
        """Threads of the processor."""
        return effective_n_jobs(self._settings["n_jobs"]), False

    def check(self, data: WindowData) -> None:
        """Nothing: trees read windows of any shape."""

    def check_devices(self) -> None:
        """Nothing: processors are there."""

    def begin(self, folder: Path) -> None:
        """Refused: trees do not go on from others."""
        raise _refusal(folder)

    def fit(self, data: WindowData, run: RunFolder) -> float:
        """Grow the trees on the training windows; nothing is chosen on validation windows."""
        windows = data.training_windows()
        if self._settings["n_jobs"] == -1:
            self._settings["n_jobs"] = _threads_of(run) or -1
        begin = time.perf_counter()
        forest = RandomForestRegressor(**self._settings, random_state=run.seed)
        target = windows.target.squeeze(1)  # of one target the library wants no column
        self.trees = Trees.of(forest.fit(windows.flattened(), target.numpy()))
        return time.perf_counter() - begin

    def predict(self, windows: WindowSet) -> np.ndarray:
        """Mean of the trees."""
        return self.trees.predict(windows.flattened())

    def save(self, folder: Path) -> None:
        """Write ``model.safetensors``: the trees' arrays."""
        write_atomically(folder / "model.safetensors", lambda file: save_file(vars(self.trees), file))

    def load(self, folder: Path) -> None:
        """Read ``model.safetensors``."""
        path = folder / "model.safetensors"
        try:
            self.trees = Trees(**load_file(path))
        except (OSError, SafetensorError, TypeError, ValueError) as error:
            raise InputError(f"{path}: not a random forest ({error}); set checkpoint") from error


class GradientBoosting:
    """XGBoost, equation (11); of several targets each has trees of its own.

    It takes ``trainer.threads`` or, where that is null, as many as OpenMP gives it.

    Args:
        rounds: Number of trees.
        depth: Largest depth.
        learning_rate: Weight of each tree [-].
        device: ``cpu`` or ``cuda``.
    """

    def __init__(
        self, rounds: int = 300, depth: int = 20, learning_rate: float = 0.01, device: str = "cpu"
    ) -> None:
        require(self, 1, 100_000, whole=True, rounds=rounds, depth=depth)
        require(self, 0.0, 1.0, strict=True, learning_rate=learning_rate)
        if device not in ("cpu", "cuda"):
            raise InputError(f"model.device={device}: must be cpu or cuda; set model.device")
        self._rounds = rounds
        self._threads: int | None = None
        self._settings = {
            "max_depth": depth,
            "learning_rate": learning_rate,
            "device": device,
            "tree_method": "hist",
            # Histograms of parents, kept to save work: all of a deep tree's take 14 GB on 800 features.
            "max_cached_hist_node": 64,
        }
        self.model: xgboost.Booster

    @property
    def parameters(self) -> int:
        """Nodes of all trees."""
        return sum(tree.count("\n") for tree in self.model.get_dump())

    @property
    def processors(self) -> tuple[int | None, bool]:
        """Threads, of which the library takes as many as torch unless told, and whether a GPU computes."""
        return self._threads, self._settings["device"] == "cuda"

    def check(self, data: WindowData) -> None:
        """Nothing: trees read windows of any shape."""

    def check_devices(self) -> None:
        """Refuse a GPU that the library cannot use."""
        if self._settings["device"] == "cuda" and not xgboost.build_info()["USE_CUDA"]:
            raise InputError(
                "model.device=cuda: this XGBoost computes on processors alone (pip install xgboost in place "
                "of xgboost-cpu); set model.device=cpu"
            )

    def begin(self, folder: Path) -> None:
        """Refused: trees do not go on from others."""
        raise _refusal(folder)

    def fit(self, data: WindowData, run: RunFolder) -> float:
        """Add the trees one by one; the validation loss of each is logged and chooses nothing."""
        train, validation = data.training_windows(), data.validation_windows()
        self._threads = _threads_of(run)
        begin = time.perf_counter()
        matrices = {
            name: xgboost.DMatrix(part.flattened(), part.target.numpy(), nthread=self._threads)
            for name, part in (("train", train), ("val", validation))
        }
        history: dict[str, dict[str, list[float]]] = {}
        self.model = xgboost.train(
            {**self._settings, "nthread": self._threads or 0, "seed": run.seed},
            matrices["train"],
            self._rounds,
            evals=[(matrix, name) for name, matrix in matrices.items()],
            evals_result=history,
            verbose_eval=False,
        )
        for name, curve in history.items():
            for step, value in enumerate(curve["rmse"]):
                run.logger.log_metrics({f"{name}/rmse": float(value)}, step)
        return time.perf_counter() - begin

    def predict(self, windows: WindowSet) -> np.ndarray:
        """Sum of the trees."""
        matrix = xgboost.DMatrix(windows.flattened(), nthread=self._threads)
        found = self.model.predict(matrix).astype(np.float64)
        return found.reshape(len(windows), -1)  # of one target the library gives no column

    def save(self, folder: Path) -> None:
        """Write ``model.ubj``, XGBoost's own format of numbers."""
        write_atomically(folder / "model.ubj", lambda file: file.write_bytes(self.model.save_raw("ubj")))

    def load(self, folder: Path) -> None:
        """Read ``model.ubj``."""
        path = folder / "model.ubj"
        self.model = xgboost.Booster()
        try:
            self.model.load_model(bytearray(path.read_bytes()))
        except (OSError, xgboost.core.XGBoostError) as error:
            reason = str(error).strip().splitlines()[0]
            raise InputError(f"{path}: not an XGBoost model ({reason}); set checkpoint") from error


def _threads_of(run: RunFolder) -> int | None:
    """What ``trainer.threads`` says: trees have no part in the rest of it."""
    threads: int | None = run.config.get("trainer", {}).get("threads")
    return threads


def _refusal(folder: Path) -> InputError:
    return InputError(
        f"begin={folder}: trees do not go on from others; set begin=null, or model to a network"
    )

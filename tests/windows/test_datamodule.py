import numpy as np
import pytest
import torch

from clearance.errors import InputError
from clearance.windows.datamodule import WindowData
from clearance.windows.splitting import RandomSplit
from clearance.windows.windowing import RandomWindows, RegularWindows


def make(source, windows=None, **kwargs):
    data = WindowData(
        source,
        ("a", "b"),
        ("clearance_c",),
        RandomSplit(42),
        windows or RegularWindows(50, 50),
        batch_size=16,
        **kwargs,
    )
    data.setup()
    return data


def test_no_recording_is_on_two_sides(chirps):
    data = make(chirps())
    sides = [
        set(part.recording.tolist())
        for part in (data.training_windows(), data.validation_windows(), data.test_windows())
    ]
    assert sum(map(len, sides)) == len(set.union(*sides)) == 20


def test_scalers_see_training_recordings_only(chirps):
    def spoil(recordings, parts):
        for index in np.concatenate([parts.validation, parts.test]):
            recordings.recording(index)[:] = 1e6
        recordings.target[parts.test] = 0.5

    plain = make(chirps())
    source = chirps()
    source.spoil = spoil
    assert make(source).scalers == plain.scalers


def test_a_batch_is_the_windows_it_names(chirps):
    data = make(chirps())
    windows = data.test_windows()
    batch = windows[torch.tensor([3, 0])]
    start = int(windows.starts[3])
    assert batch.signals.shape == (2, 50, 2)
    assert torch.equal(batch.signals[0], torch.from_numpy(data.recordings.signals[start : start + 50]))
    rows = windows.flattened()
    assert np.array_equal(rows[3], batch.signals[0].numpy().ravel())


def test_targets_follow_their_recording(chirps):
    data = make(chirps())
    windows = data.training_windows()
    metres = data.scalers.target.inverse(windows.target.double().numpy())
    truth = data.recordings.target[windows.recording.numpy()]
    assert np.allclose(metres, truth, atol=1e-9)  # single precision of 1 mm


def test_order_depends_on_seed_and_epoch_alone(chirps):
    one, two = make(chirps(), RandomWindows(50)), make(chirps(), RandomWindows(50))
    assert torch.equal(one.training_windows(3).starts, two.training_windows(3).starts)
    assert not torch.equal(one.training_windows(3).starts, one.training_windows(4).starts)
    other = make(chirps(), RandomWindows(50), seed=7)
    assert not torch.equal(one.training_windows(3).starts, other.training_windows(3).starts)
    orders = [[int(i) for batch in data.training_order(64, 0) for i in batch] for data in (one, two, other)]
    assert orders[0] == orders[1] != orders[2]


def test_a_loader_gives_every_window_once(chirps):
    data = make(chirps())
    seen = torch.cat([batch.signals for batch in data.train_dataloader()]).flatten(1).numpy()
    every = data.training_windows().flattened()
    np.testing.assert_array_equal(seen[np.lexsort(seen.T)], every[np.lexsort(every.T)])


def test_recordings_shorter_than_a_window_are_refused(chirps):
    with pytest.raises(InputError, match="at least 5000"):
        make(chirps(), RegularWindows(5000, 5000))


def test_reading_twice_does_not_scale_twice(chirps):
    data = make(chirps())
    before = data.recordings.signals.copy()
    data.setup()
    assert np.array_equal(before, data.recordings.signals)

"""What a model leaves unexplained: is it noise, or does it come back with the crank's angle?"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import f as f_distribution

from clearance.diagnosis.motion.fit import Fit
from clearance.diagnosis.motion.track import Track

_HARMONICS = 12  # of the crank's angle
_DRIFTS = 3  # powers of time that a residual may follow besides
_SHARE = 0.1  # free numbers to a sample, at most
_FALSE_ALARMS = 1e-3
_NEXT_TO_NOTHING, _SLIGHT = 0.05, 2.0  # of the mismatch; of the noise, at most
_MATERIAL = 1.05  # a residual that is larger than noise by less is as good as noise


@dataclass(frozen=True)
class Explained:
    """A model's residuals beside the noise under them.

    Attributes:
        channels: names.
        noise: (channels,) what stays when any periodic function of the crank's angle and any slow drift are
            taken out.
        level: (channels,) root mean square of the residuals over that noise.
        p_value: (channels,) of so large a level if the residuals were white noise.
    """

    channels: tuple[str, ...]
    noise: np.ndarray
    level: np.ndarray
    p_value: np.ndarray

    @property
    def structured(self) -> np.ndarray:
        """(channels,) whether more than noise is left."""
        return np.asarray((self.level > _MATERIAL) & (self.p_value < _FALSE_ALARMS / len(self.channels)))

    @property
    def enough(self) -> bool:
        """Whether nothing but noise is left."""
        return not bool(self.structured.any())


def nearly_all(before: float, after: float) -> bool:
    """Whether errors over the noise fell by nearly all that was missing, and are small."""
    return after <= _SLIGHT and after - 1.0 <= _NEXT_TO_NOTHING * max(before - 1.0, 1e-9)


def angles(fit: Fit, tracks: Sequence[Track]) -> list[np.ndarray]:
    """The crank's angle [rad] at every judged sample of each recording, as the model has it."""
    from clearance.diagnosis.motion.prediction import predict

    found = []
    for r, track in enumerate(tracks):
        guess = fit.model.guess(fit.shared, fit.own[r])
        assert guess is not None
        bare = Track(track.name, np.zeros((len(track.values), 1)), ("crank_angle",), track.rate)
        zero = guess.instrument.bias.get("crank_angle", 0.0)
        found.append(predict(bare, [guess])[0, track.judged, 0] - zero)
    return found


def explained(fit: Fit, tracks: Sequence[Track]) -> Explained:
    """Compare residuals with the noise that no free form of the angle could take away.

    The free form of each channel and recording: harmonics of the crank's angle and powers of time, as many as
    a tenth of the samples allows; of a recording in stretches the harmonics are the same in all, the powers
    each one's own. Its gain is judged by the F test.
    """
    channels = tuple(dict.fromkeys(c for t in tracks for c in t.channels))
    turned = angles(fit, tracks)
    noise, level, p_value = np.ones(len(channels)), np.ones(len(channels)), np.ones(len(channels))
    recordings = [
        [r for r, track in enumerate(tracks) if track.name == name]
        for name in dict.fromkeys(track.name for track in tracks)
    ]
    bases = [free_form([turned[r] for r in stretches]) for stretches in recordings]
    for i, channel in enumerate(channels):
        whole, free, freedom, numbers = 0.0, 0.0, 0, 0
        for stretches, basis in zip(recordings, bases, strict=True):
            if channel not in tracks[stretches[0]].channels:
                continue
            place = tracks[stretches[0]].channels.index(channel)
            values = np.concatenate([fit.residuals[r][:, place] for r in stretches])
            weights, *_ = np.linalg.lstsq(basis, values, rcond=None)
            whole += float((values**2).sum())
            free += float(((values - basis @ weights) ** 2).sum())
            freedom += len(values) - basis.shape[1]
            numbers += basis.shape[1]
        least = max(t.smallest[t.channels.index(channel)] for t in tracks if channel in t.channels)
        samples = freedom + numbers
        floor = max(free / freedom, least**2, 1e-300)
        noise[i], level[i] = np.sqrt(floor), np.sqrt(whole / samples / floor)
        ratio = max(whole - free, 0.0) / numbers / floor
        p_value[i] = float(f_distribution.sf(ratio, numbers, freedom))
    return Explained(channels, noise, level, p_value)


def free_form(angles: Sequence[np.ndarray]) -> np.ndarray:
    """(samples, numbers) harmonics of the angle and powers of time, as many as the samples allow.

    Args:
        angles: of each stretch of a recording [rad].
    """
    angle = np.concatenate(angles)
    most = int(_SHARE * len(angle))
    time = np.linspace(-1.0, 1.0, len(angle))
    powers = _DRIFTS + 1 if len(angles) == 1 else 1
    columns = [
        column for one, place in zip(angles, np.cumsum([0, *map(len, angles)]), strict=False)
        for column in _drifts(len(one), place, len(angle), powers)
    ]  # fmt: skip
    for k in range(1, _HARMONICS + 1):
        if len(columns) + 2 > most:
            break
        columns += [np.cos(k * angle), np.sin(k * angle)]
    for k in range(1, 4):
        if len(columns) + 2 > most:
            break
        columns += [time * np.cos(k * angle), time * np.sin(k * angle)]
    return np.stack(columns, axis=1)


def _drifts(samples: int, place: int, total: int, powers: int) -> list[np.ndarray]:
    """Powers of time in one stretch, 0 in the others."""
    time, found = np.linspace(-1.0, 1.0, samples), []
    for k in range(powers):
        column = np.zeros(total)
        column[place : place + samples] = time**k
        found.append(column)
    return found

"""A recording as the estimator sees it: cut into segments, with its filter and its noise."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from zlib import crc32

import numpy as np

from clearance.diagnosis.sensing.instrument import OTHER_AXIS, Instrument
from clearance.diagnosis.sensing.noise import limit, noise_level, still
from clearance.diagnosis.sensing.tolerances import HALF, NOTHING_LEFT_OPEN, Tolerances
from clearance.errors import InputError
from clearance.recording.chain import MeasurementChain, declared_chain
from clearance.recording.channels import CHANNELS
from clearance.recording.recording import SAME_RATE, Recording
from clearance.simulation.layout import Signal

REACH = 4  # segments to each side whose motion enters a filtered sample
SAMPLES = 10  # a segment
NO_FAULT = Instrument()
_DEAF = 1e4
_LEAST, _ADDED = 1e-4, 0.01
"""Shares of a channel's standard deviation: noise below which no sensor made a recording, and the
noise that is added there, so that errors of the simulator do not pass for something missing."""
_AROUND = 8  # segments on each side: what undoing a delay or a resonance needs
_PACE = {  # power of the clock's unit of time in a channel; 2 for accelerations and torques
    Signal.CRANK_ANGLE: 0.0, Signal.CRANK_SPEED: 1.0, Signal.SLIDER_POSITION: 0.0, Signal.SLIDER_VELOCITY: 1.0
}  # fmt: skip
_SIGNAL_OF = {signal.name.lower(): int(signal) for signal in Signal}


def filter_weights(chain: MeasurementChain, samples: int, reach: int) -> np.ndarray:
    """((2 reach + 1) samples, base samples) of one segment's motion in the filtered samples around it."""
    factor = chain.decimation
    length = (reach + 2) * samples
    impulses = np.zeros((2 * length * factor, factor))
    impulses[length * factor + np.arange(factor), np.arange(factor)] = 1.0
    response = chain.apply(impulses)
    weights = np.zeros(((2 * reach + 1) * samples, samples * factor))
    for row in range(len(weights)):
        for sample in range(samples):
            weights[row, sample * factor : (sample + 1) * factor] = response[
                length + row - reach * samples - sample
            ]
    for sample in range(samples):  # what is cut off must not change the gain at zero frequency
        weights[sample::samples] /= weights[sample::samples].sum()
    return weights


def pace(signals: Iterable[int], instrument: Instrument) -> np.ndarray:
    """(signals,) by which a wrong clock divides: rates and accelerations are counted in its seconds."""
    found: np.ndarray = (1.0 + instrument.timebase) ** np.array([_PACE.get(Signal(s), 2.0) for s in signals])
    return found


@dataclass(frozen=True)
class Measured:
    """A recording in segments.

    Attributes:
        name: of the recording.
        values: (segments, samples, channels).
        recorded: (samples, channels) of the whole recording that it is a part of.
        first: segment of the whole where it begins.
        channels: their names, accelerations first.
        signals: (channels,) rows of ``Signal``.
        sigma: (channels,) standard deviation of the noise.
        chain: the filter it went through.
        weights: see ``filter_weights``.
        limits: (channels,) at which each stops, see ``limit``; infinite where it does not.
        silent: channels that were left out because they are constant, or stuck for a time.
        noiseless: whether its accelerations had no noise to speak of, as simulations have none: some was
            added.
        clock: what a clock that all recordings share shows where the whole recording begins [s].
        period: after which something repeats by that clock, and which is followed whole [s]; 0: nothing does.
        tolerances: within which its accelerometers may be off.
        sensors: what they were found to do within these, undone in ``values``, ``recorded`` and ``sigma``.
        covariance: of that, as ``Tolerances.open`` lists it; what they are not known to do counts as noise.
        raw: ``recorded`` and ``sigma`` before that; ``None`` where nothing was undone.
    """

    name: str
    values: np.ndarray
    recorded: np.ndarray
    first: int
    channels: tuple[str, ...]
    signals: tuple[int, ...]
    sigma: np.ndarray
    chain: MeasurementChain
    weights: np.ndarray
    limits: np.ndarray
    silent: tuple[str, ...] = ()
    noiseless: bool = False
    clock: float = 0.0
    period: float = 0.0
    tolerances: Tolerances = NOTHING_LEFT_OPEN
    sensors: Instrument = NO_FAULT
    covariance: np.ndarray | None = None
    raw: tuple[np.ndarray, np.ndarray] | None = None

    @staticmethod
    def of(recording: Recording, chain: MeasurementChain, name: str, held_out: float = 0.0) -> "Measured":
        """Cut a recording; its last incomplete segment is left out.

        Args:
            recording: with at least one channel that the mechanism has.
            chain: that it came through.
            name: of it.
            held_out: share at its end, by which is judged: neither noise nor limits are taken from there.
        """
        known = [c for c in CHANNELS if c in recording.channels and c in _SIGNAL_OF]
        if not known:
            raise InputError(f"{name}: none of its channels is one that the mechanism has")
        values = recording.values[:, [recording.channels.index(c) for c in known]]
        segments = len(values) // SAMPLES
        if segments < 2 * REACH + 8:
            raise InputError(
                f"{name}: {len(values)} samples are too few to follow; "
                f"give at least {(2 * REACH + 8) * SAMPLES}"
            )
        told = values[: SAMPLES * segments_before(len(values), held_out)]
        alive = [i for i, channel in enumerate(known) if not still(channel, told[:, i], recording.rate)]
        if not alive:
            raise InputError(
                f"{name}: every channel is constant, or stuck for a time; check the sensors or the columns' "
                "names"
            )
        silent = tuple(c for i, c in enumerate(known) if i not in alive)
        known, values, told = [known[i] for i in alive], values[:, alive], told[:, alive]
        signals = tuple(_SIGNAL_OF[c] for c in known)
        limits = np.array([
            limit(told[:, i]) if s < Signal.CRANK_ANGLE else np.inf for i, s in enumerate(signals)
        ])  # fmt: skip
        sigma = np.array([noise_level(told[:, i], s, limits[i]) for i, s in enumerate(signals)])
        cut = values[: segments * SAMPLES].reshape(segments, SAMPLES, len(known))
        weights = filter_weights(chain, SAMPLES, REACH)
        return Measured(
            name, cut, cut.reshape(-1, len(known)), 0, tuple(known), signals, sigma, chain, weights, limits,
            silent,
        )  # fmt: skip

    def noised(self) -> "Measured":
        """The same recording, with noise if its accelerations have none, as simulations have none.

        Otherwise errors of integrators, this one's and that of the simulation, would count as something
        missing. Those get some that have less than any sensor, and all where most have; the same as often as
        it is asked for.
        """
        size, accelerations = self.recorded.std(axis=0), np.array(self.signals) < Signal.CRANK_ANGLE
        quiet = accelerations & (self.sigma < _LEAST * size)
        if not quiet.any():
            return self
        chosen = accelerations if 2 * quiet.sum() > accelerations.sum() else quiet
        added = np.where(chosen, _ADDED * np.maximum(size, np.median(size[accelerations])), 0.0)
        random = np.random.default_rng(crc32(self.recorded.tobytes()))
        noise = added * random.normal(size=self.recorded.shape)
        recorded = self.recorded + np.where(np.abs(self.recorded) < self.limits, noise, 0.0)
        sigma = np.hypot(self.sigma, added)
        return replace(self, values=self._cut(recorded), recorded=recorded, sigma=sigma, noiseless=True)

    def within(self, tolerances: Tolerances) -> "Measured":
        """The same recording by accelerometers that are not known better than this.

        Until they are calibrated what they may be off by counts as noise.
        """
        what = tolerances.open(self.channels)
        if not what:
            return self
        covariance = np.diag([(HALF * one.tolerance) ** 2 for one in what])
        wide = replace(self, tolerances=tolerances)
        return replace(wide, sigma=wide._doubted(covariance), raw=(self.recorded, self.sigma))

    def _doubted(self, covariance: np.ndarray) -> np.ndarray:
        """(channels,) noise, with what is not known of the accelerometers: on average over the recording."""
        what, found = self.tolerances.open(self.channels), self.sigma**2
        rates = np.gradient(self.recorded, 1.0 / self.chain.rate, axis=0)
        for place, channel in enumerate(self.channels):
            own = [i for i, one in enumerate(what) if one.channel == channel]
            across, sign = OTHER_AXIS.get(channel, ("", 0.0))
            other = sign * self.recorded[:, self.channels.index(across)] if across in self.channels else 0.0
            felt = {
                "gain": self.recorded[:, place], "misalignment": np.radians(other), "delay": -rates[:, place]
            }  # fmt: skip
            rows = np.ones((len(own), len(rates)))
            for row, i in enumerate(own):
                rows[row] = felt.get(what[i].fault, 1.0)
            found[place] += (covariance[np.ix_(own, own)] * (rows @ rows.T)).sum() / len(rates)
        return np.sqrt(found)

    @property
    def widened(self) -> float:
        """How much larger its noise is taken than it is, while its accelerometers are not surely known."""
        return 1.0 if self.raw is None else float((self.sigma / self.raw[1]).max())

    def calibrated(self, sensors: Instrument, covariance: np.ndarray | None = None) -> "Measured":
        """The same recording with what its accelerometers were found to do undone, and nothing else.

        Args:
            sensors: what they do.
            covariance: of that, as ``Tolerances.open`` lists it; counts as noise.
        """
        plain = self.as_recorded()
        if sensors == NO_FAULT and covariance is None:
            return plain
        whole, _ = sensors.correct(plain.recorded, self.channels, self.chain.rate)
        sigma, raw = sensors.noise(plain.sigma, self.channels, self.chain.rate), (plain.recorded, plain.sigma)
        found = replace(self, values=self._cut(whole), recorded=whole, sigma=sigma, sensors=sensors, raw=raw)
        if covariance is None:
            return replace(found, covariance=None)
        return replace(found, sigma=found._doubted(covariance), covariance=covariance)

    def judged(self, sensors: Instrument) -> "Measured":
        """Likewise, and nothing is left open any more: what was held out must not calibrate."""
        return replace(self.calibrated(sensors), tolerances=NOTHING_LEFT_OPEN)

    def as_recorded(self) -> "Measured":
        """The same recording as its accelerometers made it."""
        if self.raw is None:
            return self
        recorded, sigma = self.raw
        values = self._cut(recorded)
        known = replace(self, sensors=NO_FAULT, covariance=None, raw=None)
        return replace(known, values=values, recorded=recorded, sigma=sigma)

    def around(self) -> "Measured":
        """The same part, of a recording that hardly goes beyond it: there is less to correct."""
        begin = max(self.first - _AROUND, 0)
        recorded = self.recorded[begin * SAMPLES : (self.first + len(self.values) + _AROUND) * SAMPLES]
        clock = self.clock + begin * self.segment
        return replace(self, recorded=recorded, first=self.first - begin, clock=clock)

    def _cut(self, whole: np.ndarray) -> np.ndarray:
        """(segments, samples, channels) of this part."""
        first = self.first * SAMPLES
        return whole[first : first + self.values[..., 0].size].reshape(self.values.shape)

    def part(self, first: int, last: int) -> "Measured":
        """Segments ``first`` to ``last`` alone."""
        return replace(self, values=self.values[first:last], first=self.first + first)

    def without(self, channel: str) -> "Measured":
        """The same recording as if a channel's noise were so large that it says nothing."""
        deaf = np.where(np.array(self.channels) == channel, _DEAF, 1.0)
        raw = None if self.raw is None else (self.raw[0], self.raw[1] * deaf)
        return replace(self, sigma=self.sigma * deaf, raw=raw)

    def less(self, first: int, residual: np.ndarray, instrument: Instrument) -> "Measured":
        """The same recording with a part of what faultless instruments would have recorded taken away.

        Args:
            first: segment where the part begins.
            residual: (segments, samples, channels), of ``restored``'s values.
            instrument: through which it was seen.
        """
        whole = np.zeros_like(self.recorded)
        begin = (self.first + first) * SAMPLES
        flat = residual.reshape(-1, residual.shape[2])
        whole[begin : begin + len(flat)] = flat / pace(self.signals, instrument)

        def taken(recorded: np.ndarray, through: Instrument) -> np.ndarray:
            seen = replace(through, bias={}, saturation={}, timebase=0.0)
            return recorded - seen.apply(whole, self.channels, self.chain.rate)

        values = self.values.copy()
        values[first : first + len(residual)] -= residual
        raw = self.raw and (taken(self.raw[0], self.sensors.beside(instrument)), self.raw[1])
        return replace(self, values=values, recorded=taken(self.recorded, instrument), raw=raw)

    def seen(self, faultless: np.ndarray, instrument: Instrument) -> np.ndarray:
        """What instruments make of what faultless ones would have recorded: ``restored`` backwards.

        Args:
            faultless: (segments, samples, channels), by the samples of the recorder's own clock.
            instrument: what they do.
        """
        counted = faultless.reshape(-1, faultless.shape[2]) / pace(self.signals, instrument)
        own, rate = replace(instrument, timebase=0.0), self.chain.rate
        if self.sensors == NO_FAULT:
            return own.apply(counted, self.channels, rate).reshape(faultless.shape)
        recorded = self.sensors.beside(own).apply(counted, self.channels, rate)
        return self.sensors.correct(recorded, self.channels, rate)[0].reshape(faultless.shape)

    def restored(self, instrument: Instrument) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """What faultless instruments would have recorded.

        What accelerometers do within their tolerances and a fault are undone as one: neither comes first.

        Returns:
            (segments, samples, channels) values, (channels,) standard deviation of their noise, and
            (segments, samples, channels) whether a value is known.
        """
        if instrument == NO_FAULT:
            return self.values, self.sigma, np.ones(self.values.shape, dtype=bool)
        counted = pace(self.signals, instrument)
        if self.raw is None:
            whole, known = instrument.correct(self.recorded, self.channels, self.chain.rate)
            sigma = instrument.noise(self.sigma, self.channels, self.chain.rate) * counted
            return self._cut(whole * counted), sigma, self._cut(known)
        both, plain = self.sensors.beside(instrument), self.as_recorded()
        whole, known = both.correct(plain.recorded, self.channels, self.chain.rate)
        own, other = (one.noise(plain.sigma, self.channels, self.chain.rate) for one in (self.sensors, both))
        sigma = np.sqrt(other**2 + np.maximum(self.sigma**2 - own**2, 0.0)) * counted
        return self._cut(whole * counted), sigma, self._cut(known)

    def moved(self, before: Instrument, after: Iterable[Instrument]) -> Iterator[np.ndarray]:
        """By which ``restored`` values differ from one instrument to each of others.

        Only channels that they treat differently are looked at, and what these mix with.

        Yields:
            (segments, samples, channels).
        """
        recorded, rate = self.recorded if self.raw is None else self.raw[0], self.chain.rate
        one = self.sensors.beside(before)
        felt, _ = one.felt(recorded, self.channels, rate)
        for faults in after:
            touched = before.differing(faults)
            if touched is None:
                yield self.restored(faults)[0] - self.restored(before)[0]
                continue
            mixed = touched | {OTHER_AXIS[name][0] for name in touched if name in OTHER_AXIS}
            columns = [i for i, name in enumerate(self.channels) if name in mixed]
            names, other = [self.channels[i] for i in columns], self.sensors.beside(faults)
            was = felt[:, columns]
            now = was.copy()
            for place, column in enumerate(columns):
                if self.channels[column] in touched:
                    now[:, place] = one.felt_instead(
                        other, felt[:, column], recorded[:, column], self.channels[column], rate
                    )
            counted = pace([self.signals[i] for i in columns], before)
            change = np.zeros(recorded.shape)
            change[:, columns] = (other.turned_back(now, names) - one.turned_back(was, names)) * counted
            yield self._cut(change)

    def undone(self, instrument: Instrument) -> "Measured":
        """The same recording as faultless instruments would have made it."""
        values, sigma, _ = self.restored(instrument)
        return replace(self, values=values, sigma=sigma)

    @property
    def size(self) -> np.ndarray:
        """(channels,) standard deviations of what was recorded."""
        found: np.ndarray = self.recorded.std(axis=0)
        return found

    @property
    def clipped(self) -> np.ndarray:
        """(segments, samples, channels) whether a value was recorded at its sensor's limit."""
        recorded = self.recorded if self.raw is None else self.raw[0]
        found: np.ndarray = np.abs(self._cut(recorded)) >= self.limits
        return found

    @property
    def begin(self) -> float:
        """What the clock shows at its beginning [s]."""
        return self.clock + self.first * self.segment

    @property
    def segment(self) -> float:
        """Duration of a segment [s]."""
        return SAMPLES / self.chain.rate

    @property
    def seconds(self) -> float:
        """Duration of all segments [s]."""
        return len(self.values) * self.segment

    @property
    def filtered(self) -> int:
        """Number of channels that passed the filter: the first ones."""
        return sum(s < Signal.CRANK_ANGLE for s in self.signals)


def chain_of(recording: Recording, name: str) -> MeasurementChain:
    """The chain that a recording declares, where it is silent the usual one; it ends at the recording's rate.

    Raises:
        InputError: a declared chain that ends elsewhere, but for what clocks differ by.
    """
    rate, declared = recording.rate, recording.metadata.get("chain") or {}
    whole = declared_chain(declared, rate)
    base, factor = whole["base_rate"], whole["decimation"]
    if "base_rate" in declared and abs(base / factor / rate - 1.0) > SAME_RATE:
        raise InputError(
            f"{name}: declares a chain that ends at {base / factor:g} Hz, but has {rate:g} Hz; "
            "correct chain in the YAML beside it"
        )
    try:
        return MeasurementChain(**whole | {"base_rate": rate * factor})
    except InputError as error:
        raise InputError(f"{name}: {error}") from error


def segments_before(samples: int, held_out: float) -> int:
    """Whole segments of a recording before the share at its end by which is judged."""
    return int((1.0 - held_out) * (samples // SAMPLES))

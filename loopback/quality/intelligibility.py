"""Objective intelligibility of decoded speech: ESTOI (Jensen and Taal 2016)."""

from itertools import pairwise

import numpy as np

from shared_model.arrays import Array

# The rate at which the measure is defined, samples per second.
RATE_HZ = 10_000
# Samples of a frame and between frames, and of its Fourier transform.
FRAME, HOP, FFT = 256, 128, 512
# Third-octave bands, and the centre of the lowest.
BANDS, LOWEST_BAND_HZ = 15, 150.0
# Frames of a segment, 384 ms, whose spectra are compared.
SEGMENT = 30
# Frames of the reference this much below its loudest one are silent and left out.
SILENCE_DB = 40.0
# Steps and range of the search for the delay, s.
ENVELOPE_S, MAX_DELAY_S = 0.005, 0.8
TINY = 1e-12


def estoi(reference: Array, decoded: Array) -> float:
    """The extended short-time objective intelligibility of speech, about 0 to 1.

    reference, decoded: (n,) samples at `RATE_HZ`, aligned.
    Raises `ValueError` if they differ in length, or hold less than a segment of speech.
    """
    if reference.shape != decoded.shape:
        raise ValueError(f"{len(decoded)} samples, expected the reference's {len(reference)}")
    clean, other = (_frames(signal) for signal in (reference, decoded))
    energy_db = 20 * np.log10(np.linalg.norm(clean, axis=1) + TINY)
    audible = energy_db > energy_db.max(initial=-np.inf) - SILENCE_DB
    if audible.sum() <= SEGMENT:
        raise ValueError(f"{audible.sum()} frames of speech, expected more than {SEGMENT}")
    segments = [_segments(_band_spectra(_joined(frames[audible]))) for frames in (clean, other)]
    return float((segments[0] * segments[1]).sum(axis=(1, 2)).mean())


def aligned(reference: Array, decoded: Array, rate_hz: int) -> tuple[Array, Array]:
    """The common part of two recordings (n,), (m,) whose delay has been taken out."""
    step = round(ENVELOPE_S * rate_hz)
    begin = -round(delay_s(reference, decoded, rate_hz) / ENVELOPE_S)
    late, early = max(-begin, 0) * step, max(begin, 0) * step
    length = min(len(reference) - early, len(decoded) - late)
    return reference[early : early + length], decoded[late : late + length]


def delay_s(reference: Array, decoded: Array, rate_hz: int) -> float:
    """By how much a recording (m,) is later than its reference (n,); negative: earlier.

    It is that at which the envelopes are most alike.
    """
    step, most = round(ENVELOPE_S * rate_hz), round(MAX_DELAY_S / ENVELOPE_S)
    count = min(len(reference), len(decoded)) // step
    one, other = (
        np.sqrt((signal[: count * step].reshape(count, step) ** 2).mean(1))
        for signal in (reference, decoded)
    )
    one, other = np.pad(one - one.mean(), most), other - other.mean()
    # Where the decoded envelope begins in the padded one.
    begin = int(np.correlate(one, other, "valid").argmax()) - most
    return -begin * ENVELOPE_S


def resampled(signal: Array, rate_hz: int, wanted_hz: int) -> Array:
    """A signal (n,) at another rate, without what the lower of the two rates cannot hold."""
    count = round(len(signal) * wanted_hz / rate_hz)
    spectrum = np.fft.rfft(signal)
    return np.asarray(np.fft.irfft(spectrum[: count // 2 + 1], count) * (count / len(signal)))


def _frames(signal: Array) -> Array:
    """(t, FRAME) frames under a Hann window."""
    window = np.hanning(FRAME + 2)[1:-1]
    starts = range(0, len(signal) - FRAME, HOP)
    return np.array([window * signal[start : start + FRAME] for start in starts])


def _joined(frames: Array) -> Array:
    """The signal whose frames (t, FRAME) these are."""
    signal = np.zeros((len(frames) - 1) * HOP + FRAME)
    for index, frame in enumerate(frames):
        signal[index * HOP : index * HOP + FRAME] += frame
    return signal


def _band_spectra(signal: Array) -> Array:
    """(BANDS, t) magnitudes in third-octave bands."""
    power = np.abs(np.fft.rfft(_frames(signal), FFT)) ** 2
    frequencies = np.arange(FFT // 2 + 1) * RATE_HZ / FFT
    edges = LOWEST_BAND_HZ * 2.0 ** ((2 * np.arange(BANDS + 1) - 1) / 6)
    bins = np.abs(frequencies - edges[:, None]).argmin(1)
    bands = [power[:, low:high].sum(1) for low, high in pairwise(bins)]
    return np.asarray(np.sqrt(np.array(bands)))


def _segments(spectra: Array) -> Array:
    """(segments, BANDS, SEGMENT): each row over time, then each column over bands, of mean 0 and
    length 1; columns so that those of a segment add to 1."""
    windows = np.lib.stride_tricks.sliding_window_view(spectra, SEGMENT, axis=1)
    rows = _normalised(np.moveaxis(windows, 1, 0), axis=2)
    return np.asarray(_normalised(rows, axis=1) / np.sqrt(SEGMENT))


def _normalised(values: Array, axis: int) -> Array:
    centred = values - values.mean(axis, keepdims=True)
    return np.asarray(centred / (np.linalg.norm(centred, axis=axis, keepdims=True) + TINY))

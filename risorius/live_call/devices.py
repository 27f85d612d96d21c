"""Camera and microphone of a call: those of the page, of a file, or of this host."""

from contextlib import suppress
from fractions import Fraction
from pathlib import Path
from typing import Any, Self

import cv2
import numpy as np

from encoder.capture.live_capture import FrameMailbox, LiveCapture, read_camera
from encoder.capture.picture_size import reduced
from encoder.capture.video_source import Capture, open_source
from encoder.sound.live_speech import LiveSpeech
from encoder.sound.microphones import FileMicrophone
from encoder.sound.speech_encoder import speech_rate_hz
from encoder.sound.voice_packer import VoicePacker
from risorius.live_call.messages import (
    BROWSER,
    CAMERA_SOUND,
    CameraPicture,
    Device,
    MicrophoneSound,
    OwnMedia,
    Switch,
)
from shared_model.arrays import Samples
from shared_model.errors import UserError

# Pictures a second that are taken from a camera in the browser, and from a faster one at most.
BROWSER_FPS, MAX_FPS = Fraction(25), Fraction(30)


class Devices:
    """Camera and microphone, which any thread may switch; a context manager.

    fps: of the camera.  voice: what adds the voice to packets; None: the call has none.
    Raises `UserError` if a device cannot be opened, or the codec is not installed.
    """

    def __init__(self, media: OwnMedia) -> None:
        self._media = media
        self._source: Capture | None = None
        fps = BROWSER_FPS
        if media.camera != BROWSER:
            self._source = open_source(media.camera, square_pixels=True)
            fps = min(self._source.fps, MAX_FPS)
        self._mailbox, self.fps = FrameMailbox(fps), fps
        self._capture: LiveCapture | None = None
        self._is_muted = self._is_closed = False
        self._speech: LiveSpeech | None = None
        self.voice: VoicePacker | None = None
        if media.voice != "off":
            self._speech = LiveSpeech(media.voice, lambda: self.begun_s)
            self.voice = VoicePacker(self._speech)
        self._file_microphone: FileMicrophone | None = None
        self._host_microphone: Any = None
        self._open_microphone()
        if self._source is not None:
            start = self._file_microphone.start if self._file_microphone else lambda start_s: None
            read_camera(media.camera, self._mailbox, self._source, True, start)

    def capture(self) -> LiveCapture | None:
        """The camera, once it has given a picture; None: it was closed before.

        Raises `UserError` if the camera gives none.
        """
        try:
            self._capture = LiveCapture(self._media.camera, self._mailbox, self.fps)
        except UserError:
            if self._is_closed:
                return None
            raise
        return self._capture

    def receive(self, message: CameraPicture | MicrophoneSound | Switch) -> None:
        """Take what comes from the page."""
        if isinstance(message, CameraPicture):
            data = np.frombuffer(message.jpeg, np.uint8)
            picture = cv2.imdecode(data, cv2.IMREAD_COLOR)
            if picture is not None:
                self._mailbox.put(reduced(np.asarray(picture, np.uint8)), message.time_s)
        elif isinstance(message, MicrophoneSound):
            if self._speech is not None and message.rate_hz == self._speech.rate_hz:
                samples = np.frombuffer(message.samples, np.int16)
                self._hear(samples, message.time_s)
        elif message.device is Device.CAMERA:
            self._mailbox.switch(message.on)
        else:
            self._is_muted = not message.on

    def close(self) -> None:
        """Release the devices; closing twice has no further effect."""
        self._is_closed = True
        self._mailbox.close()
        if self._file_microphone is not None:
            self._file_microphone.stop()
        if self._host_microphone is not None:
            with suppress(Exception):
                self._host_microphone.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()

    @property
    def begun_s(self) -> float | None:
        """When source frame 0 was taken; None: not yet."""
        return None if self._capture is None else self._capture.start_s

    def _open_microphone(self) -> None:
        name = self._media.microphone
        if self._speech is None or name is None or name == BROWSER:
            return
        if name == CAMERA_SOUND:
            path = Path(self._media.camera)
            self._file_microphone = FileMicrophone(path, self._speech.rate_hz, self._hear)
        else:
            from encoder.sound.microphones import open_host_microphone

            self._host_microphone = open_host_microphone(name, self._speech.rate_hz, self._hear)

    def _hear(self, samples: Samples, time_s: float) -> None:
        if self._speech is not None:
            self._speech.push(np.zeros_like(samples) if self._is_muted else samples, time_s)


def check_devices(camera: str, microphone: str | None, voice: str) -> None:
    """Raise `UserError` if a camera or microphone of this host, or a video file, does not open.

    Of a camera with a URL nothing is asked: it may serve one connection only.
    """
    if camera != BROWSER and "://" not in camera:
        open_source(camera).close()
    if voice == "off" or microphone in (None, BROWSER, CAMERA_SOUND):
        return
    from encoder.sound.microphones import open_host_microphone

    open_host_microphone(
        str(microphone), speech_rate_hz(voice), lambda samples, time_s: None
    ).close()

"""Limits of the fields of packets: what a parser accepts, whatever the bytes."""

import re

from protocol.entropy.varint import MAX_VARINT

# Codecs of the voice, and their numbers on the wire; 2 belonged to a format that is no longer read.
VOICE_NUMBERS = {"off": 0, "700C": 1, "1200": 4, "opus": 3}
VOICES = tuple(VOICE_NUMBERS)
# The one that an encoder takes unless it is told otherwise.
USUAL_VOICE = VOICES[2]
SEQUENCE_MODULUS = 64
# A packet up to so many sequence numbers behind the newest is late; any other is ahead of it.
LATE_WINDOW = 16
# A first frame packet with a higher number shows that the call was joined late.
FIRST_WINDOW = 9
MAX_FRAME_INDEX = MAX_VARINT

# Bytes of whole packets, or of one of their fields.
MAX_MODEL_PACKET_BYTES = 256 * 1024
MAX_FRAME_PAYLOAD_BYTES = 8192
MAX_CONTROL_PACKET_BYTES = 256
MAX_LAYER_BYTES = 16 * 1024
MAX_IMAGE_BYTES = 128 * 1024
MAX_PROFILE_DATA_BYTES = 128 * 1024
# Range-coded codes of `MAX_RESIDUAL_POINTS` points take fewer.
MAX_RESIDUAL_BYTES = 4096

# Call parameters.
MAX_SIDE_PX = 8192
MAX_FPS_TERM = 1_000_000
MAX_FPS = 1000
MAX_FRAMES_PER_PACKET = 64
MAX_FRAME_STEP = 255
MAX_FOCAL_PX = 1e6

# Source frames in a frame packet with a picture residual, and values of all its tiles.
MAX_PICTURE_RESIDUAL_FRAMES = 64
MAX_PICTURE_RESIDUAL_VALUES = 64 * 1024 * 1024

# Times of source frames: frames in one packet, and ticks from one frame to the next.
MAX_TIMED_FRAMES = 64
MAX_TICK_STEP = 2**15 - 2

# Models and their layers.
MAX_RESIDUAL_POINTS = 255
MAX_TRANSLATION_MM = 1e6
MAX_MODEL_VERSIONS = 64
MAX_LAYER_PACKETS = 4096

# Of the number that each start of an end of a link draws.
SESSION_BYTES = 8

# Connections of a relay at a time, unless it is told otherwise.
RELAY_PEERS = 2000

# Names of calls, and how they are described; ports.
CALL_NAME = re.compile(r"[A-Za-z0-9_-][A-Za-z0-9_.-]{0,62}")
CALL_NAME_RULE = "use at most 63 of a-z, A-Z, 0-9 and _ . -, and no . in front"
# The name of a call that nobody has named.
DEFAULT_CALL = "call"
MAX_PORT = 65535
DEFAULT_PORT = 7447

# Characters of an error message that quotes a packet.
MAX_MESSAGE_LENGTH = 200

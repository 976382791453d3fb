"""The scene in front of the photointerrupters: a script of frames, with a dark and a lit code per channel."""

import math
import struct

from .converter import CHANNELS

FRAME = struct.Struct(f"<{2 * CHANNELS}H")


class Scene:
    """Plays the frames of a script in a loop, one for each frame that the firmware takes.

    A frame begins when the first channel is converted in the dark after the last was lit. Without a script every
    channel has a constant code. Ambient light may flicker: `flicker` is its amplitude in steps and its frequency
    in Hz.
    """

    flicker = (0, 0)

    def __init__(self, script=b""):
        self.frames = list(FRAME.iter_unpack(script[: len(script) // FRAME.size * FRAME.size]))
        self.reset()

    def reset(self):
        self.number = -1
        self.last_was_lit = True

    def code(self, channel, lit, time_us):
        if channel == 0 and lit is None and self.last_was_lit:
            self.number += 1
            self.last_was_lit = False
        elif channel == CHANNELS - 1 and lit is not None:
            self.last_was_lit = True
        is_lit = lit == channel
        if not self.frames:
            code = 100 + (1000 + 200 * channel if is_lit else 0)
        else:
            code = self.frames[self.number % len(self.frames)][2 * channel + is_lit]
        amplitude, hz = self.flicker
        return code + round(amplitude + amplitude * math.sin(2e-6 * math.pi * hz * time_us))

"""Independent watchdog (RM0394, chapter 32), with its oscillator at its nominal 32 kHz."""

from .peripheral import HZ, NEVER, Peripheral

KR, PR, RLR = 0x00, 0x04, 0x08
START, FEED = 0xCCCC, 0xAAAA
LSI_HZ = 32_000


class Watchdog(Peripheral):
    def reset(self):
        super().reset()
        self.registers[RLR] = 0xFFF
        self.end = NEVER

    def load(self, offset):
        return 0 if offset == KR else super().load(offset)

    def store(self, offset, value):
        if offset != KR:
            super().store(offset, value)
        elif value == START or (value == FEED and self.end != NEVER):
            ticks = (self.load(RLR) + 1) * (4 << min(self.load(PR), 6))
            self.end = self.board.core.now + ticks * HZ // LSI_HZ

    def next_event(self):
        return self.end

    def advance(self, now):
        if now >= self.end:
            self.board.request_reset("watchdog")

"""The random number generator (RM0394, chapter 24), with the same numbers in every run."""

from .peripheral import Peripheral

CR, SR, DR = 0x00, 0x04, 0x08
RNGEN, DRDY = 1 << 2, 1 << 0


class Randomness(Peripheral):
    def reset(self):
        super().reset()
        self.state = getattr(self, "state", 1)

    def load(self, offset):
        running = super().load(CR) & RNGEN
        if offset == SR:
            return DRDY if running else 0
        if offset == DR and running:
            self.state = (self.state * 6_364_136_223_846_793_005 + 1) % (1 << 64)
            return self.state >> 32
        return super().load(offset)

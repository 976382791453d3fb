"""Reset and clock control: what is asked for is ready at once (RM0394, chapter 6)."""

from .peripheral import Peripheral

CR, CFGR, BDCR, CSR, CRRCR = 0x00, 0x08, 0x90, 0x94, 0x98

#: Bits in CR that switch something on, and the distance to those that say that it is ready.
ON_AND_READY = [(0, 1), (8, 2), (16, 1), (24, 1), (26, 1)]

#: Flags in CSR that tell why the last reset came.
CAUSES = {"power": 1 << 27, "pin": 0, "software": 1 << 28, "watchdog": 1 << 29}
PIN = 1 << 26  # set by every cause, for the pin is pulled by all


class Rcc(Peripheral):
    def __init__(self, board):
        self.cause = 0
        super().__init__(board)

    def reset(self):
        super().reset()
        self.registers[CR] = self.board.wiring.oscillators
        self.registers[CSR] = self.cause

    def set_cause(self, cause):
        self.cause |= CAUSES[cause] | PIN

    def load(self, offset):
        value = super().load(offset)
        if offset == CR:
            for on, distance in ON_AND_READY:
                ready = 1 << on + distance
                value = value | ready if value >> on & 1 else value & ~ready
        elif offset == CFGR:
            value = value & ~0xC | (value & 3) << 2
        elif offset in (BDCR, CSR, CRRCR):
            value = value & ~2 | (value & 1) << 1
        return value

    def store(self, offset, value):
        if offset == CSR and value >> 23 & 1:
            value &= 0x00FF_FFFF
            self.cause = 0
        super().store(offset, value)

"""Reset and clock control: every requested clock is ready at once (RM0394, chapter 6)."""

from .peripheral import Peripheral

CR, CFGR, BDCR, CSR, CRRCR = 0x00, 0x08, 0x90, 0x94, 0x98

#: Enable bits in CR, and the distance from each to its ready bit.
ON_AND_READY = [(0, 1), (8, 2), (16, 1), (24, 1), (26, 1)]

#: Flags in CSR that tell the cause of the last reset.
CAUSES = {"power": 1 << 27, "pin": 0, "software": 1 << 28, "watchdog": 1 << 29}
PIN = 1 << 26  # set by every cause, since all pull the pin


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

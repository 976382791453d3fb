"""Memory-mapped registers, and the schedule of a peripheral's events."""

#: Core cycles per second.
HZ = 80_000_000
NEVER = float("inf")


class Peripheral:
    """A block of 32-bit registers that hold what is written, unless a subclass overrides them.

    A narrower access reads or writes a part of the register.
    """

    SIZE = 0x400

    def __init__(self, board):
        self.board = board
        self.registers = {}
        self.reset()

    def reset(self):
        """The state after a reset of the system."""
        self.registers.clear()

    def load(self, offset):
        return self.registers.get(offset, 0)

    def store(self, offset, value):
        self.registers[offset] = value

    def next_event(self):
        """The cycle at which `advance` has to be called next."""
        return NEVER

    def advance(self, now):
        """Does what is due at the cycle `now`."""

    def read(self, _uc, offset, size, _data):
        word = self.load(offset & ~3)
        return word >> 8 * (offset & 3) & (1 << 8 * size) - 1

    def write(self, _uc, offset, size, value, _data):
        shift, mask = 8 * (offset & 3), (1 << 8 * size) - 1
        if size < 4:
            word = self.registers.get(offset & ~3, 0)
            value = word & ~(mask << shift) | (value & mask) << shift
        self.store(offset & ~3, value & 0xFFFF_FFFF)
        # The write may cause an interrupt or an earlier event.
        self.board.core.stop_soon()

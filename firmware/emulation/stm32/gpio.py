"""Pins (RM0394, chapter 8): output levels, and pulls that define the level of an undriven line."""

from .peripheral import Peripheral

MODER, PUPDR, IDR, ODR, BSRR, BRR = 0x00, 0x0C, 0x10, 0x14, 0x18, 0x28
PULLS = ["none", "up", "down", "reserved"]


class Port(Peripheral):
    def load(self, offset):
        return self.registers.get(ODR if offset == IDR else offset, 0)

    def store(self, offset, value):
        out = self.registers.get(ODR, 0)
        if offset == BSRR:
            self.registers[ODR] = out & ~(value >> 16) | value & 0xFFFF
        elif offset == BRR:
            self.registers[ODR] = out & ~value
        else:
            self.registers[offset] = value

    def is_high(self, pin):
        return self.registers.get(ODR, 0) >> pin & 1

    def pull(self, pin):
        return PULLS[self.registers.get(PUPDR, 0) >> 2 * pin & 3]

"""DMA1 (RM0394, chapter 11): byte transfers between memory and a peripheral, one per request."""

from .peripheral import Peripheral

FIRST_IRQ = 11
ISR, IFCR = 0x00, 0x04
#: Offsets within a channel's registers.
FIRST, STRIDE, CCR, CNDTR, CPAR, CMAR = 0x08, 20, 0, 4, 8, 12
CHANNELS = 7
EN, TCIE, HTIE, TEIE, FROM_MEMORY, CIRC = 1 << 0, 1 << 1, 1 << 2, 1 << 3, 1 << 4, 1 << 5
#: Flags of a channel; the first is the OR of the others.
GIF, TCIF, HTIF = 1 << 0, 1 << 1, 1 << 2


class Dma(Peripheral):
    def reset(self):
        super().reset()
        self.lengths = [0] * CHANNELS

    def _at(self, channel, register):
        return FIRST + STRIDE * channel + register

    def store(self, offset, value):
        if offset == IFCR:
            for channel in range(CHANNELS):
                flags = value >> 4 * channel & 0xF
                flags = 0xF if flags & GIF else flags
                self.registers[ISR] = self.load(ISR) & ~(flags << 4 * channel)
            return
        channel, register = divmod(offset - FIRST, STRIDE)
        if channel < CHANNELS and register == CCR and value & EN and not self.load(offset) & EN:
            self.lengths[channel] = self.load(self._at(channel, CNDTR))
        self.registers[offset] = value
        self.lines()
        self.board.usart.refill()

    def _serving(self, address, from_memory):
        """The channel that serves the register at an address, if it has bytes left to transfer."""
        for channel in range(CHANNELS):
            control = self.load(self._at(channel, CCR))
            if control & EN and bool(control & FROM_MEMORY) == from_memory:
                if self.load(self._at(channel, CPAR)) == address and self.load(self._at(channel, CNDTR)):
                    return channel
        return None

    def _step(self, channel):
        """Address of the next byte; decrements the count."""
        left, length = self.load(self._at(channel, CNDTR)), self.lengths[channel]
        place = self.load(self._at(channel, CMAR)) + length - left
        left -= 1
        flags = (HTIF if left == length // 2 else 0) | (TCIF if left == 0 else 0)
        if left == 0 and self.load(self._at(channel, CCR)) & CIRC:
            left = length
        self.registers[self._at(channel, CNDTR)] = left
        if flags:
            self.registers[ISR] = self.load(ISR) | (flags | GIF) << 4 * channel
        return place

    def take(self, address):
        """The next byte for a peripheral's register, `None` if there is none."""
        channel = self._serving(address, from_memory=True)
        if channel is None:
            return None
        byte = bytes(self.board.core.uc.mem_read(self._step(channel), 1))[0]
        self.lines()
        return byte

    def give(self, address, byte):
        """Takes a byte from a peripheral's register; returns false if no channel serves it."""
        channel = self._serving(address, from_memory=False)
        if channel is None:
            return False
        self.board.core.uc.mem_write(self._step(channel), bytes([byte]))
        self.lines()
        return True

    def lines(self):
        for channel in range(CHANNELS):
            flags = self.load(ISR) >> 4 * channel & 0xF
            if flags & self.load(self._at(channel, CCR)) & (TCIE | HTIE | TEIE):
                self.board.nvic.pend(FIRST_IRQ + channel)

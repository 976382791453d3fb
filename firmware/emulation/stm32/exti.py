"""Interrupts at rising edges of pins (RM0394, chapters 9 and 13): line 15, which is PA15 here."""

from collections import deque

from .peripheral import HZ, NEVER, Peripheral

IRQ = 40  # of lines 10 to 15
IMR, RTSR, PR = 0x00, 0x08, 0x14
EXTICR4 = 0x14  # of the system configuration: the ports of lines 12 to 15
LINE = 15


class Exti(Peripheral):
    def __init__(self, board):
        #: Cycles at which the pin rises.
        self.edges = deque()
        super().__init__(board)

    def drive(self, delays):
        """Schedules rising edges after these delays from now, in s and ascending."""
        self.edges.extend(self.board.core.now + delay * HZ for delay in delays)

    def store(self, offset, value):
        if offset == PR:
            value = self.registers.get(PR, 0) & ~value
        super().store(offset, value)
        self.lines()

    def lines(self):
        if self.load(PR) & self.load(IMR) & 0xFC00:
            self.board.nvic.pend(IRQ)

    def next_event(self):
        return self.edges[0] if self.edges else NEVER

    def advance(self, now):
        while self.edges and self.edges[0] <= now:
            self.edges.popleft()
            is_port_a = self.board.system.load(EXTICR4) >> 4 * (LINE % 4) & 0xF == 0
            if is_port_a and self.load(RTSR) >> LINE & 1:
                self.registers[PR] = self.load(PR) | 1 << LINE
        self.lines()

"""USART1 (RM0394, chapter 38): a shift register per direction, at the baud rate."""

from collections import deque

from .peripheral import HZ, NEVER, Peripheral

IRQ = 37
CR1, CR3, BRR, ISR, ICR, RDR, TDR = 0x00, 0x08, 0x0C, 0x1C, 0x20, 0x24, 0x28
UE, RE, TE = 1 << 0, 1 << 2, 1 << 3
ORE, IDLE, RXNE, TC, TXE = 1 << 3, 1 << 4, 1 << 5, 1 << 6, 1 << 7
TEACK, REACK = 1 << 21, 1 << 22
DMAR, DMAT, CTSE = 1 << 6, 1 << 7, 1 << 9
#: Base address, by which DMA finds the registers.
BASE = 0x4001_3800
#: Flags that ICR clears; RXNE and TXE are not among them.
CLEARABLE = 0x0012_1B5F
BITS_PER_BYTE = 10
CTS_PIN = 11  # on port A
#: Maximum relative difference of the two ends' rates.
TOLERANCE = 0.04


class Usart(Peripheral):
    def __init__(self, board):
        #: The rate of the other end in baud; `None` follows the board's rate.
        self.other_end = None
        self.sent = []  # cycle and byte; kept across resets of the board
        super().__init__(board)

    def reset(self):
        super().reset()
        self.registers[ISR] = TXE | TC
        self.shifting = None  # the outgoing byte, and the cycle at which it is complete
        self.waiting = None
        self.incoming = deque()  # earliest cycle, and byte
        self.receiver_free = 0
        self.idle_at = NEVER  # when the line has been idle for the time of a byte

    def byte_cycles(self):
        return BITS_PER_BYTE * max(self.load(BRR), 1)

    def rate(self):
        """The current rate in baud; 0 before it is set."""
        return HZ / self.load(BRR) if self.load(BRR) else 0

    def on_wire(self, byte):
        """The byte that arrives, which differs from the one sent if the ends have different rates."""
        is_same = self.other_end is None or abs(self.rate() / self.other_end - 1) < TOLERANCE
        return byte if is_same else byte * 0x4D + 0x2B & 0xFF

    def receive(self, data, at):
        """Queues bytes that arrive back to back, the first not before `at`."""
        self.incoming.extend((at, byte) for byte in data)

    def load(self, offset):
        if offset == RDR:
            self.registers[ISR] &= ~RXNE
        return super().load(offset)

    def store(self, offset, value):
        if offset == ICR:
            self.registers[ISR] &= ~(value & CLEARABLE)
        elif offset == TDR:
            self._send(value & 0xFF)
        elif offset != ISR:
            self.registers[offset] = value
            if offset == CR1:
                on = value & UE
                flags = (TEACK if on and value & TE else 0) | (REACK if on and value & RE else 0)
                self.registers[ISR] = self.registers[ISR] & ~(TEACK | REACK) | flags
            self.refill()
        self.lines()

    def _send(self, byte):
        self.waiting = byte
        self.registers[ISR] &= ~(TXE | TC)
        self._shift(self.board.core.now)

    def refill(self):
        """Requests bytes from DMA while there is room for one."""
        while self.load(CR3) & DMAT and self.waiting is None:
            byte = self.board.dma.take(BASE + TDR)
            if byte is None:
                return
            self._send(byte)

    def is_clear_to_send(self):
        if not self.load(CR3) & CTSE:
            return True
        level = self.board.cts
        if level == "open":
            # An undriven line without a pull-down counts as high, the worst case.
            level = "low" if self.board.ports["A"].pull(CTS_PIN) == "down" else "high"
        return level == "low"

    def _shift(self, now):
        if self.shifting is None and self.waiting is not None and self.is_clear_to_send():
            self.shifting = (self.waiting, now + self.byte_cycles())
            self.waiting = None
            self.registers[ISR] |= TXE

    def lines(self):
        flags, enabled = self.registers[ISR], self.load(CR1)
        raised = flags & enabled & (TXE | TC | IDLE)
        if raised or (flags & (RXNE | ORE) and enabled & RXNE):
            self.board.nvic.pend(IRQ)

    def _next_arrival(self):
        return max(self.incoming[0][0], self.receiver_free) if self.incoming else NEVER

    def next_event(self):
        end = self.shifting[1] if self.shifting else NEVER
        return min(end, self._next_arrival(), self.idle_at)

    def advance(self, now):
        while self.shifting and self.shifting[1] <= now:
            byte, end = self.shifting
            self.sent.append((end, self.on_wire(byte)))
            self.shifting = None
            self._shift(end)
            self.refill()
            if self.shifting is None and self.waiting is None:
                self.registers[ISR] |= TC
        self._shift(now)
        self.refill()
        if self.idle_at <= now:
            self.idle_at = NEVER
            self.registers[ISR] |= IDLE
        while self._next_arrival() <= now:
            at, byte = self._next_arrival(), self.incoming.popleft()[1]
            self.receiver_free = at + self.byte_cycles()
            self.idle_at = self.receiver_free + self.byte_cycles()
            byte = self.on_wire(byte)
            if self.load(CR3) & DMAR and self.board.dma.give(BASE + RDR, byte):
                continue
            if self.registers[ISR] & RXNE:
                self.registers[ISR] |= ORE
            else:
                self.registers[RDR] = byte
                self.registers[ISR] |= RXNE
        self.lines()

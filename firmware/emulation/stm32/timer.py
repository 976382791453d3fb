"""TIM2, a 32-bit counter with four compare channels, and TIM6, a basic timer (RM0394, chapters 27 and 29)."""

from .peripheral import NEVER, Peripheral

TIM2_IRQ = 28
CR1, CR2, DIER, SR, EGR, CNT, PSC, ARR, CCR1 = 0x00, 0x04, 0x0C, 0x10, 0x14, 0x24, 0x28, 0x2C, 0x34
CEN, URS, OPM = 1, 4, 8
UIF, UG = 1, 1
#: In CR2: the update event is the trigger output.
MMS, MMS_UPDATE = 7 << 4, 2 << 4


class Timer(Peripheral):
    def reset(self):
        super().reset()
        self.registers[ARR] = 0xFFFF_FFFF
        self.start = None  # cycle at which the counter was 0
        self.seen = 0  # ticks up to which flags are set

    def _ticks(self, now):
        return int(now - self.start) // (self.load(PSC) + 1)

    def _modulus(self):
        return self.registers[ARR] + 1

    def load(self, offset):
        if offset == CNT and self.start is not None:
            return self._ticks(self.board.core.now) % self._modulus()
        return super().load(offset)

    def store(self, offset, value):
        now = self.board.core.now
        if self.start is not None:
            self.advance(now)
        if offset == SR:
            self.registers[SR] = self.registers.get(SR, 0) & value
        elif offset == EGR:
            if value & 1 and not self.load(CR1) & URS:
                self.registers[SR] = self.registers.get(SR, 0) | 1
        elif offset == CR1:
            if value & CEN and self.start is None:
                self.start = now - self.registers.get(CNT, 0) * (self.load(PSC) + 1)
                self.seen = self._ticks(now)
            self.registers[CR1] = value
        else:
            self.registers[offset] = value
        self._raise()

    def _raise(self):
        if self.registers.get(SR, 0) & self.registers.get(DIER, 0) & 0x1F:
            self.board.nvic.pend(TIM2_IRQ)

    def _next_match(self, tick, compare):
        """The first tick after `tick` at which the counter equals `compare`."""
        return tick + 1 + (compare - tick - 1) % self._modulus()

    def next_event(self):
        if self.start is None:
            return NEVER
        enabled = self.registers.get(DIER, 0)
        matches = [self._next_match(self.seen, 0)] if enabled & 1 else []
        for channel in range(4):
            if enabled & 2 << channel:
                compare = self.registers.get(CCR1 + 4 * channel, 0)
                matches.append(self._next_match(self.seen, compare))
        return self.start + min(matches) * (self.load(PSC) + 1) if matches else NEVER

    def advance(self, now):
        if self.start is None:
            return
        ticks = self._ticks(now)
        if ticks > self.seen:
            flags = 1 if self._next_match(self.seen, 0) <= ticks else 0
            for channel in range(4):
                compare = self.registers.get(CCR1 + 4 * channel, 0)
                if self._next_match(self.seen, compare) <= ticks:
                    flags |= 2 << channel
            self.registers[SR] = self.registers.get(SR, 0) | flags
            self.seen = ticks
        self._raise()

    lines = _raise


class PulseTimer(Peripheral):
    """TIM6 in one-pulse mode, the only mode that is modelled: it counts once from 0 to ARR and stops. Its update
    event starts conversions through the trigger output."""

    def reset(self):
        super().reset()
        self.registers[ARR] = 0xFFFF
        self.prescaler = 0  # the value in use, which an update copies from PSC
        self.end = NEVER

    def store(self, offset, value):
        if offset == SR:
            value &= self.load(SR)
        elif offset == EGR:
            if value & UG:
                self.prescaler = self.load(PSC)
                self._update(is_counted=False)
            value = 0
        elif offset == CR1 and value & CEN and not self.load(CR1) & CEN:
            if not value & OPM:
                raise AssertionError("TIM6 is modelled in one-pulse mode")
            if self.load(ARR):  # with ARR = 0 the counter does not run
                ticks = self.load(ARR) + 1
                self.end = self.board.core.now + ticks * (self.prescaler + 1)
        elif offset == CR1 and not value & CEN:
            self.end = NEVER
        self.registers[offset] = value

    def _update(self, is_counted):
        if is_counted or not self.load(CR1) & URS:
            self.registers[SR] = self.load(SR) | UIF
        if self.load(CR2) & MMS == MMS_UPDATE:
            self.board.converter.trigger()

    def next_event(self):
        return self.end

    def advance(self, now):
        if now >= self.end:
            self.end = NEVER
            self.registers[CR1] &= ~CEN
            self._update(is_counted=True)

"""ADC1 with its oversampler (RM0394, chapter 16), and the photointerrupters at its inputs."""

from .factory import (
    COLD_CODE,
    FACTORY,
    FACTORY_V,
    HOT_CODE,
    REFERENCE_CODE,
    SUPPLY_V,
    TEMPERATURE_C,
)
from .peripheral import NEVER, Peripheral

IRQ = 18
ISR, IER, CR, CFGR, CFGR2, SMPR1, SQR1, DR = 0x00, 0x04, 0x08, 0x0C, 0x10, 0x14, 0x30, 0x40
ADRDY, EOC, EOS, OVR = 1 << 0, 1 << 2, 1 << 3, 1 << 4
ADEN, ADSTART, ADSTP, ADCAL = 1 << 0, 1 << 2, 1 << 4, 1 << 31
#: In CFGR2; the ratio is in bits 2 to 4, the shift in bits 5 to 8.
ROVSE = 1 << 0
#: In CFGR: the trigger that starts conversions, and its edge.
EXTSEL, EXTEN, RISING = 0x1F << 5, 3 << 10, 1 << 10
#: Sampling cycles by SMPR, and cycles of a 12-bit conversion.
SAMPLING = [2.5, 6.5, 12.5, 24.5, 47.5, 92.5, 247.5, 640.5]
CONVERSION = 12.5

#: Clock dividers by PRESC of the common control register.
CCR = 0x308
DIVISIONS = [1, 2, 4, 6, 8, 10, 12, 16, 32, 64, 128, 256]

CHANNELS = 8


class Converter(Peripheral):
    """Conversions of one input, started by software or by TIM6, singly or in bursts that the oversampler adds up."""

    def reset(self):
        super().reset()
        self.registers[CR] = 1 << 29
        self.end = NEVER
        self.last_end = None

    def load(self, offset):
        if offset == DR:
            self.registers[ISR] = self.registers.get(ISR, 0) & ~EOC
        return super().load(offset)

    def store(self, offset, value):
        running = self.load(CR) & ADSTART
        if offset == ISR:
            value = self.load(ISR) & ~value
        elif offset == CR:
            before = self.load(CR)
            value &= ~ADCAL  # calibrated at once
            if value & ADEN and not before & ADEN:
                self.registers[ISR] = self.load(ISR) | ADRDY
            if value & ADSTART and not running and not self.load(CFGR) & EXTEN:
                self._start()
            if value & ADSTP:
                value &= ~(ADSTP | ADSTART)
                self.end = NEVER
        elif offset in (CFGR, CFGR2, SQR1) or SMPR1 <= offset < SMPR1 + 8:
            if running:
                raise AssertionError("the converter is set up while it converts")
            is_trigger = value & (EXTSEL | EXTEN) in (0, self.board.wiring.trigger)
            if offset == CFGR and (value & ~(1 << 31 | EXTSEL | EXTEN) or not is_trigger):
                raise AssertionError(f"CFGR {value:#010x} is not modelled")
            if offset == SQR1 and value & 0xF:
                raise AssertionError("sequences are not modelled")
        self.registers[offset] = value
        self.lines()

    def _input(self):
        return self.load(SQR1) >> 6 & 0x1F

    def _conversion_cycles(self):
        channel = self._input()
        code = self.load(SMPR1 + 4 * (channel // 10)) >> 3 * (channel % 10) & 7
        return (SAMPLING[code] + CONVERSION) * DIVISIONS[self.load(CCR) >> 18 & 0xF]

    def _ratio(self):
        """Number of conversions added up for one result."""
        oversampling = self.load(CFGR2)
        return 2 << (oversampling >> 2 & 7) if oversampling & ROVSE else 1

    def _result(self, codes):
        """The sum, shifted right with rounding, truncated to 16 bits."""
        total = sum(codes)
        if self.load(CFGR2) & ROVSE:
            shift = self.load(CFGR2) >> 5 & 0xF
            total = total + (1 << shift >> 1) >> shift
        return total & 0xFFFF

    def _start(self):
        if self.board.converter_works:
            self.begin = self.board.core.now
            self.end = self.begin + self._ratio() * self._conversion_cycles()

    def trigger(self):
        """Handles a rising edge of TIM6's trigger output."""
        if self.load(CR) & ADSTART and self.load(CFGR) & EXTEN and self.end == NEVER:
            self._start()

    def next_event(self):
        return self.end

    def advance(self, now):
        if now < self.end:
            return
        cycles = self._conversion_cycles()
        lit = self.lit()
        start_us = self.begin / 80
        # The first conversion after a pause is unreliable (errata), and the model makes it visibly wrong.
        paused = self.last_end is None or self.begin - self.last_end > 80_000
        codes = []
        for i in range(self._ratio()):
            code = self._code(lit, start_us + i * cycles / 80)
            codes.append(0xFFF - code if paused and i == 0 else code)
        self.last_end, self.end = self.end, NEVER
        flags = self.load(ISR)
        if flags & EOC:
            flags |= OVR  # the previous result was not read, and stays
        else:
            self.registers[DR] = self._result(codes)
        self.registers[ISR] = flags | EOC | EOS
        if not self.load(CFGR) & EXTEN:
            self.registers[CR] &= ~ADSTART  # else it waits for the next trigger
        self.lines()

    def lines(self):
        if self.registers.get(ISR, 0) & self.load(IER) & (EOC | EOS | OVR):
            self.board.nvic.pend(IRQ)

    def _code(self, lit, time_us):
        source, wiring = self._input(), self.board.wiring
        if source == wiring.reference:
            return round(FACTORY[REFERENCE_CODE] * FACTORY_V / SUPPLY_V)
        if source == wiring.thermometer:
            cold, hot = FACTORY[COLD_CODE], FACTORY[HOT_CODE]
            at_factory = cold + (hot - cold) * (TEMPERATURE_C - 30) / 100
            return round(at_factory * FACTORY_V / SUPPLY_V)
        return self.board.scene.code(wiring.inputs.index(source), lit, time_us)

    def lit(self):
        """The emitter that is on, `None` if none is; two at a time are a firmware fault."""
        ports, emitters = self.board.ports, self.board.wiring.emitters
        on = [i for i, (port, pin) in enumerate(emitters) if ports[port].is_high(pin)]
        if len(on) > 1:
            raise AssertionError(f"emitters {on} are lit together")
        return on[0] if on else None

"""ADC1 with DMA1 channel 1 (RM0394, chapters 16 and 11), and the photointerrupters before it."""

import struct

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

IRQ = 11
ISR, CR, CFGR, SMPR1, SQR1, DR = 0x00, 0x08, 0x0C, 0x14, 0x30, 0x40
ADRDY, OVR = 1 << 0, 1 << 4
ADEN, ADSTART, ADSTP, ADCAL = 1 << 0, 1 << 2, 1 << 4, 1 << 31
DMAEN, CONT = 1 << 0, 1 << 13
#: Cycles of sampling by SMPR, and of conversion with 12 bits.
SAMPLING = [2.5, 6.5, 12.5, 24.5, 47.5, 92.5, 247.5, 640.5]
CONVERSION = 12.5

DMA_ISR, DMA_IFCR, CCR, CNDTR, CMAR = 0x00, 0x04, 0x08, 0x0C, 0x14
TCIF, HTIF = 1 << 1, 1 << 2

#: Inputs within the chip: the voltage reference and the thermometer (RM0394, 16.3).
REFERENCE, THERMOMETER = 0, 17

#: The converter's input of the first photointerrupter, and the pins of all emitters.
FIRST_INPUT, CHANNELS = 5, 8
EMITTERS = [("B", 0), ("B", 1), ("B", 3), ("B", 4), ("B", 5), ("B", 6), ("B", 7), ("A", 8)]


class Dma(Peripheral):
    """One channel, from the converter to memory."""

    def store(self, offset, value):
        if offset == DMA_IFCR:
            flags = 0xF if value & 1 else value & 0xF
            self.registers[DMA_ISR] = self.registers.get(DMA_ISR, 0) & ~flags
        else:
            self.registers[offset] = value
        self.lines()

    def room(self):
        return self.load(CNDTR) & 0xFFFF if self.load(CCR) & 1 else 0

    def take(self, codes):
        """Moves codes to memory, all that it still waits for."""
        memory = self.load(CMAR)
        self.board.core.uc.mem_write(memory, struct.pack(f"<{len(codes)}H", *codes))
        self.registers[CNDTR] = 0
        self.registers[DMA_ISR] = self.registers.get(DMA_ISR, 0) | 1 | TCIF | HTIF
        self.lines()

    def lines(self):
        if self.load(DMA_ISR) & self.load(CCR) & 0xE:
            self.board.nvic.pend(IRQ)


class Converter(Peripheral):
    def reset(self):
        super().reset()
        self.registers[CR] = 1 << 29
        self.end = NEVER
        self.last_end = None

    def load(self, offset):
        return super().load(offset)

    def store(self, offset, value):
        if offset == ISR:
            value = self.load(ISR) & ~value
        elif offset == CR:
            before = self.load(CR)
            value &= ~ADCAL  # calibrated at once
            if value & ADEN and not before & ADEN:
                self.registers[ISR] = self.load(ISR) | ADRDY
            if value & ADSTART and not before & ADSTART:
                self._start()
            if value & ADSTP:
                value &= ~(ADSTP | ADSTART)
                self.end = NEVER
        self.registers[offset] = value

    def _input(self):
        return self.load(SQR1) >> 6 & 0x1F

    def _conversion_cycles(self):
        channel = self._input()
        code = self.load(SMPR1 + 4 * (channel // 10)) >> 3 * (channel % 10) & 7
        return SAMPLING[code] + CONVERSION

    def _start(self):
        """One burst: as many conversions as the DMA channel waits for."""
        count = self.board.dma.room() if self.load(CFGR) & DMAEN else 1
        if self.board.converter_works:
            self.begin = self.board.core.now
            self.end = self.begin + count * self._conversion_cycles()

    def next_event(self):
        return self.end

    def advance(self, now):
        if now < self.end:
            return
        cycles = self._conversion_cycles()
        count = round((self.end - self.begin) / cycles)
        lit = self.lit()
        start_us = self.begin / 80
        # After a pause the first conversion is not to be trusted, and is made to show (errata).
        paused = self.last_end is None or self.begin - self.last_end > 80_000
        codes = []
        for i in range(count):
            code = self._code(lit, start_us + i * cycles / 80)
            codes.append(0xFFF - code if paused and i == 0 else code)
        self.last_end, self.end = self.end, NEVER
        self.registers[DR] = codes[-1]
        if self.load(CFGR) & DMAEN:
            self.board.dma.take(codes)
            if self.load(CFGR) & CONT:
                self.registers[ISR] = self.load(ISR) | OVR  # it goes on, and nobody listens
        else:
            self.registers[CR] &= ~ADSTART

    def _code(self, lit, time_us):
        source = self._input()
        if source == REFERENCE:
            return round(FACTORY[REFERENCE_CODE] * FACTORY_V / SUPPLY_V)
        if source == THERMOMETER:
            cold, hot = FACTORY[COLD_CODE], FACTORY[HOT_CODE]
            at_factory = cold + (hot - cold) * (TEMPERATURE_C - 30) / 100
            return round(at_factory * FACTORY_V / SUPPLY_V)
        return self.board.scene.code(source - FIRST_INPUT, lit, time_us)

    def lit(self):
        """The emitter that is on, `None` if none is; two at a time are a fault of the firmware."""
        ports = {"A": self.board.port_a, "B": self.board.port_b}
        on = [i for i, (port, pin) in enumerate(EMITTERS) if ports[port].is_high(pin)]
        if len(on) > 1:
            raise AssertionError(f"emitters {on} are lit together")
        return on[0] if on else None

"""Flash: the interface, and the pages of the calibration (RM0394, chapter 3).

Code is in memory that cannot be written. The calibration's pages are modelled here, so that the power can be cut
during an operation, which leaves a double word unreadable. The data cache keeps returning erased data until it
is reset.
"""

import struct

from .peripheral import HZ, Peripheral

FLASH = 0x0800_0000
PAGE, DOUBLE_WORD = 2048, 8
ERASED = b"\xff" * DOUBLE_WORD

ACR, KEYR, SR, CR, ECCR = 0x00, 0x08, 0x10, 0x14, 0x18
DCEN, DCRST = 1 << 10, 1 << 12
PG, PER, START, LOCK = 1 << 0, 1 << 1, 1 << 16, 1 << 31
PROGERR, WRPERR = 1 << 3, 1 << 4
ECCD = 1 << 31
KEYS = [0x4567_0123, 0xCDEF_89AB]

#: DS11451, table "Flash memory characteristics": a double word and a page, typical.
WRITE_CYCLES = int(81.69e-6 * HZ)
ERASE_CYCLES = int(22.02e-3 * HZ)

#: Possible effects of an operation that a power cut interrupts.
OUTCOMES = ["nothing", "some bits", "unreadable", "complete"]


class PowerCut(Exception):
    """The power is gone."""


class FlashInterface(Peripheral):
    """The registers of the interface."""

    def reset(self):
        super().reset()
        self.registers.update({ACR: 0x600, CR: LOCK | 1 << 30})
        self.keys = []

    def store(self, offset, value):
        control = self.registers[CR]
        if offset == KEYR:
            self.keys = (self.keys + [value])[-2:]
            if self.keys == KEYS:
                self.registers[CR] = control & ~LOCK
        elif offset == SR:
            self.registers[SR] = self.registers.get(SR, 0) & ~value
        elif offset == ECCR:
            self.registers[ECCR] = self.registers.get(ECCR, 0) & ~(value & 3 << 30)
        elif offset == CR:
            if value & LOCK:
                self.registers[CR] = control | LOCK
            elif not control & LOCK:
                self.registers[CR] = value & ~START
                if value & START and value & PER:
                    self.board.pages.erase(value >> 3 & 0xFF)
        else:
            if offset == ACR and value & DCRST and not self.registers[ACR] & DCEN:
                self.board.pages.cache.clear()
            self.registers[offset] = value

    def writable(self):
        control = self.registers[CR]
        return control & PG and not control & LOCK

    def fail(self, flag):
        self.registers[SR] = self.registers.get(SR, 0) | flag

    def report_ecc(self, address):
        eccr = self.registers.get(ECCR, 0)
        if not eccr & ECCD:
            self.registers[ECCR] = ECCD | address - FLASH
        self.board.core.pend_nmi()


class Pages:
    """The pages in which the image keeps its calibration."""

    def __init__(self, board, start, end):
        self.board, self.start = board, start
        self.content = bytearray(b"\xff" * (end - start))
        self.unreadable = set()
        self.cache = {}
        self.first_half = None
        #: Operations since the board was created, and the operation at which to cut the power, with its
        #: outcome.
        self.operations = 0
        self.cut = None

    def power_off(self):
        self.cache.clear()
        self.first_half = None
        self.cut = None

    def erase(self, page):
        start = FLASH + page * PAGE - self.start
        if not 0 <= start < len(self.content):
            raise AssertionError(f"page {page} is erased, which is not one of the calibration's")
        self._change(start, b"\xff" * PAGE)
        self.board.core.stall(ERASE_CYCLES)

    def read(self, _uc, offset, size, _data):
        word = offset & ~(DOUBLE_WORD - 1)
        if word in self.unreadable:
            self.board.flash.report_ecc(self.start + word)
        cached = self.board.flash.registers[ACR] & DCEN
        line = self.cache.get(word) if cached else None
        if line is None:
            line = bytes(self.content[word : word + DOUBLE_WORD])
            if cached:
                self.cache[word] = line
        return int.from_bytes(line[offset - word :][:size], "little")

    def write(self, _uc, offset, size, value, _data):
        flash = self.board.flash
        word = offset & ~(DOUBLE_WORD - 1)
        if not flash.writable() or size != 4:
            flash.fail(WRPERR)
        elif offset == word:
            self.first_half = (word, value)
        elif self.first_half is None or self.first_half[0] != word:
            flash.fail(PROGERR)
        elif bytes(self.content[word : word + DOUBLE_WORD]) != ERASED or word in self.unreadable:
            flash.fail(PROGERR)
        else:
            self._change(word, struct.pack("<II", self.first_half[1], value))
            self.cache.pop(word, None)
            self.first_half = None
            self.board.core.stall(WRITE_CYCLES)

    def _change(self, start, new):
        """Gives a page or a double word its content, or part of it if the power is cut."""
        words = set(range(start, start + len(new), DOUBLE_WORD))
        outcome = "complete"
        if self.cut is not None and self.cut[0] == self.operations:
            outcome = self.cut[1]
        elif self.cut is not None and self.cut[0] < self.operations:
            return  # the power is gone, but the core has not stopped yet
        self.operations += 1
        if outcome == "complete":
            self.content[start : start + len(new)] = new
            self.unreadable -= words
        elif outcome == "some bits":
            for i, byte in enumerate(new):
                mask = i * 167 & 0xFF ^ 0x5A  # any pattern that takes some bits of both
                self.content[start + i] = self.content[start + i] & mask | byte & ~mask
            self.unreadable -= words
        elif outcome == "unreadable":
            self.unreadable |= words
        if self.cut is not None and self.cut[0] < self.operations:
            self.board.core.raise_soon(PowerCut())

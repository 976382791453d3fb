"""The board: core, peripherals and wires."""

from .clocks import Rcc
from .converter import Converter
from .core import RAM, Core
from .dma import Dma
from .elf import Elf
from .exti import Exti
from .flash import FlashInterface, Pages, PowerCut
from .gpio import Port
from .nvic import Nvic
from .peripheral import HZ, NEVER, Peripheral
from .randomness import Randomness
from .scene import Scene
from .timer import PulseTimer, Timer
from .usart import Usart
from .watchdog import Watchdog

#: Peripherals that only hold what is written: power control, DMA requests, and the debug port.
PLAIN = [0x4000_7000, 0x4002_0800, 0xE004_2000]


def port_address(name):
    return 0x4800_0000 + 0x400 * (ord(name) - ord("A"))


class Board:
    def __init__(self, path, wiring, script=b""):
        image = Elf(path)
        self.wiring = wiring
        self.serial = bytes(range(1, 13))
        start, end = (image.symbols[f"__calibration_{name}"] for name in ("start", "end"))
        self.code_size = start - 0x0800_0000
        #: CTS as driven by the module at the other end: "low" is clear to send.
        self.cts = "low"
        self.converter_works = True
        self.scene = Scene(script)
        self.core = Core(self, image, start)
        self.pages = Pages(self, start, end)
        self.nvic = Nvic(self)
        self.rcc, self.flash = Rcc(self), FlashInterface(self)
        self.ports = {name: Port(self) for name in wiring.ports}
        self.timer, self.watchdog = Timer(self), Watchdog(self)
        self.dma, self.usart = Dma(self), Usart(self)
        self.system, self.exti = Peripheral(self), Exti(self)
        self.pulse_timer, self.converter = PulseTimer(self), Converter(self)
        self.places = {
            0x4000_0000: self.timer,
            0x4000_1000: self.pulse_timer,
            0x4000_3000: self.watchdog,
            0x4001_0000: self.system,
            0x4001_0400: self.exti,
            0x4001_3800: self.usart,
            0x4002_0000: self.dma,
            0x4002_1000: self.rcc,
            0x4002_2000: self.flash,
            wiring.converter: self.converter,
            0x5006_0800: Randomness(self),
            0xE000_E000: self.nvic,
        }
        self.places |= {port_address(name): port for name, port in self.ports.items()}
        plain = PLAIN + [port_address(name) for name in wiring.other_ports]
        self.places |= {base: Peripheral(self) for base in plain}
        self.timed = [self.timer, self.pulse_timer, self.watchdog, self.usart, self.converter, self.exti]
        self._map()
        #: Cause and cycle of each reset.
        self.resets = []
        self._pending_reset = None
        self.power_on()

    def _map(self):
        pages, uc = self.pages, self.core.uc
        uc.mmio_map(pages.start, len(pages.content), pages.read, None, pages.write, None)
        blocks = {}
        for base, peripheral in self.places.items():
            # Unicorn maps whole pages of 4 KiB, which may hold several peripherals.
            for offset in range(0, peripheral.SIZE, 0x1000):
                blocks.setdefault((base + offset) & ~0xFFF, []).append((base, peripheral))
        for page, inside in blocks.items():
            read, write = self._dispatch(page, inside)
            uc.mmio_map(page, 0x1000, read, None, write, None)

    @staticmethod
    def _dispatch(page, inside):
        def find(offset):
            for base, peripheral in inside:
                if base <= page + offset < base + peripheral.SIZE:
                    return peripheral, page + offset - base
            raise AssertionError(f"there is nothing at {page + offset:#010x}")

        def read(uc, offset, size, data):
            peripheral, at = find(offset)
            return peripheral.read(uc, at, size, data)

        def write(uc, offset, size, value, data):
            peripheral, at = find(offset)
            peripheral.write(uc, at, size, value, data)

        return read, write

    # Requests of the core

    def next_event(self):
        return min((peripheral.next_event() for peripheral in self.timed), default=NEVER)

    def advance(self):
        now = self.core.now
        for peripheral in self.timed:
            peripheral.advance(now)

    def raise_lines(self):
        for peripheral in (self.timer, self.usart, self.dma, self.converter, self.exti):
            peripheral.lines()

    def request_reset(self, cause):
        self._pending_reset = cause
        self.core.raise_soon(Reset(cause))

    # Actions from outside

    def power_on(self):
        """Powers the board on. RAM comes up with content that is arbitrary, but the same every time."""
        self.core.uc.mem_write(RAM, b"\xa5" * self.wiring.ram_size)
        self.pages.power_off()
        self.reset("power")

    def reset(self, cause):
        self.resets.append((cause, self.core.now))
        self.rcc.set_cause(cause)
        for peripheral in self.places.values():
            peripheral.reset()
        self.after_reset = {
            base: dict(peripheral.registers) for base, peripheral in self.places.items()
        }
        self.scene.reset()
        self.core.reset()

    def run(self, seconds):
        """Runs for a time; returns false if the power was cut, which leaves the board off."""
        end = self.core.now + seconds * HZ
        while self.core.now < end:
            try:
                self.core.run(end)
            except Reset as reset:
                self.reset(reset.cause)
            except PowerCut:
                return False
        return True

    def changed_registers(self):
        """Registers of peripherals that differ from their reset state, except those of the core."""
        return {
            f"{base + offset:#010x}": value
            for base, peripheral in self.places.items()
            if peripheral is not self.nvic
            for offset, value in peripheral.registers.items()
            if value != self.after_reset[base].get(offset, 0)
        }

    def take_sent(self):
        """Bytes that have left the board since the last call."""
        sent, self.usart.sent = self.usart.sent, []
        return bytes(byte for _, byte in sent)

    def stack(self):
        """The greatest depth of the stack so far, in bytes."""
        return self.core.stack_top - self.core.deepest


class Reset(Exception):
    """The chip resets itself."""

    def __init__(self, cause):
        super().__init__(cause)
        self.cause = cause

"""The system control space: interrupts, faults, reset (Arm DDI0403, part B3)."""

from .peripheral import Peripheral

ISER, ICER, ISPR, ICPR, IPR, STIR = 0x100, 0x180, 0x200, 0x280, 0x400, 0xF00
ICSR, VTOR, AIRCR, CFSR = 0xD04, 0xD08, 0xD0C, 0xD28
RESET = 0x05FA_0004


class Nvic(Peripheral):
    SIZE = 0x1000

    def reset(self):
        super().reset()
        self.registers[0xD00] = 0x410F_C241  # CPUID of a Cortex-M4
        self.pending = set()
        self.enabled = set()
        #: Active interrupts, each nested in the previous one.
        self.active = []

    def pend(self, irq):
        """Raises a peripheral's interrupt line. While its handler runs, the line is checked only after the return
        (DDI0403, B3.4.1)."""
        if irq not in self.active:
            self.pending.add(irq)

    def _priority(self, irq):
        return self.registers.get(IPR + (irq & ~3), 0) >> 8 * (irq % 4) & 0xFF

    def take(self):
        """Takes the interrupt to serve next, which is then no longer pending; `None` if there is none."""
        ready = self.pending & self.enabled
        if not ready:
            return None
        irq = min(ready, key=lambda irq: (self._priority(irq), irq))
        if self.active and self._priority(irq) >= self._priority(self.active[-1]):
            return None
        self.pending.discard(irq)
        self.active.append(irq)
        return irq

    def leave(self):
        """Marks the return of the handler that was entered last."""
        self.active.pop()

    def is_waiting(self):
        return bool(self.pending & self.enabled)

    def load(self, offset):
        group, word = offset & ~0x1F, (offset & 0x1F) // 4
        if group in (ISER, ICER):
            return self._bits(self.enabled, word)
        if group in (ISPR, ICPR):
            return self._bits(self.pending, word)
        return super().load(offset)

    @staticmethod
    def _bits(irqs, word):
        return sum(1 << irq % 32 for irq in irqs if irq // 32 == word)

    def store(self, offset, value):
        group, word = offset & ~0x1F, (offset & 0x1F) // 4
        irqs = {32 * word + bit for bit in range(32) if value >> bit & 1}
        if group == ISER:
            self.enabled |= irqs
        elif group == ICER:
            self.enabled -= irqs
        elif group == ISPR:
            self.pending |= irqs
        elif group == ICPR:
            self.pending -= irqs
        elif offset == STIR:
            self.pending.add(value & 0x1FF)
        elif offset == AIRCR:
            if value & 0xFFFF_0004 == RESET:
                self.board.request_reset("software")
        elif offset == CFSR:
            self.registers[CFSR] = self.registers.get(CFSR, 0) & ~value
        else:
            super().store(offset, value)

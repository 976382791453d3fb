"""The boards: the differences between the two microcontrollers, and the wiring.

All other peripherals have the same addresses and interrupts in RM0394 (STM32L4) and RM0440 (STM32G4).
"""

from dataclasses import dataclass


@dataclass(frozen=True)
class Wiring:
    """A microcontroller and its board."""

    flash_size: int
    ram_size: int
    #: Ports whose pins are used, and all others.
    ports: str
    other_ports: str
    #: Reset value of the clock control register, which tells the oscillators that run.
    oscillators: int
    #: The first converter, its internal inputs, and the inputs of the photointerrupters.
    converter: int
    reference: int
    thermometer: int
    inputs: list
    #: EXTSEL and EXTEN in CFGR for a rising edge of TIM6's trigger output.
    trigger: int
    #: Port and pin of each emitter.
    emitters: list


def pins(names):
    return [(name[0], int(name[1:])) for name in names.split()]


BOARDS = {
    "skinproc": Wiring(
        flash_size=256 * 1024,
        ram_size=64 * 1024,
        ports="AB",
        other_ports="CH",
        oscillators=0x63,
        converter=0x5004_0000,
        reference=0,
        thermometer=17,
        inputs=[5, 6, 7, 8, 9, 10, 11, 12],
        trigger=13 << 6 | 1 << 10,
        emitters=pins("B0 B1 B3 B4 B5 B6 B7 A8"),
    ),
    "nucleo-g491re": Wiring(
        flash_size=512 * 1024,
        ram_size=96 * 1024,  # and 16 KiB of CCM SRAM, unused
        ports="ABC",
        other_ports="DEFG",
        oscillators=0x500,
        converter=0x5000_0000,
        reference=18,
        thermometer=16,
        inputs=[1, 2, 15, 7, 6, 8, 9, 12],
        trigger=13 << 5 | 1 << 10,
        emitters=pins("B5 B10 A8 C7 B6 A7 A6 A5"),
    ),
}

"""The core: runs blocks of instructions, counts them, and takes interrupts between them.

Unicorn has no NVIC, so this module enters and leaves exceptions: it saves the core's state, reserves room on the
stack for the frame that hardware would push, and replaces the link register's magic value by a trap address that
signals the return of the handler.
"""

import struct

from unicorn import UC_ARCH_ARM, UC_HOOK_BLOCK, UC_HOOK_CODE, UC_HOOK_INTR, UC_MODE_MCLASS
from unicorn import UC_MODE_THUMB, UC_PROT_EXEC, UC_PROT_READ, Uc, UcError
from unicorn.arm_const import (
    UC_ARM_REG_LR,
    UC_ARM_REG_PC,
    UC_ARM_REG_PRIMASK,
    UC_ARM_REG_R0,
    UC_ARM_REG_R1,
    UC_ARM_REG_R2,
    UC_ARM_REG_R3,
    UC_ARM_REG_R12,
    UC_ARM_REG_SP,
    UC_ARM_REG_XPSR,
    UC_CPU_ARM_CORTEX_M4,
)

from .factory import FACTORY
from .nvic import CFSR, VTOR

RAM = 0x2000_0000
SYSTEM_MEMORY = 0x1FFF_0000
#: Return address of handlers: an unused address in ROM. Bit 2 is clear, as in the value that hardware gives a
#: handler that interrupted code on the main stack.
TRAP = SYSTEM_MEMORY + 0x1000
#: The bootloader in ROM: its stack pointer and entry point, which are its first two words. Its work is not
#: modelled: the core stops there, and the model reports the state that it was given.
ROM_STACK, ROM_START = 0x2000_2F40, SYSTEM_MEMORY + 0x100
UNIQUE_ID = 0x1FFF_7590
NMI, HARD_FAULT, FIRST_IRQ = 2, 3, 16
#: Size of the registers that hardware saves, including those of the floating-point unit.
FRAME = 26 * 4
#: Cycles for entering and leaving an exception, after Arm's manual for zero wait states.
ENTRY_CYCLES, EXIT_CYCLES = 12, 10
STACKED = [UC_ARM_REG_R0, UC_ARM_REG_R1, UC_ARM_REG_R2, UC_ARM_REG_R3, UC_ARM_REG_R12, UC_ARM_REG_LR]
#: Maximum number of instructions between two checks for pending interrupts.
SLICE = 20_000

WFE, SEV, CPSIE, SPIN = b"\x20\xbf", b"\x40\xbf", b"\x62\xb6", b"\xfe\xe7"
#: The second byte of a write to a special register; the last two of its four bytes select PRIMASK.
MSR, PRIMASK = 0xF3, b"\x10\x88"

#: Bits of CFSR.
IBUSERR, PRECISERR, STKERR, UNDEFINSTR = 1 << 8, 1 << 9, 1 << 12, 1 << 16


def is_msr_primask(code, at):
    return code[at + 1] == MSR and code[at] >> 4 == 8 and bytes(code[at + 2 : at + 4]) == PRIMASK


class Core:
    def __init__(self, board, image, code_end):
        self.board = board
        self.uc = uc = Uc(UC_ARCH_ARM, UC_MODE_THUMB | UC_MODE_MCLASS)
        uc.ctl_set_cpu_model(UC_CPU_ARM_CORTEX_M4)
        flash = 0x0800_0000
        code = bytearray(b"\xff" * (code_end - flash))
        for address, content in image.segments:
            if flash <= address < code_end:
                code[address - flash : address - flash + len(content)] = content
        uc.mem_map(flash, len(code), UC_PROT_READ | UC_PROT_EXEC)
        uc.mem_write(flash, bytes(code))
        uc.mem_map(RAM, board.wiring.ram_size)
        uc.mem_map(SYSTEM_MEMORY, 0x1_0000, UC_PROT_READ | UC_PROT_EXEC)
        uc.mem_write(TRAP, b"\x00\xbf" * 8)
        uc.mem_write(SYSTEM_MEMORY, struct.pack("<2I", ROM_STACK, ROM_START | 1))
        uc.mem_write(ROM_START, SPIN)
        uc.mem_write(UNIQUE_ID, board.serial)
        for address, value in FACTORY.items():
            uc.mem_write(address, struct.pack("<H", value))
        self.vectors = struct.unpack_from("<98I", code)
        self.lengths = {}
        uc.hook_add(UC_HOOK_BLOCK, self._enter_block)
        for at in range(0, len(code), 2):
            if bytes(code[at : at + 2]) in (WFE, SEV, CPSIE, SPIN) or is_msr_primask(code, at):
                where = flash + at
                uc.hook_add(UC_HOOK_CODE, self._at_instruction, begin=where, end=where)
        for where in (TRAP, ROM_START):
            uc.hook_add(UC_HOOK_CODE, self._at_instruction, begin=where, end=where)
        uc.hook_add(UC_HOOK_INTR, self._at_exception)
        #: Instructions executed, and other cycles, since the board was created.
        self.instructions, self.other_cycles = 0, 0
        self.deepest = RAM + board.wiring.ram_size
        self.wanted_pc = self.wanted_sp = None
        #: State in which the bootloader in ROM was entered.
        self.in_rom = None

    # Time

    @property
    def now(self):
        return self.instructions + self.other_cycles

    def stall(self, cycles):
        """Adds the cycles that the core waits for the flash."""
        self.other_cycles += cycles

    def reset(self):
        self.contexts = []
        self.nmi = self.event = False
        self.in_rom = None
        self.block, self.limit, self.stop, self.error = None, 0, None, None
        self.uc.reg_write(UC_ARM_REG_SP, self.vectors[0])
        self.uc.reg_write(UC_ARM_REG_PRIMASK, 0)
        self.pc = self.vectors[1] | 1
        self.stack_top = self.vectors[0]

    # Hooks: Unicorn calls them, and they stop it at the start of a block or an instruction

    def _instructions_in(self, start, end):
        """Number of instructions between two addresses."""
        count = self.lengths.get((start, end))
        if count is None:
            code = self.uc.mem_read(start, end - start)
            at = count = 0
            while at < len(code):
                first = code[at + 1] >> 3
                at += 4 if first in (0b11101, 0b11110, 0b11111) else 2
                count += 1
            self.lengths[start, end] = count
        return count

    def _leave_block(self, at=None):
        """Counts the block that has ended, up to the instruction `at`."""
        if self.block is not None:
            start, end = self.block
            self.instructions += self._instructions_in(start, end if at is None else at)
            self.block = None

    def _enter_block(self, uc, address, size, _data):
        self._leave_block()
        if self.instructions >= self.limit:
            self.stop = "limit"
            uc.emu_stop()
        else:
            self.block = (address, address + size)

    def _at_instruction(self, uc, address, _size, _data):
        if address == TRAP:
            self.stop = "return"
        else:
            instruction = bytes(uc.mem_read(address, 2))
            if instruction == SEV:
                self.event = True
                return
            if instruction == CPSIE or instruction[1] == MSR:
                self.limit = 0
                return
            self.stop = "wfe" if instruction == WFE else "spin"
            if address == ROM_START and self.in_rom is None:
                self.in_rom = self._entered_rom()
        self._leave_block(address)
        uc.emu_stop()

    def _at_exception(self, uc, _number, _data):
        self.stop = "undefined"
        uc.emu_stop()

    # Requests of peripherals

    def stop_soon(self):
        self.limit = 0

    def raise_soon(self, error):
        self.error, self.limit = error, 0

    def pend_nmi(self):
        self.nmi, self.limit = True, 0

    # Running

    def run(self, until):
        """Runs at least to the cycle `until`, or until a peripheral raises an error."""
        while self.now < until:
            self.board.advance()
            if self.error is not None:
                error, self.error = self.error, None
                raise error
            if self.wanted_pc is not None:
                self.pc, self.wanted_pc = self.wanted_pc, None
            if self.wanted_sp is not None:
                self.uc.reg_write(UC_ARM_REG_SP, self.wanted_sp)
                self.wanted_sp = None
            self._execute(until, most=self._take_exception())

    def _execute(self, until, most):
        """Runs to the next event, or `most` instructions."""
        ahead = min(self.board.next_event(), until) - self.now
        self.limit = self.instructions + max(1, min(int(ahead) + 1, most))
        self.stop = None
        try:
            self.uc.emu_start(self.pc, 0xFFFF_FFFE)
        except UcError:
            self._fault(IBUSERR if self._is_lost() else PRECISERR)
            return
        self.pc = self.uc.reg_read(UC_ARM_REG_PC) | 1
        if self.stop == "wfe":
            self.instructions += 1
            self.pc += 2
            if self.event:
                self.event = False
            else:
                self._sleep(until)
        elif self.stop == "spin":
            self._sleep(until)
        elif self.stop == "return":
            self._return()
        elif self.stop == "undefined":
            self._fault(UNDEFINSTR)

    def _sleep(self, until):
        """Advances time to the next interrupt that can be taken."""
        self.board.advance()
        while not self.board.nvic.is_waiting() and not self.nmi and self.error is None:
            if self.now >= until:
                break
            self.other_cycles += max(min(self.board.next_event(), until) - self.now, 1)
            self.board.advance()

    def _entered_rom(self):
        registers = self.board.nvic.registers
        return {
            "stack_pointer": self.uc.reg_read(UC_ARM_REG_SP),
            "vectors": registers.get(VTOR, 0),
            "interrupts_on": len(self.board.nvic.enabled),
            "changed": self.board.changed_registers(),
        }

    def _is_lost(self):
        """Whether the core is outside the code."""
        pc = self.uc.reg_read(UC_ARM_REG_PC)
        return not self.vectors[1] & ~0xFFFF <= pc < self.vectors[1] + self.board.code_size

    # Exceptions

    def _take_exception(self):
        """Enters the pending handler; returns how many instructions may pass until the next check."""
        self.deepest = min(self.deepest, self.uc.reg_read(UC_ARM_REG_SP))
        # Unicorn does not save the position in an IT block.
        if self.uc.reg_read(UC_ARM_REG_XPSR) & 0x0600_FC00:
            return 1
        if self.nmi:
            self.nmi = False
            self._enter(NMI)
        elif self._is_interruptible():
            irq = self.board.nvic.take()
            if irq is not None:
                self.event = True
                self._enter(FIRST_IRQ + irq)
        return SLICE

    def _is_interruptible(self):
        """Whether interrupts can be taken: no fault, no non-maskable interrupt, no critical section."""
        interrupts = len(self.board.nvic.active)
        return len(self.contexts) == interrupts and not self.uc.reg_read(UC_ARM_REG_PRIMASK)

    def _enter(self, vector):
        """Saves the core's state, and pushes the frame that a handler may read."""
        uc = self.uc
        self.contexts.append((uc.context_save(), self.pc))
        stacked = [uc.reg_read(register) for register in STACKED]
        stacked += [self.pc & ~1, uc.reg_read(UC_ARM_REG_XPSR)]
        sp = uc.reg_read(UC_ARM_REG_SP) - FRAME & ~7
        try:
            uc.mem_write(sp, struct.pack("<8I", *stacked))
        except UcError:
            # There is no memory: the fault handler runs instead, and the frame is lost.
            registers = self.board.nvic.registers
            registers[CFSR] = registers.get(CFSR, 0) | STKERR
            vector = HARD_FAULT
        uc.reg_write(UC_ARM_REG_SP, sp)
        uc.reg_write(UC_ARM_REG_LR, TRAP | 1)
        self.deepest = min(self.deepest, sp)
        self.pc = self.vectors[vector] | 1
        self.other_cycles += ENTRY_CYCLES

    def _return(self):
        context, self.pc = self.contexts.pop()
        self.uc.context_restore(context)
        self.other_cycles += EXIT_CYCLES
        if len(self.contexts) < len(self.board.nvic.active):
            self.board.nvic.leave()
        self.board.raise_lines()  # an interrupt whose cause persists is raised again

    def _fault(self, status):
        """Raises a hard fault for an instruction that the core cannot execute: no other handler is enabled."""
        self.pc = self.uc.reg_read(UC_ARM_REG_PC) | 1
        self._leave_block(None)
        registers = self.board.nvic.registers
        registers[CFSR] = registers.get(CFSR, 0) | status
        self._enter(HARD_FAULT)

"""The parts of an ELF file that the model needs: bytes for the flash, and symbols (TIS ELF specification 1.2)."""

import struct

PT_LOAD, SHT_SYMTAB = 1, 2


class Elf:
    def __init__(self, path):
        with open(path, "rb") as file:
            data = file.read()
        if data[:6] != b"\x7fELF\x01\x01":
            raise SystemExit(f"`{path}` is not an ELF file of 32 bits, little-endian")
        phoff, shoff = struct.unpack_from("<II", data, 28)
        phentsize, phnum, shentsize, shnum = struct.unpack_from("<HHHH", data, 42)
        #: Physical address and content of the loaded segments.
        self.segments = []
        for i in range(phnum):
            kind, offset, _, address, size = struct.unpack_from("<5I", data, phoff + i * phentsize)
            if kind == PT_LOAD and size:
                self.segments.append((address, data[offset : offset + size]))
        #: Address of each symbol by name.
        self.symbols = {}
        sections = [
            struct.unpack_from("<10I", data, shoff + i * shentsize) for i in range(shnum)
        ]
        for section in sections:
            if section[1] == SHT_SYMTAB:
                strings = sections[section[6]][4]
                for at in range(section[4], section[4] + section[5], 16):
                    name, value = struct.unpack_from("<II", data, at)
                    start = strings + name
                    self.symbols[data[start : data.index(b"\0", start)].decode()] = value

"""Machine code of an object file, put into memory as it is: without LLVM, whose library takes 50 MB.

The object files of our own kernels (ELF, x86-64, the large code model of just-in-time compilers) ask for one kind of
relocation only: the address of something, as 64 bits. Whatever else is in a file, or is not as it should be there, is
left to LLVM.
"""

from __future__ import annotations

import ctypes
import mmap
import platform
import struct
from collections.abc import Callable, Mapping
from dataclasses import dataclass

_HEADER = struct.Struct("<16s2HI3QI6H")
_SECTION = struct.Struct("<2I4Q2I2Q")
_SYMBOL = struct.Struct("<I2BH2Q")
_RELOCATION = struct.Struct("<2Qq")
_IDENTITY = b"\x7fELF\x02\x01\x01"  # 64 bits, little-endian
_RELOCATABLE, _X86_64 = 1, 62
_CODE_OR_DATA, _SYMBOLS, _WITH_ADDEND, _ZEROS, _WITHOUT_ADDEND = 1, 2, 4, 8, 9
_WRITABLE, _IN_MEMORY, _THREAD = 0x1, 0x2, 0x400
_ADDRESS = 1  # R_X86_64_64: symbol + addend
_UNDEFINED = 0


class UnknownError(Exception):
    """Something of an object file that is not known here."""


@dataclass(frozen=True)
class _Section:
    kind: int
    flags: int
    offset: int
    size: int
    link: int
    info: int
    alignment: int

    @property
    def loaded(self) -> bool:
        return self.kind == _CODE_OR_DATA and bool(self.flags & _IN_MEMORY)


class ObjectFile:
    """An object file; raises UnknownError where there is something in it that is not known here."""

    def __init__(self, content: bytes) -> None:
        try:
            identity, kind, machine, _, _, _, at, _, _, _, _, size, count, _ = _HEADER.unpack_from(content)
            known = identity.startswith(_IDENTITY) and (kind, machine, size) == (_RELOCATABLE, _X86_64, _SECTION.size)
            if not known:
                raise UnknownError("no object file of x86-64")
            rows = [_SECTION.unpack_from(content, at + i * size) for i in range(count)]
            sections = [_Section(r[1], r[2], r[4], r[5], r[6], r[7], r[8]) for r in rows]
        except (struct.error, IndexError) as error:
            raise UnknownError(str(error)) from error
        for section in sections:
            if section.kind == _ZEROS or section.flags & _THREAD or (section.loaded and section.flags & _WRITABLE):
                raise UnknownError("a section that is written to")
            if section.offset + section.size > len(content):
                raise UnknownError("a section that is cut off")
        tables = [section for section in sections if section.kind == _SYMBOLS]
        if len(tables) != 1:
            raise UnknownError("not one table of symbols")
        self._content, self._sections = content, sections
        if tables[0].link >= len(sections) or tables[0].size % _SYMBOL.size:
            raise UnknownError("symbols without names")
        names = sections[tables[0].link]
        text = content[names.offset : names.offset + names.size]
        found = _SYMBOL.iter_unpack(content[tables[0].offset : tables[0].offset + tables[0].size])
        # Its name, its section, and where it is there.
        self._symbols = [(text[s[0] :].partition(b"\0")[0].decode(errors="replace"), s[3], s[4]) for s in found]

    def loaded(self, functions: Mapping[str, int]) -> Callable[[str], int]:
        """The code in memory, for good: the address of each of its functions, which may call others at addresses.

        Raises UnknownError, and OSError where the system does not let code into memory.
        """
        places, size = {}, 0
        for number, section in enumerate(self._sections):
            if section.loaded:
                places[number] = size = -(-size // max(section.alignment, 16)) * max(section.alignment, 16)
                size += section.size
        image = bytearray(size)
        for number, place in places.items():
            section = self._sections[number]
            image[place : place + section.size] = self._content[section.offset : section.offset + section.size]
        pages = _Pages(size)
        for section in self._sections:
            if section.kind == _WITHOUT_ADDEND and section.info in places:
                raise UnknownError("relocations without addends")
            if section.kind == _WITH_ADDEND and section.info in places:
                self._relocate(section, image, places, pages.address, functions)
        pages.seal(image)
        known = {name: (home, value) for name, home, value in self._symbols if name and home in places}

        def address(name: str) -> int:
            home, value = known[name]
            return int(pages.address + places[home] + value)

        return address

    def _relocate(
        self, table: _Section, image: bytearray, places: Mapping[int, int], base: int, functions: Mapping[str, int]
    ) -> None:
        target = self._sections[table.info]
        rows = self._content[table.offset : table.offset + table.size - table.size % _RELOCATION.size]
        for offset, info, addend in _RELOCATION.iter_unpack(rows):
            known = info & 0xFFFFFFFF == _ADDRESS and info >> 32 < len(self._symbols)
            if not known or offset + 8 > target.size:
                raise UnknownError(f"relocation {info & 0xFFFFFFFF}")
            name, home, value = self._symbols[info >> 32]
            if home == _UNDEFINED:
                if name not in functions:
                    raise UnknownError(f"function {name}")
                place = functions[name]
            elif home in places:
                place = base + places[home] + value
            else:
                raise UnknownError("an address in what is not loaded")
            struct.pack_into("<Q", image, places[table.info] + offset, place + addend)


class _Pages:
    """Memory that is first written to, then executed, and never both; it stays until the process ends."""

    def __init__(self, size: int) -> None:
        self._size = max(-(-size // mmap.PAGESIZE), 1) * mmap.PAGESIZE
        self._library = ctypes.CDLL(None, use_errno=True)
        self._library.mmap.restype = ctypes.c_void_p
        self._library.mmap.argtypes = [ctypes.c_void_p, ctypes.c_size_t, *([ctypes.c_int] * 3), ctypes.c_long]
        self._library.mprotect.argtypes = [ctypes.c_void_p, ctypes.c_size_t, ctypes.c_int]
        private = mmap.MAP_PRIVATE | mmap.MAP_ANONYMOUS
        address = self._library.mmap(None, self._size, mmap.PROT_READ | mmap.PROT_WRITE, private, -1, 0)
        if address in (None, ctypes.c_void_p(-1).value):
            raise OSError(ctypes.get_errno(), "no memory for code")
        self.address = int(address)

    def seal(self, image: bytearray) -> None:
        """Fill them; from now on they are code."""
        ctypes.memmove(self.address, bytes(image), len(image))
        if self._library.mprotect(self.address, self._size, mmap.PROT_READ | mmap.PROT_EXEC) != 0:
            raise OSError(ctypes.get_errno(), "memory must not become code here")


def here() -> bool:
    """Whether this machine runs such files: Linux on x86-64."""
    return platform.system() == "Linux" and platform.machine() == "x86_64"

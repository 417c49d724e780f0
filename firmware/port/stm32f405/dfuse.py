# SPDX-License-Identifier: Apache-2.0
"""An ELF file's flash contents as a DfuSe file, which dfu-util writes without touching the sectors between its parts.

Format: ST, UM0391 "DfuSe file format specification" rev. 1; the suffix: USB DFU specification 1.1, appendix B.
"""

from __future__ import annotations

import argparse
import struct
import subprocess
import tempfile
import zlib
from pathlib import Path

VENDOR, PRODUCT = 0x0483, 0xDF11  # ST's boot loader


def parts(elf: Path, tools: str) -> list[tuple[int, bytes]]:
    """Address and contents of each contiguous part of the image, by way of Intel hex."""
    with tempfile.TemporaryDirectory() as folder:
        hex_file = Path(folder) / "image.hex"
        subprocess.run([f"{tools}objcopy", "-O", "ihex", str(elf), str(hex_file)], check=True)
        lines = hex_file.read_text("ascii").split()
    found: list[tuple[int, bytearray]] = []
    base = 0
    for line in lines:
        record = bytes.fromhex(line[1:])
        count, low, kind = struct.unpack(">BHB", record[:4])
        data = record[4 : 4 + count]
        if kind == 4:
            base = int.from_bytes(data, "big") << 16
        elif kind == 0:
            if not found or found[-1][0] + len(found[-1][1]) != base + low:
                found.append((base + low, bytearray()))
            found[-1][1].extend(data)
    return [(address, bytes(data)) for address, data in found]


def dfuse(images: list[tuple[int, bytes]]) -> bytes:
    """The file: prefix, one target of several elements, suffix with CRC."""
    elements = b"".join(struct.pack("<II", address, len(data)) + data for address, data in images)
    target = struct.pack("<6sBI255sII", b"Target", 0, 1, b"Kontur", len(elements), len(images)) + elements
    body = struct.pack("<5sBIB", b"DfuSe", 1, 11 + len(target), 1) + target
    body += struct.pack("<HHHH3sB", 0xFFFF, PRODUCT, VENDOR, 0x011A, b"UFD", 16)
    return body + struct.pack("<I", ~zlib.crc32(body) & 0xFFFFFFFF)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("elf", type=Path)
    parser.add_argument("output", type=Path)
    parser.add_argument("--tools", default="arm-none-eabi-", help="prefix of the binutils")
    options = parser.parse_args()
    options.output.write_bytes(dfuse(parts(options.elf, options.tools)))


if __name__ == "__main__":
    main()

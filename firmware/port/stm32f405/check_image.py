# SPDX-License-Identifier: Apache-2.0
"""What must not be in the image is not in it, and what is in it fits: sizes, symbols, archive members.

Exit code 1 and one line for each finding.
"""

from __future__ import annotations

import argparse
import re
import subprocess
import sys
from pathlib import Path

# The chip's own (RM0090 2.3): flash without the sectors of the parameters, the RAM that is in one piece, and CCM
FLASH_MAX, RAM_MAX, CCM_MAX = (1024 - 48) * 1024, (112 + 16) * 1024, 64 * 1024
FREE = 0.15
FORBIDDEN = {
    # Run-time ABI for the ARM architecture (IHI 0043), 4.1.2: arithmetic on double, and conversions from and to it
    "double-precision helper": r"__aeabi_(c?d(add|sub|rsub|mul|div|neg|cmp\w*|2\w+)|\w+2d)$"
    r"|__\w+df\d?$|__\w*df[sdt]i\w*$",
    "heap": r"_?(malloc|free|calloc|realloc|memalign)(_r)?$|_sbrk(_r)?$",
    "printf": r"_?[svnf]*(printf|scanf)\w*$",
}
LIBRARIES = {"libm": r"libm(_nano)?\.a", "libstdc++": r"libstdc\+\+", "libnosys": r"libnosys"}


def section_sizes(elf: Path, tools: str) -> dict[str, int]:
    """Bytes of each section that takes memory."""
    text = subprocess.run([f"{tools}size", "-A", str(elf)], check=True, capture_output=True, text=True).stdout
    rows = (line.split() for line in text.splitlines())
    return {
        row[0]: int(row[1]) for row in rows if len(row) == 3 and row[0].startswith(".") and int(row[2]) >= 0x08000000
    }


def findings(elf: Path, map_text: str, tools: str) -> list[str]:
    """What is wrong with the image, a line each."""
    symbols = subprocess.run([f"{tools}nm", str(elf)], check=True, capture_output=True, text=True).stdout.split("\n")
    names = [line.split()[-1] for line in symbols if line]
    found = [
        f"{what}: {name} is in the image"
        for what, pattern in FORBIDDEN.items()
        for name in names
        if re.match(pattern, name)
    ]
    members = map_text.split("Memory Configuration", 1)[0]
    found += [
        f"{what}: linked, see the head of the map" for what, pattern in LIBRARIES.items() if re.search(pattern, members)
    ]
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("elf", type=Path)
    parser.add_argument("--map", type=Path, required=True)
    parser.add_argument("--tools", default="arm-none-eabi-", help="prefix of the binutils")
    options = parser.parse_args()
    sizes = section_sizes(options.elf, options.tools)
    flash = sum(sizes.get(name, 0) for name in (".boot", ".text", ".data"))
    ram = sum(sizes.get(name, 0) for name in (".stack", ".noinit", ".data", ".bss"))
    ccm = sizes.get(".ccm", 0)
    found = findings(options.elf, options.map.read_text(), options.tools)
    for what, size, limit in (("flash", flash, FLASH_MAX), ("RAM", ram, RAM_MAX), ("CCM", ccm, CCM_MAX)):
        if size > (1 - FREE) * limit:
            found.append(f"{what}: {size} bytes; {FREE:.0%} of {limit} must be free")
    print(
        f"{options.elf}: flash {flash} of {FLASH_MAX} bytes, RAM {ram} of {RAM_MAX},"
        f" {sizes.get('.stack', 0)} of it for the stack, CCM {ccm} of {CCM_MAX}"
    )
    print("\n".join(found) if found else "no double-precision helper, heap, printf or libm in it")
    sys.exit(1 if found else 0)


if __name__ == "__main__":
    main()

# SPDX-License-Identifier: Apache-2.0
"""Each image within the chip, with a reserve (RM0090 2.3: 1 MiB of flash, 128 KiB of RAM in one piece, 64 KiB CCM)."""

import subprocess

import numpy as np
from board import IMAGES, Board
from chip import CCM, CCM_BYTES, FLASH_BYTES, RAM, RAM_BYTES, STORE

from kontur.can import wire

RESERVE = 0.15


def _symbols(board: Board) -> dict[str, int]:
    ran = subprocess.run(
        ["arm-none-eabi-nm", str(IMAGES / f"{board.wiring.image}.elf")], check=True, capture_output=True, text=True
    )
    rows = (line.split() for line in ran.stdout.splitlines())
    return {row[2]: int(row[0], 16) for row in rows if len(row) == 3}


def test_flash_and_ram_have_a_reserve(board: Board) -> None:
    """`board` maps no more memory than the chip has, so that a larger image does not load."""
    at = _symbols(board)
    ram = at["kontur_bss_end"] - RAM
    flash = at["kontur_data_load"] + at["kontur_data_end"] - at["kontur_data"] - 0x08010000 + 0x10000
    ccm = at["kontur_ccm_end"] - CCM
    assert (RAM_BYTES, CCM_BYTES) == ((112 + 16) * 1024, 64 * 1024)
    assert ram <= (1 - RESERVE) * RAM_BYTES, f"{ram} bytes of RAM"
    assert ccm <= (1 - RESERVE) * CCM_BYTES, f"{ccm} bytes of CCM"
    assert flash <= (1 - RESERVE) * (FLASH_BYTES - len(STORE)), f"{flash} bytes of flash"


def test_the_knots_fill_the_largest_ring_that_fits_into_the_core_coupled_memory(board: Board) -> None:
    board.start()
    size = board.read(0x60C4, 2)
    ring_bytes = _symbols(board)["kontur_ccm_end"] - CCM
    assert 12 * size < ring_bytes <= CCM_BYTES < 2 * ring_bytes
    assert board.read(0x2200, 6) == size
    board.enable()
    board.write(0x2200, 1, 1, 1)  # begin
    knots_nm = np.array([[5, -7], [10, -14], [15, -21]], dtype=np.int32)
    frames = wire.pack_knots(knots_nm, (0, 0))
    for at in range(0, len(frames), 8):
        board.send(0x301, frames[at : at + 8])
        board.run(0.3)
    assert board.read(0x2200, 7) == len(knots_nm)
    assert bytes(board.uc.mem_read(CCM + ring_bytes - 12 * (size + 32), knots_nm.nbytes)) == knots_nm.tobytes()


def test_the_stack_that_was_used_has_a_reserve(board: Board) -> None:
    """RAM has a pattern at power-on. tools/cost.py has the bound of all that could be used."""
    board.power_on()
    at = _symbols(board)
    bottom, top = at["kontur_stack_bottom"], at["kontur_stack_top"]
    before = bytes(board.uc.mem_read(bottom, top - bottom))
    assert board.run_until(lambda: any(f[1] == 0x701 for f in board.can.sent), 200), board.state()
    board.write(0x2106, 1, 5_000_000, 4)  # a screw: the configuration is calculated anew
    board.run(3)
    board.enable()
    board.gpio("C").outside[5] = True  # the amplifier of x
    board.run(20)
    assert board.read(0x603F) == 0x5400
    after = bytes(board.uc.mem_read(bottom, top - bottom))
    used = top - bottom - next(n for n in range(top - bottom) if before[n] != after[n])
    assert 1000 < used <= (1 - RESERVE) * (top - bottom), f"{used} bytes of the stack"

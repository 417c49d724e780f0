# SPDX-License-Identifier: Apache-2.0
"""The scaling module against values worked out without it."""

import struct

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from kontur.can import wire
from kontur.errors import PathError


def i24(value: int) -> bytes:
    return (value & 0xFFFFFF).to_bytes(3, "little")


def bitwise_crc8(data: bytes) -> int:
    """The definition of CRC-8/AUTOSAR, bit by bit."""
    crc = 0xFF
    for octet in data:
        crc ^= octet
        for _ in range(8):
            crc = ((crc << 1) ^ 0x2F if crc & 0x80 else crc << 1) & 0xFF
    return crc ^ 0xFF


def test_crc_has_the_published_check_value() -> None:
    assert wire.crc8(np.frombuffer(b"123456789", dtype=np.uint8)) == 0xDF


@given(st.binary(min_size=7, max_size=7))
def test_crc_equals_its_definition(data: bytes) -> None:
    assert wire.crc8(np.frombuffer(data, dtype=np.uint8)) == bitwise_crc8(data)


def test_knot_frames_carry_number_crc_and_differences() -> None:
    knots = np.array([[1_000_000, -5], [1_000_001, -300_005], [999_999, 0]], dtype=np.int32)
    frames = wire.pack_knots(knots, (1_000_000, 0))
    for i, (dx, dy) in enumerate([(0, -5), (1, -300_000), (-2, 300_005)]):
        body = i24(dx) + i24(dy)
        assert frames[8 * i : 8 * i + 8] == bytes([i, bitwise_crc8(bytes([i]) + body)]) + body


def test_knot_number_wraps_after_255() -> None:
    frames = wire.pack_knots(np.zeros((300, 2), dtype=np.int32), (0, 0))
    assert [frames[8 * i] for i in (0, 255, 256, 299)] == [0, 255, 0, 43]


def test_difference_of_24_bits_fits_and_one_more_is_refused() -> None:
    wire.pack_knots(np.array([[8_388_607, -8_388_607]], dtype=np.int32), (0, 0))
    with pytest.raises(PathError, match=r"knot 1: a step of 8\.389 mm in 1 ms"):
        wire.pack_knots(np.array([[0, 0], [8_388_608, 0]], dtype=np.int32), (0, 0))


def test_status_is_two_statuswords_free_and_accepted() -> None:
    status = wire.unpack_status(bytes.fromhex("3710 3712 ff01 0a00"))
    assert status == wire.Status((0x1037, 0x1237), 511, 10)


def telemetry(frames: list[tuple[int, bytes]], start_nm: tuple[int, int] = (0, 0)) -> wire.Telemetry:
    function = np.array([f for f, _ in frames], dtype=np.int64)
    payload = np.frombuffer(b"".join(d for _, d in frames), dtype=np.uint8).reshape(-1, 8)
    return wire.unpack_telemetry(function, payload, start_nm)


def millisecond(tick: int, error: tuple[int, int], position: tuple[int, int]) -> list[tuple[int, bytes]]:
    head = struct.pack("<H", tick & 0xFFFF)
    return [
        (wire.TPDO2, head + i24(error[0]) + i24(error[1])),
        (wire.TPDO3, head + i24(position[0]) + i24(position[1])),
    ]


def test_telemetry_is_scaled_to_si() -> None:
    frames = millisecond(7, (-1500, 42), (3, -4))
    frames.append((wire.TPDO4, struct.pack("<hhHH", -1234, 567, 1000, 1)))
    frames.append((wire.TPDO5, struct.pack("<HHI", 1000, 2500, 123456)))
    frames.append((wire.TPDO6, struct.pack("<ii", -70_001, 12)))
    row = telemetry(frames)
    assert row.tick.tolist() == [7]
    np.testing.assert_allclose(row.columns("tangential_error", "contour_error"), [[-1.5e-6, 42e-9]], rtol=1e-12)
    np.testing.assert_allclose(row.position_m, [[3e-9, -4e-9]], rtol=1e-12)
    np.testing.assert_allclose(row.columns("force_x", "force_y"), [[-123.4, 56.7]], rtol=1e-12)
    np.testing.assert_allclose(row.columns("adaptive_gain_1", "adaptive_gain_2"), [[100.0, 0.1]], rtol=1e-12)
    np.testing.assert_allclose(row.columns("switching_gain_1", "switching_gain_2"), [[1.0, 2.5]], rtol=1e-12)
    np.testing.assert_allclose(row.values["energy"], [123.456], rtol=1e-12)
    np.testing.assert_allclose(
        row.columns("contour_error_least", "contour_error_greatest"), [[-70.001e-6, 12e-9]], rtol=1e-12
    )


def test_tick_and_position_continue_past_their_wrap() -> None:
    x = [8_388_000 + 500 * i for i in range(4)]
    frames = [f for i in range(4) for f in millisecond(65_534 + i, (0, 0), (x[i], -x[i]))]
    run = telemetry(frames, start_nm=(8_387_000, -8_387_000))
    assert run.tick.tolist() == [65_534, 65_535, 65_536, 65_537]
    np.testing.assert_allclose(run.position_m[:, 0], np.array(x) * 1e-9, rtol=1e-12)
    np.testing.assert_allclose(run.position_m[:, 1], np.array(x) * -1e-9, rtol=1e-12)


def test_start_position_completes_the_missing_bits() -> None:
    run = telemetry(millisecond(0, (0, 0), (-145_000_100, 145_000_100)), start_nm=(-145_000_000, 145_000_000))
    np.testing.assert_allclose(run.position_m, [[-0.1450001, 0.1450001]], rtol=1e-12)


def test_gap_in_the_ticks_counts_as_lost_frames() -> None:
    frames = [f for i in (0, 1, 2, 6, 7) for f in millisecond(i, (i, 0), (i, 0))]
    del frames[2]  # TPDO2 of tick 1
    run = telemetry(frames)
    assert run.tick.tolist() == [0, 2, 6, 7]
    assert run.frames_lost == 3 + 1 + 3


def test_telemetry_that_was_repeated_swapped_or_corrupted_is_put_right_or_left_out() -> None:
    frames = [f for i in range(40) for f in millisecond(i, (i, 0), (100 * i, 0))]
    frames[10:12] = [frames[11], frames[10], frames[11]]  # tick 5: swapped, and once too often
    frames[30], frames[32] = frames[32], frames[30]  # TPDO3 of 14 and 15
    for at, byte, bit in ((24, 1, 7), (50, 0, 6), (62, 4, 7), (70, 1, 3)):  # ticks, and the x of a position
        cob, data = frames[at]
        frames[at] = (cob, data[:byte] + bytes([data[byte] ^ 1 << bit]) + data[byte + 1 :])
    run = telemetry(frames)
    assert (np.diff(run.tick) > 0).all()
    assert set(run.tick.tolist()) > set(range(40)) - {11, 12, 14, 15, 24, 25, 29, 30, 34, 35}
    np.testing.assert_allclose(run.position_m[:, 0], run.tick * 100e-9, atol=101e-9)
    assert run.frames_lost == 4


def test_slow_telemetry_is_held_and_unknown_before_it_came() -> None:
    frames = millisecond(0, (0, 0), (0, 0)) + millisecond(1, (0, 0), (0, 0))
    frames.append((wire.TPDO4, struct.pack("<hhHH", 10, 20, 30, 40)))
    frames += millisecond(2, (0, 0), (0, 0))
    run = telemetry(frames)
    assert np.isnan(run.columns("force_x", "force_y")[0]).all()
    np.testing.assert_allclose(run.values["force_x"][1:], [1.0, 1.0], rtol=1e-12)
    assert np.isnan(run.values["energy"]).all()


def test_no_telemetry_gives_an_empty_run() -> None:
    run = telemetry([])
    assert len(run.tick) == 0
    assert run.frames_lost == 0


@pytest.mark.parametrize(("loss", "late"), [(0.0, False), (0.1, True), (0.5, True)])
def test_telemetry_in_pieces_is_that_of_the_whole_run(loss: float, late: bool) -> None:
    draw = np.random.default_rng(5)
    frames: list[tuple[int, bytes]] = []
    for i in range(4000):
        position = (int(27e6 * np.sin(i / 900.0)), int(20e6 * np.cos(i / 700.0)))
        both = millisecond(65_000 + i, (i, -i), position)
        slow = [(wire.TPDO4, struct.pack("<hhHH", i, -i, 4, 5))] if i % 10 == 3 else []
        frames += [frame for frame in both + slow if draw.random() >= loss]
    for at in draw.integers(0, len(frames) - 30, 100 if late else 0):
        frames.insert(int(at) + int(draw.integers(1, 30)), frames.pop(int(at)))
    start_nm = (0, 20_000_000)
    whole = telemetry(frames, start_nm)

    stream, pieces = wire.TelemetryStream(start_nm), []
    function = np.array([f for f, _ in frames], dtype=np.int64)
    payload = np.frombuffer(b"".join(d for _, d in frames), dtype=np.uint8).reshape(-1, 8)
    while len(function):
        count = int(draw.integers(0, 1500))
        pieces.append(stream.add(function[:count], payload[:count]))
        function, payload = function[count:], payload[count:]
    pieces.append(stream.add(function, payload, last=True))
    np.testing.assert_array_equal(np.concatenate([piece.tick for piece in pieces]), whole.tick)
    for name, values in whole.values.items():
        np.testing.assert_array_equal(np.concatenate([piece.values[name] for piece in pieces]), values)
    assert stream.frames_lost == whole.frames_lost


@pytest.mark.parametrize("before", [0, 1, 3])
def test_path_begins_at_the_tick_after_the_first_status_that_says_so(before: int) -> None:
    """Also where this status is the first frame of all, and where the tick wraps."""
    standing = (wire.TPDO1, struct.pack("<HHHH", 0x1237, 0x237, 0, 9))
    running = (wire.TPDO1, struct.pack("<HHHH", 0x1237, 0x1237, 0, 9))
    frames = [standing, *(f for i in range(before) for f in millisecond(65_533 + i, (0, 0), (0, 0)))]
    frames += [running, *(f for i in range(before, 9) for f in millisecond((65_533 + i) % 65_536, (0, 0), (0, 0)))]
    stream = wire.TelemetryStream((0, 0))
    function = np.array([f for f, _ in frames], dtype=np.int64)
    payload = np.frombuffer(b"".join(d for _, d in frames), dtype=np.uint8).reshape(-1, 8)
    rows = stream.add(function, payload, last=True)
    assert stream.path_began == 65_533 + before
    assert rows.tick.tolist() == [*range(65_533, 65_542)]

# SPDX-License-Identifier: Apache-2.0
"""The object dictionary's one source: what is committed is what it generates, and its mistakes are caught."""

from __future__ import annotations

import configparser
import logging
import re
import sys
from pathlib import Path

import canopen
import generate_objects
import objects
import pytest
from source import SourceError

ROOT = Path(__file__).resolve().parents[2]
EDS = ROOT / "host" / "kontur" / "kontur.eds"
UNITS = EDS.with_name("kontur-units.eds")

HEAD = """
[device]
vendor = "V"
product = "P"
product_code = 1
revision = 1
[pdo]
[object]
"""


@pytest.fixture(scope="module")
def od() -> canopen.ObjectDictionary:
    return canopen.import_od(str(UNITS), node_id=5)


def load(tmp_path: Path, text: str) -> list[objects.Object]:
    """The objects of a source that is HEAD and `text`."""
    path = tmp_path / "objects.toml"
    path.write_text(HEAD + text, "utf-8")
    return objects.load(path)[1]


# ---- what is committed ----


def test_what_is_committed_is_what_the_source_generates(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    committed = {
        "--eds": EDS,
        "--units": UNITS,
        "--dbc": EDS.with_suffix(".dbc"),
        "--docs": ROOT / "docs" / "objects.md",
    }
    committed["--controllers"] = EDS.parent / "controllers.json"
    options = [text for option, path in committed.items() for text in (option, str(tmp_path / path.name))]
    monkeypatch.setattr(sys, "argv", ["generate_objects.py", str(tmp_path), *options])
    assert generate_objects.main() == 0
    for path in committed.values():
        made = (tmp_path / path.name).read_bytes()
        assert made == path.read_bytes(), f"objects.toml changed: run `make lib` and commit {path.name}"


# ---- the EDS ----


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("file", [EDS, UNITS], ids=lambda file: file.name)
def test_eds_loads_in_python_canopen_without_a_warning(file: Path, caplog: pytest.LogCaptureFixture) -> None:
    with caplog.at_level(logging.INFO):
        canopen.import_od(str(file), node_id=5)
    assert not caplog.records


def test_units_are_all_that_the_eds_with_units_has_besides() -> None:
    more = re.compile("(StorageLocation|Factor|Unit|Description)=")
    plain, with_units = (
        [line for line in file.read_text("ascii").splitlines() if not line.startswith(("FileName=", "Line1="))]
        for file in (EDS, UNITS)
    )
    assert [line for line in with_units[6:] if not more.match(line)] == plain[6:]


@pytest.fixture(scope="module")
def sections() -> configparser.RawConfigParser:
    """The EDS as the file it is; keys as they are written."""
    eds = configparser.RawConfigParser(strict=True)  # strict: no section and no key twice
    eds.optionxform = str  # type: ignore[assignment,method-assign]
    eds.read(EDS, "ascii")
    return eds


def test_eds_describes_file_and_device_as_cia_306_wants(
    sections: configparser.RawConfigParser, od: canopen.ObjectDictionary
) -> None:
    assert {
        "FileName", "FileVersion", "FileRevision", "EDSVersion", "Description", "CreationTime", "CreationDate",
        "CreatedBy", "ModificationTime", "ModificationDate", "ModifiedBy",
    } == set(sections["FileInfo"])  # fmt: skip
    assert sections["FileInfo"]["FileName"] == EDS.name
    info = sections["DeviceInfo"]
    assert {
        "VendorName", "VendorNumber", "ProductName", "ProductNumber", "RevisionNumber", "OrderCode",
        *(f"BaudRate_{rate}" for rate in (10, 20, 50, 125, 250, 500, 800, 1000)), "SimpleBootUpMaster",
        "SimpleBootUpSlave", "Granularity", "DynamicChannelsSupported", "GroupMessaging", "NrOfRXPDO", "NrOfTXPDO",
        "LSS_Supported",
    } <= set(info)  # fmt: skip
    assert int(info["VendorNumber"], 0) == od["identity.vendor_id"].default
    assert int(info["ProductNumber"], 0) == od["identity.product_code"].default
    assert int(info["RevisionNumber"], 0) == od["identity.revision"].default
    assert int(info["NrOfRXPDO"]) == sum(0x1400 <= index < 0x1600 for index in od) > 0
    assert int(info["NrOfTXPDO"]) == sum(0x1800 <= index < 0x1A00 for index in od) > 0
    assert int(info["Granularity"]) == 8  # bits: mapping goes by whole bytes
    assert info["SimpleBootUpSlave"] == "1"
    assert sections["DummyUsage"] == {f"Dummy{i:04d}": str(int(i > 1)) for i in range(1, 8)}
    assert int(sections["Comments"]["Lines"]) == len(sections["Comments"]) - 1


def test_eds_describes_every_object_and_entry_as_cia_306_wants(sections: configparser.RawConfigParser) -> None:
    for name in sections.sections():
        if not re.fullmatch("[0-9A-F]{4}(sub[0-9A-F]+)?", name):
            continue
        section = sections[name]
        assert section["ParameterName"]
        if section["ObjectType"] in ("0x2", "0x7"):  # a domain, a variable
            assert section["AccessType"] in ("ro", "wo", "rw", "const"), name
            mapping = (None,) if section["ObjectType"] == "0x2" else ("0", "1")
            assert section.get("PDOMapping") in mapping, name
            assert int(section["DataType"], 16) in range(1, 0x1C), name
        else:
            subs = [other for other in sections.sections() if other.startswith(f"{name}sub")]
            assert section["ObjectType"] in ("0x8", "0x9"), name
            assert int(section["SubNumber"]) == len(subs) > 1, name
            assert sections[f"{name}sub0"]["DataType"] == "0x0005", name


def test_eds_is_ascii() -> None:
    assert EDS.read_bytes().isascii()


def test_eds_lists_every_object_once_in_its_section(sections: configparser.RawConfigParser) -> None:
    eds = sections
    listed = {}
    for section in ("MandatoryObjects", "OptionalObjects", "ManufacturerObjects"):
        count = eds.getint(section, "SupportedObjects")
        listed[section] = [int(eds[section][str(i)], 16) for i in range(1, count + 1)]
        assert len(eds[section]) == count + 1
    assert listed["MandatoryObjects"] == [0x1000, 0x1001, 0x1018]
    assert all(0x2000 <= index < 0x6000 for index in listed["ManufacturerObjects"])
    assert not any(0x2000 <= index < 0x6000 for index in listed["OptionalObjects"])
    found = [int(name, 16) for name in eds.sections() if len(name) == 4]
    assert sorted(found) == sorted(index for indices in listed.values() for index in indices)


def test_eds_has_factor_unit_limits_and_description_of_a_parameter(od: canopen.ObjectDictionary) -> None:
    entry = od["motor_x.power_factor"]
    assert (entry.index, entry.subindex, entry.factor, entry.unit) == (0x2101, 4, 1e-3, "")
    assert (entry.default, entry.min, entry.max) == (900, 1, 1000)
    assert entry.description == "cos phi"
    encoder = od["plant_y.encoder"]
    assert (encoder.index, encoder.default, encoder.factor, encoder.unit) == (0x2900, 7_629_000, 1e-8, "um")


def test_axes_differ_where_the_source_says_so(od: canopen.ObjectDictionary) -> None:
    assert (od["plant_x.mass"].default, od["plant_y.mass"].default) == (88_080, 97_900)
    assert (od["statusword_x"].index, od["statusword_y"].index) == (0x6041, 0x6841)
    assert od["axis_device_type_y"].index == 0x6FFF


def test_negative_limits_and_defaults_survive(od: canopen.ObjectDictionary) -> None:
    low = od["position_limit_x.min"]
    assert (low.default, low.min, low.max) == (-150_000_000, -2_000_000_000, 2_000_000_000)


def test_cob_ids_depend_on_the_node_id(od: canopen.ObjectDictionary) -> None:
    assert od["emcy_cob_id"].default == 0x85
    assert od["tpdo5.cob_id"].default == 0xC0000685
    assert od["rpdo2.cob_id"].default == 0x305


@pytest.mark.parametrize(
    ("index", "bits"),
    [(0x1600, 32), (0x1601, 64), (0x1A00, 64), (0x1A01, 64), (0x1A02, 64), (0x1A03, 64), (0x1A04, 64)],
)
def test_every_mapping_names_mappable_objects_of_the_right_length(
    od: canopen.ObjectDictionary, index: int, bits: int
) -> None:
    total = 0
    for sub in range(1, od[index][0].default + 1):
        value = od[index][sub].default
        entry = od.get_variable(value >> 16, value >> 8 & 0xFF)
        assert entry.pdo_mappable
        assert len(entry) == value & 0xFF
        total += value & 0xFF
    assert total == bits


def test_parameters_are_marked_and_complete(od: canopen.ObjectDictionary) -> None:
    entries = [v for o in od.values() for v in (o.values() if hasattr(o, "values") else [o])]
    marked = [v for v in entries if v.storage_location == "PARAMETER"]
    named = {v.qualname for v in marked}
    assert {"plant_x.mass", "motor_y.back_emf", "smc.xi", "limits.velocity", "following_window_y"} <= named
    for v in marked:
        assert v.access_type == "rw", v.qualname
        assert v.min <= v.default <= v.max, v.qualname
    assert od["controller.select"].storage_location is None


# ---- mistakes in the source ----


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[object.a]\nindex = 0x2000\ntype = 'u8'\n[object.b]\nindex = 0x2000\ntype = 'u8'", "b: index 2000h is .* a"),
        (
            "[object.a]\nindex = 0x2000\ntype = 'u8'\naxes = true\n[object.b]\nindex = 0x2800\ntype = 'u8'",
            "taken by a_y",
        ),
        ("[object.a]\nindex = 0x20000\ntype = 'u8'", "a: index must be"),
        ("[object.a]\nindex = 0x2000\ntype = 'u7'", "a: type must be one of"),
        ("[object.a]\nindex = 0x2000\ntype = 'u8'\ncolour = 1", "a: unknown key colour"),
        ("[object.a]\nindex = 0x2000\nsub = [{name = 'b', type = 'u8', colour = 1}]", "a.b: unknown key colour"),
        ("[object.a]\nindex = 0x2000\nsub = [{name = 'b', type = 'u8'}, {name = 'b', type = 'u8'}]", "a: two subs"),
        ("[object.a]\nindex = 0x2000\ntype = 'u8'\naccess = 'rx'", "a: access must be"),
        (
            "[object.a]\nindex = 0x2000\ntype = 'u8'\naccess = 'rw'\ndefault = 4\nmax = 3",
            "a: default 4 is outside 0..3",
        ),
        ("[object.a]\nindex = 0x2000\ntype = 'u8'\naccess = 'rw'\nmin = 1", "a: default 0 is outside 1..255"),
        ("[object.a]\nindex = 0x2000\ntype = 'u8'\nmax = 256", "a: min..max .* does not fit into u8"),
        ("[object.a]\nindex = 0x2000\ntype = 'i24'\nmin = -8388609", "a: min..max .* does not fit into i24"),
        ("[object.a]\nindex = 0x2000\ntype = 'u8'\nmin = 3\nmax = 2", "a: min..max is empty"),
        ("[object.a]\nindex = 0x2000\ntype = 'u16'\nfactor = 1e-2\ndefault = 0.123", "a: default 0.123 is no whole"),
        ("[object.a]\nindex = 0x2000\ntype = 'u16'\ndefault = 'x'", "a: default must be a number"),
        ("[object.a]\nindex = 0x2000\ntype = 'u16'\ndefault = [1, 2]", "a: a list of defaults needs axes"),
        ("[object.a]\nindex = 0x2000\ntype = 'u16'\nconfig = true", "a: a parameter is rw and has a default"),
        ("[object.a]\nindex = 0x2000\ntype = 'string'\naccess = 'rw'", "a: a string"),
        ("[object.a]\nindex = 0x2000\ntype = 'u16'\nfactor = 0", "a: factor must be a positive"),
        ("[object.a]\nindex = 0x2000\nsub = [{type = 'u8'}]", "a: a name is lower case"),
        ("[object.A]\nindex = 0x2000\ntype = 'u8'", "A: a name is lower case"),
        ("[object.a]\nindex = 0x2000\ntype = 'u8'\nunit = 'µm'", "ascii"),
        (
            "[object.a]\nindex = 0x2000\ntype = 'u8'\n[pdo.tpdo1]\ncob_id = 0x180\nevent_ms = 1\nmap = ['a']",
            "tpdo1: a .*lacks pdo",
        ),
        (
            "[object.a]\nindex = 0x2000\ntype = 'u8'\npdo = true\n[pdo.rpdo1]\ncob_id = 0x200\nmap = ['a']",
            "rpdo1: a is ro",
        ),
        (
            "[object.a]\nindex = 0x2000\ntype = 'u32'\npdo = true\n"
            "[pdo.tpdo1]\ncob_id = 0x180\nevent_ms = 1\nmap = ['a', 'a', 'a']",
            "tpdo1: 96 bits",
        ),
        ("[pdo.spdo1]\ncob_id = 0x180\nmap = ['a']", "spdo1: the name is"),
        ("[object.a\n", "objects.toml"),
    ],
)
def test_mistake_in_the_source_is_named(tmp_path: Path, text: str, message: str) -> None:
    with pytest.raises(SourceError, match=message):
        load(tmp_path, text)


def test_generator_ends_with_a_message_and_status_1(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "objects.toml").write_text(HEAD + "[object.a]\nindex = 0x2000\ntype = 'u7'")
    monkeypatch.setattr(generate_objects, "SOURCE", str(tmp_path / "objects.toml"))
    monkeypatch.setattr(sys, "argv", ["generate_objects.py", str(tmp_path / "out")])
    assert generate_objects.main() == 1
    assert "a: type must be one of" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()

# SPDX-License-Identifier: Apache-2.0
"""The one list of control laws, firmware/core/controllers.h: what is made of it, and its mistakes are caught."""

from pathlib import Path

import canopen
import controllers
import pytest
from paper import page
from source import SourceError

from kontur.can.link import EDS
from kontur.drive.controllers import CONTROLLERS, DESCRIPTIONS, TABLE
from kontur.report.figures import looks

LAWS = controllers.load()
HEADER = (controllers.ROOT / controllers.SOURCE).read_text("ascii")
SIXTH = 'ROW(PD, "pd", "contour-pd", "PD law")\n'


def test_list_of_the_host_is_that_of_the_firmware() -> None:
    assert TABLE.read_text("utf-8") == controllers.table(LAWS), "controllers.h changed: run `make lib` and commit"
    assert tuple(law["name"] for law in LAWS) == CONTROLLERS


def test_range_of_the_object_ends_at_the_last_law() -> None:
    controller = canopen.import_od(str(EDS), node_id=1)["controller"]
    assert controller["select"].max == controller["active"].max == len(LAWS) - 1


def test_page_of_the_paper_has_words_for_every_law() -> None:
    assert set(page._LONG) == set(CONTROLLERS) == set(DESCRIPTIONS)


def test_law_without_a_colour_of_its_own_gets_a_spare_one() -> None:
    assert len(set(looks([*CONTROLLERS, "pd"]))) == len(CONTROLLERS) + 1


def loaded(folder: Path, text: str) -> list[dict[str, str]]:
    file = folder / "controllers.h"
    file.write_text(text, "ascii")
    return controllers.load(file)


def test_new_row_is_the_last_law(tmp_path: Path) -> None:
    laws = loaded(tmp_path, HEADER + SIXTH)
    assert laws[:-1] == LAWS
    assert laws[-1] == {"name": "pd", "alias": "contour-pd", "description": "PD law"}


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (HEADER + SIXTH.replace('"pd"', '"ccu"'), "two laws have the same name"),
        (HEADER + SIXTH.replace('"contour-pd"', '"cascade"'), "two laws have the same name"),
        (HEADER + SIXTH.replace('"contour-pd", ', ""), "a row is ROW"),
        (HEADER + SIXTH.replace('"pd"', '"P D"'), "a row is ROW"),
        ("", "a row is ROW"),
    ],
)
def test_mistake_in_the_list_is_refused(tmp_path: Path, text: str, message: str) -> None:
    with pytest.raises(SourceError, match=message):
        loaded(tmp_path, text)

# SPDX-License-Identifier: Apache-2.0
"""source_graph.py finds what it is for: circles and calls that no include shows."""

from __future__ import annotations

import pytest
from source_graph import CSources, circles, python_arrows


@pytest.fixture
def tree(tmp_path):
    """Writes files below a folder, given as path=text, and returns the folder."""

    def write(files):
        for name, text in files.items():
            path = tmp_path / name
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(text)
        return tmp_path

    return write


def c_sources(root, **options):
    return CSources({root: [root]}, **options)


def test_header_and_source_are_one_module_so_that_their_circle_shows(tree):
    root = tree({
        "a/x.h": "int x(void);\n",
        "a/x.c": '#include "a/x.h"\n#include "b/y.h"\n',
        "b/y.h": "int y(void);\n",
        "b/y.c": '#include "b/y.h"\n#include "a/x.h"\n',
    })  # fmt: skip
    assert circles(c_sources(root).arrows()) == [["a/x", "b/y"]]


def test_a_call_is_an_arrow_under_whichever_header_the_function_is_declared(tree):
    root = tree({
        "x.h": "int x(void);\nint helper(int a);\n",
        "x.c": '#include "x.h"\nint x(void)\n{\n    return helper(1);\n}\n',
        "helper.c": '#include "x.h"\nint helper(int a)\n{\n    return a;\n}\n',
    })  # fmt: skip
    assert circles(c_sources(root).arrows()) == [["helper", "x"]]
    assert circles(c_sources(root, supplied={"helper"}).arrows()) == []


def test_comments_strings_declarations_and_pointers_are_no_calls(tree):
    root = tree({
        "x.h": "int y(int a);\n",
        "x.c": '/* y(1) */\nint x(struct s *s)\n{\n    return s->y(1) + f("y(1)");\n}\n',
        "y.c": "int y(int a)\n{\n    return a;\n}\n",
    })  # fmt: skip
    assert c_sources(root).arrows() == {"x": set(), "y": set()}


def test_what_is_reached_goes_by_calls_and_prefers_the_function_of_the_same_file(tree):
    root = tree({
        "x.c": "static void step(void)\n{\n    far();\n}\nvoid tick(void)\n{\n    step();\n}\n",
        "y.c": "void step(void)\n{\n}\n__attribute__((noinline)) void far(void)\n{\n}\nvoid other(void)\n{\n}\n",
    })  # fmt: skip
    assert set(c_sources(root).reached("x", "tick")) == {("x", "tick"), ("x", "step"), ("y", "far")}


def test_an_import_is_found_wherever_it_stands(tree):
    root = tree({
        "p/__init__.py": "",
        "p/a.py": "from p import b\n",
        "p/b.py": "def f():\n    from p.a import g\n",
        "p/c/__init__.py": "from . import d\n",
        "p/c/d.py": "import p.c\nfrom ..a import f\n",
    })  # fmt: skip
    arrows = python_arrows(root, "p")
    assert circles(arrows) == [["p.a", "p.b"], ["p.c", "p.c.d"]]
    assert arrows["p.c.d"] == {"p.a", "p.c"}

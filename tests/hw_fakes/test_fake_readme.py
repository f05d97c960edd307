"""The example of the page runs."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import hw_fakes


def test_example_of_the_page_passes():
    page = Path(hw_fakes.__file__).with_name("README.md").read_text(encoding="utf-8")
    example = page.split("```python\n")[1].split("```")[0]
    names: dict[str, Any] = {}
    exec(example, names)
    tests = [value for name, value in names.items() if name.startswith("test_")]
    assert tests
    for test in tests:
        test()

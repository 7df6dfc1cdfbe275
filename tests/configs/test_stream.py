from pathlib import Path

import pytest

from flexmotion.configs.errors import ConfigError
from flexmotion.configs.stream import StreamSettings, load_stream


def test_the_shipped_settings_are_the_defaults() -> None:
    assert load_stream() == StreamSettings()


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("horizon_s: 0.5", "must not exceed horizon_s 0.5"),
        ("commit_s: 0.3", "commit_s 0.3 must not exceed replan_s 0.25"),
        ("budgets: {loop_work_p99_ms: 0}", "budgets.loop_work_p99_ms"),
    ],
)
def test_settings_that_cannot_work_are_refused(tmp_path: Path, text: str, says: str) -> None:
    file = tmp_path / "stream.yaml"
    file.write_text(text)
    with pytest.raises(ConfigError, match=says):
        load_stream(file)

"""Failing networks."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from flexmotion.configs.errors import ConfigError
from flexmotion.onnx_session import open_session, run

onnx = pytest.importorskip("onnx", reason="networks are made with the extra 'train'")


@pytest.fixture
def network(tmp_path: Path) -> Path:
    """A network that looks up an entry in a table of three."""
    helper, types = onnx.helper, onnx.TensorProto
    graph = helper.make_graph(
        [helper.make_node("Gather", ["table", "entry"], ["found"])],
        "lookup",
        [helper.make_tensor_value_info("entry", types.INT64, [1])],
        [helper.make_tensor_value_info("found", types.FLOAT, [1])],
        [helper.make_tensor("table", types.FLOAT, [3], [1.0, 2.0, 3.0])],
    )
    path = tmp_path / "lookup.onnx"
    onnx.save(helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=8), path)
    return path


@pytest.mark.parametrize("inputs", [{"entry": np.array([7])}, {"entry": np.array(["x"])}, {}])
def test_a_network_that_fails_while_it_runs_is_named(network: Path, inputs: dict[str, np.ndarray]) -> None:
    """Regression: errors of onnxruntime have no base but Exception, and ended the planner's process."""
    session = open_session(network)
    np.testing.assert_array_equal(run(session, network, {"entry": np.array([1])}), [2.0])
    with pytest.raises(ConfigError, match=r"lookup\.onnx: cannot be run \(.+\)"):
        run(session, network, inputs)


def test_a_file_that_is_not_a_network_is_named(tmp_path: Path) -> None:
    path = tmp_path / "none.onnx"
    with pytest.raises(ConfigError, match="not there"):
        open_session(path)
    path.write_bytes(b"no network")
    with pytest.raises(ConfigError, match="cannot be run"):
        open_session(path)

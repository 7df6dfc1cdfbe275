"""Networks in eight bits: which weights, how exact, and that the sampler runs them."""

from __future__ import annotations

from pathlib import Path
from shutil import copyfile

import numpy as np
import pytest

onnx = pytest.importorskip("onnx", reason="training needs the extra 'train'")
pytest.importorskip("torch", reason="training needs the extra 'train'")

from onnx import TensorProto, helper, numpy_helper  # noqa: E402

from flexmotion.bundles.bundle import DECODER, DENOISER, Bundle  # noqa: E402
from flexmotion.bundles.card import CARD  # noqa: E402
from flexmotion.bundles.shipped import bundle_folder  # noqa: E402
from flexmotion.onnx_session import open_session  # noqa: E402
from flexmotion.sampling.sampler import Condition, Sampler  # noqa: E402
from flexmotion.streamer.cli import execute  # noqa: E402
from flexmotion.training.eight_bits import BLOCK, MIDDLE, quantised, to_eight_bits  # noqa: E402
from flexmotion.training.export import export  # noqa: E402
from flexmotion.training.half_weights import halve_weights  # noqa: E402
from flexmotion.training.run import Run  # noqa: E402

WIDTHS = {"first": (100, 128), "leave.weight": (128, 96), "second.weight": (96, 80), "thin": (80, 80), "few": (40, 8)}


def network(path: Path) -> None:
    """Products by all weights of `WIDTHS`, one after the other: plain, by Gemm, scaled, and of few inputs."""
    rng = np.random.default_rng(0)
    weights = {name: rng.standard_normal(size).astype(np.float32) / size[0] ** 0.5 for name, size in WIDTHS.items()}
    weights |= {name: weights[name].T for name in ("leave.weight", "second.weight")}
    bias = rng.standard_normal(80).astype(np.float32)
    nodes = [
        helper.make_node("MatMul", ["in", "first"], ["a"]),
        helper.make_node("Gemm", ["a", "leave.weight"], ["b"], transB=1),
        helper.make_node("Gemm", ["b", "second.weight", "bias"], ["c"], transB=1),
        helper.make_node("Gemm", ["c", "thin"], ["d"], alpha=0.5),
        helper.make_node("Slice", ["d", "begin", "end", "axis"], ["e"]),
        helper.make_node("MatMul", ["e", "few"], ["out"]),
    ]
    cut = {"begin": [0], "end": [40], "axis": [1]}
    stored = weights | {"bias": bias} | {name: np.array(value) for name, value in cut.items()}
    graph = helper.make_graph(
        nodes,
        "test",
        [helper.make_tensor_value_info("in", TensorProto.FLOAT, [3, 100])],
        [helper.make_tensor_value_info("out", TensorProto.FLOAT, [3, 8])],
        [numpy_helper.from_array(np.ascontiguousarray(value), name) for name, value in stored.items()],
    )
    onnx.save(helper.make_model(graph, opset_imports=[helper.make_opsetid("", 20)], ir_version=10), str(path))


def answer(path: Path) -> np.ndarray:
    given = np.random.default_rng(1).standard_normal((3, 100), np.float32)
    return np.asarray(open_session(path).run(None, {"in": given})[0])


@pytest.mark.parametrize("halved", [False, True])
def test_products_are_of_integers_where_that_is_exact_enough(tmp_path: Path, halved: bool) -> None:
    path = tmp_path / "network.onnx"
    network(path)
    if halved:
        halve_weights(path)
    whole, size = answer(path), path.stat().st_size
    # The last product of a network, a scaled one and one with few inputs stay as they are.
    assert to_eight_bits(path) == 2
    assert onnx.load(str(path)).graph.node[-1].op_type == "MatMul" and path.stat().st_size < size
    found = answer(path)
    assert 1e-4 < np.abs(found - whole).max() < 0.02 * np.abs(whole).max()
    assert to_eight_bits(path) == 0
    np.testing.assert_array_equal(answer(path), found)


def test_a_weight_is_off_by_half_a_step_of_its_block() -> None:
    weight = np.random.default_rng(2).standard_normal((BLOCK + 10, 5)).astype(np.float32)
    weight[:BLOCK, 0] *= 100.0
    weight[:, 4] = 0.0
    integers, scales = quantised(weight)
    assert integers.shape == (5, 2, BLOCK) and scales.shape == (10,)
    values = (integers.astype(np.float32) - MIDDLE) * scales.reshape(5, 2, 1)
    back = values.reshape(5, 2 * BLOCK)[:, : len(weight)].T
    assert (np.abs(back - weight) <= 0.501 * np.repeat(scales.reshape(5, 2).T, BLOCK, axis=0)[: len(weight)]).all()
    assert (values.reshape(5, 2 * BLOCK)[:, len(weight) :] == 0.0).all() and (back[:, 4] == 0.0).all()


def test_shipped_networks_in_eight_bits_sample_nearly_the_same_motion(tmp_path: Path) -> None:
    free = bundle_folder("free")  # the default one is in eight bits
    for file in free.iterdir():
        copyfile(file, tmp_path / file.name)
    assert to_eight_bits(tmp_path / DENOISER) > 25 and to_eight_bits(tmp_path / DECODER) > 25
    with pytest.raises(Exception, match="differs from the manifest"):
        Bundle(tmp_path)
    whole, small = (Sampler(Bundle(free), balanced=False) for _ in range(2))
    small._denoiser, small._decoder = (open_session(tmp_path / name) for name in (DENOISER, DECODER))
    history = whole.standing()
    for seed, words in enumerate(("walk forward", "look to the left", "stand still")):
        one, other = (sampler.sample(history, Condition(words), seed) for sampler in (whole, small))
        apart = np.abs(other.joints - one.joints)
        assert 0.0 < apart.mean() < 0.02 and np.abs(other.root_position - one.root_position).max() < 0.03
        history = one


def test_an_exported_bundle_says_that_it_is_in_eight_bits(trained: Run, bundle: Bundle, tmp_path: Path) -> None:
    small = export(trained, tmp_path / "small", distilled=True, eight_bits=True)
    assert small.manifest.eight_bits and not bundle.manifest.eight_bits and small.hash not in bundle.hashes
    assert "--eight-bits" in (small.folder / CARD).read_text(encoding="utf-8")
    kinds = {node.op_type for node in onnx.load(str(small.folder / DENOISER)).graph.node}
    assert "MatMulNBits" in kinds
    sampler = Sampler(Bundle(small.folder))
    window = sampler.sample(sampler.standing(), Condition("walk forward"), 0)
    assert len(window) == sampler.future and np.isfinite(window.joints).all()


def test_weights_to_train_from_are_not_written_in_eight_bits(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert execute(["export", str(tmp_path), "-o", str(tmp_path / "w"), "--weights", "--eight-bits"]) == 2
    assert "--eight-bits" in capsys.readouterr().err

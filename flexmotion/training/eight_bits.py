"""Weights of ONNX networks in eight bits: smaller files, and products of matrices that read a quarter of the memory.

A weight is cut into blocks of `BLOCK` inputs of one output. A block is stored as integers of eight bits and one scale,
its greatest element over 127. The operator `MatMulNBits` of onnxruntime takes them, quantises its input in the same
blocks when it runs, and sums in single precision. Norms and attention stay as they are.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import onnx
from numpy.typing import NDArray
from onnx import NodeProto, TensorProto, helper, numpy_helper

DOMAIN = "com.microsoft"
BLOCK = 64
"""Inputs with one scale; the operator takes powers of two from 16 on. Measured in docs/decisions.md."""
ACCURACY = 4
"""The operator's level at which inputs are quantised too, so that products are of integers."""
MIDDLE = 128
"""The integer that stands for zero."""
WHOLE = ("leave.weight", "autoencoder.write_straight.weight")
"""Weights that stay as they are: the latent and the motion leave through them, and no later layer makes up for an
error. In eight bits they made most of it (docs/decisions.md)."""

Float32 = NDArray[np.float32]


def to_eight_bits(path: Path) -> int:
    """Store the weights of a network's matrix products in eight bits, in place.

    Those of `WHOLE` and those with fewer than `BLOCK` inputs stay as they are.

    Args:
        path: of a network in single or half precision.

    Returns:
        Number of the weights that are in eight bits.
    """
    model = onnx.load(str(path))
    graph = model.graph
    weights = {weight.name: weight for weight in graph.initializer}
    halves = {node.output[0]: node.input[0] for node in graph.node if node.op_type == "Cast"}
    done: dict[str, tuple[list[NodeProto], list[TensorProto]]] = {}
    for node, product, stored in _products(graph.node, weights, halves):
        packed, scales = quantised(product)
        inputs, outputs = product.shape
        names = [f"{stored}.eight_bits", f"{stored}.scales"]
        tensors = [numpy_helper.from_array(packed, names[0]), numpy_helper.from_array(scales, names[1])]
        bias = node.input[2] if len(node.input) > 2 else ""
        made = helper.make_node(
            "MatMulNBits",
            [node.input[0], *names, *(["", "", bias] if bias else [])],
            [node.output[0]],
            name=node.name,
            domain=DOMAIN,
            K=inputs,
            N=outputs,
            bits=8,
            block_size=BLOCK,
            accuracy_level=ACCURACY,
        )
        done[node.output[0]] = [made], tensors
    nodes = [one for node in graph.node for one in done.get(node.output[0], ([node], []))[0]]
    used = {name for node in nodes for name in node.input}
    nodes = [node for node in nodes if node.op_type != "Cast" or node.output[0] in used]
    used = {name for node in nodes for name in node.input}
    new = {tensor.name: tensor for _, tensors in done.values() for tensor in tensors}
    kept = [weight for weight in graph.initializer if weight.name in used]
    del graph.node[:], graph.initializer[:]
    graph.node.extend(nodes)
    graph.initializer.extend([*kept, *new.values()])
    if DOMAIN not in {own.domain for own in model.opset_import}:
        model.opset_import.append(helper.make_opsetid(DOMAIN, 1))
    onnx.save(model, str(path))
    return len(done)


def quantised(weight: Float32) -> tuple[NDArray[np.uint8], Float32]:
    """A weight (K, N) in blocks: integers around `MIDDLE`, (N, blocks, BLOCK), and their scales, (N * blocks,)."""
    inputs, outputs = weight.shape
    blocks = -(-inputs // BLOCK)
    padded = np.zeros((outputs, blocks * BLOCK), np.float32)
    padded[:, :inputs] = weight.T
    padded = padded.reshape(outputs, blocks, BLOCK)
    scales = np.abs(padded).max(axis=2) / 127.0
    integers = np.rint(padded / np.where(scales > 0.0, scales, 1.0)[..., None]) + MIDDLE
    return integers.astype(np.uint8), scales.reshape(-1).astype(np.float32)


def _products(
    nodes: list[NodeProto], weights: dict[str, TensorProto], halves: dict[str, str]
) -> Iterator[tuple[NodeProto, Float32, str]]:
    """Products by a stored weight: the node, the weight (K, N), and its name."""
    for node in nodes:
        if node.op_type not in ("MatMul", "Gemm") or (how := _gemm(node)) is None:
            continue
        stored = halves.get(node.input[1], node.input[1])
        if stored not in weights or len(weights[stored].dims) != 2:
            continue
        weight = numpy_helper.to_array(weights[stored]).astype(np.float32)
        weight = weight.T if how else weight
        if weight.shape[0] >= BLOCK and not stored.startswith(WHOLE):
            yield node, weight, stored


def _gemm(node: NodeProto) -> bool | None:
    """Whether the weight is transposed; None for a product that is scaled, or of a transposed input."""
    how = {one.name: helper.get_attribute_value(one) for one in node.attribute}
    plain = how.get("alpha", 1.0) == 1.0 and how.get("beta", 1.0) == 1.0 and not how.get("transA", 0)
    return bool(how.get("transB", 0)) if plain else None

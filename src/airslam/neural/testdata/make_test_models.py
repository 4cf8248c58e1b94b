#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""Writes the tiny networks that the tests of the neural layer run: hand-made weights, nothing learned.

    python make_test_models.py            (needs onnx and numpy; writes beside itself)

pack/       a model pack: a blob detector that stands for PLNet, and a matcher of two stages
planes.onnx    a feature network with dense descriptors
integers.onnx  a network whose input is not float
"""
import hashlib
import json
from pathlib import Path

import numpy as np
import onnx
from onnx import TensorProto, helper, numpy_helper

HERE = Path(__file__).resolve().parent
N, D = 8, 4  # points a side and descriptor size of the matcher


def tensor(name, shape, kind=TensorProto.FLOAT):
    return helper.make_tensor_value_info(name, kind, shape)


def constant(name, value):
    return numpy_helper.from_array(np.asarray(value, dtype=np.float32), name)


def integers(name, value):
    return numpy_helper.from_array(np.asarray(value, dtype=np.int64), name)


def save(path, nodes, inputs, outputs, constants=()):
    graph = helper.make_graph(nodes, path.stem, inputs, outputs, list(constants))
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], producer_name="airslam-test")
    model.ir_version = 8
    onnx.checker.check_model(model)
    path.write_bytes(model.SerializeToString())


def cells_and_blobs():
    """Weights that the networks below share.

    Cells: mean of the 4x4 cell, 1, right half minus left half, bottom half minus top half.
    Blobs, the scores: 10 * (pixel - mean of its 8 neighbours) - 6."""
    cells = np.zeros((D, 1, 4, 4), np.float32)
    cells[0] = 1 / 16
    cells[2, 0, :, :2], cells[2, 0, :, 2:] = -1 / 8, 1 / 8
    cells[3, 0, :2, :], cells[3, 0, 2:, :] = -1 / 8, 1 / 8
    blob = np.full((1, 1, 3, 3), -10 / 8, np.float32)
    blob[0, 0, 1, 1] = 10
    return [constant("cells", cells), constant("cells_bias", [0, 1, 0, 0]), constant("blob", blob), constant("blob_bias", [-6])]


def planes(path):
    """A feature network as others make them: a dense map of descriptors, and a plane of scores."""
    save(path,
         [helper.make_node("Conv", ["image", "cells", "cells_bias"], ["descriptors"], strides=[4, 4]),
          helper.make_node("Conv", ["image", "blob", "blob_bias"], ["score_logits"], pads=[1, 1, 1, 1])],
         [tensor("image", [1, 1, "H", "W"])],
         [tensor("descriptors", [1, D, "H4", "W4"]), tensor("score_logits", [1, 1, "H", "W"])], cells_and_blobs())


def as_cells(name, channels, target):
    """Nodes that turn 1 x C x h x w `name` into rows of `channels` values; needs AS_CELLS."""
    return [helper.make_node("Transpose", [name], [f"{name}_last"], perm=[0, 2, 3, 1]),
            helper.make_node("Reshape", [f"{name}_last", f"rows_of_{channels}"], [target])]


AS_CELLS = [integers(f"rows_of_{n}", [-1, n]) for n in (1, 2, D, 16)]


def plnet(path):
    """The same scores, 16 a cell, and two maps in cells: the same features at /4, and the mean of 8x8 pixels at /8."""
    save(path,
         [helper.make_node("Conv", ["image", "cells", "cells_bias"], ["planes4"], strides=[4, 4]),
          helper.make_node("AveragePool", ["image"], ["planes8"], kernel_shape=[8, 8], strides=[8, 8]),
          helper.make_node("Conv", ["image", "blob", "blob_bias"], ["plane"], pads=[1, 1, 1, 1]),
          helper.make_node("SpaceToDepth", ["plane"], ["folded"], blocksize=4),
          *as_cells("planes4", D, "features4"), *as_cells("planes8", 1, "features8"), *as_cells("folded", 16, "score_logits")],
         [tensor("image", [1, 1, "H", "W"])],
         [tensor("features4", ["N4", D]), tensor("features8", ["N8", 1]), tensor("score_logits", ["N4", 16])],
         [*cells_and_blobs(), *AS_CELLS])


def descriptor_head(path):
    """What is sampled at /4, its first value plus what is sampled at /8."""
    weights = np.concatenate([np.eye(D), np.eye(1, D)]).astype(np.float32)
    save(path, [helper.make_node("MatMul", ["samples", "weights"], ["descriptors"])],
         [tensor("samples", ["N", D + 1])], [tensor("descriptors", ["N", D])], [constant("weights", weights)])


LINE_CHANNELS, LINE_SAMPLES, CONTEXT_SAMPLES, LINE_EXTRAS, PROPOSALS = 2, 4, 2, 9, 16
CONTEXT_OFFSETS = [-8.0, 2.0]


def line_neck(path):
    """Maps of lines at 1/4 of the size for an image that draws its own maps: the value of a cell is the mean m of its 4x4
    pixels. Junction heat: a cell of 1 has the logit 4, others below 0.9 at most -5. Field: every cell under a mean of
    0.25..0.75 has the confidence logit 4 and says "2 pixels up, 45 degrees to either end". Pooled: m and 1 at /4, and the
    feature at /8."""
    heat = np.zeros((3, 1, 1, 1), np.float32)
    heat[0] = 90
    # confidence = 4 - 40 * relu(m - 0.75) - 40 * relu(0.25 - m)
    edges = np.array([1, -1], np.float32).reshape(2, 1, 1, 1)
    field = np.zeros((6, 2, 1, 1), np.float32)
    field[0] = -40
    pooled = np.array([1, 0], np.float32).reshape(2, 1, 1, 1)
    distance = -np.log(7)  # sigmoid: 1/8, of the reach of 16 pixels
    save(path,
         [helper.make_node("Transpose", ["features4"], ["planes4"], perm=[0, 3, 1, 2]),
          helper.make_node("Gather", ["planes4", "mean"], ["m"], axis=1),
          helper.make_node("Conv", ["m", "heat", "heat_bias"], ["junction_maps"]),
          helper.make_node("Conv", ["m", "edges", "edges_bias"], ["outside"]),
          helper.make_node("Relu", ["outside"], ["outside_only"]),
          helper.make_node("Conv", ["outside_only", "field", "field_bias"], ["line_field"]),
          helper.make_node("Conv", ["m", "pooled", "pooled_bias"], ["planes"]), *as_cells("planes", 2, "line_features"),
          helper.make_node("Reshape", ["features8", "rows_of_1"], ["line_context"])],
         [tensor("features4", [1, "H4", "W4", D]), tensor("features8", [1, "H8", "W8", 1])],
         [tensor("line_field", [1, 6, "H4", "W4"]), tensor("junction_maps", [1, 3, "H4", "W4"]),
          tensor("line_features", ["N4", LINE_CHANNELS]), tensor("line_context", ["N8", 1])],
         [integers("mean", [0]), constant("heat", heat), constant("heat_bias", [-86, 0, 0]), constant("edges", edges),
          constant("edges_bias", [-0.75, 0.25]), constant("field", field), constant("field_bias", [4, distance, 0, -1, 0, 0]),
          constant("pooled", pooled), constant("pooled_bias", [0, 1]), *AS_CELLS])


def line_classifier(path):
    """Logit: 4 * mean of the first pooled channel + the last value pooled along at /8 + half of that at the last offset from
    the end - 1."""
    along = LINE_SAMPLES * LINE_CHANNELS
    weights = np.zeros((along + CONTEXT_SAMPLES + LINE_EXTRAS + 2 * len(CONTEXT_OFFSETS), 1), np.float32)
    weights[:along:LINE_CHANNELS] = 4 / LINE_SAMPLES
    weights[along + CONTEXT_SAMPLES - 1] = 1
    weights[-1] = 0.5
    save(path, [helper.make_node("MatMul", ["features", "weights"], ["sum"]),
                helper.make_node("Add", ["sum", "bias"], ["logits"])],
         [tensor("features", ["N", len(weights)])], [tensor("logits", ["N", 1])],
         [constant("weights", weights), constant("bias", [-1])])


def masked(scores):
    """Nodes that multiply 1xNxN `scores` by both masks."""
    return [helper.make_node("Unsqueeze", ["mask0", "last"], ["mask_rows"]),
            helper.make_node("Unsqueeze", ["mask1", "middle"], ["mask_columns"]),
            helper.make_node("Mul", ["mask_rows", "mask_columns"], ["mask"]),
            helper.make_node("Mul", [scores, "mask"], ["scores"])]


def points(name, width):
    return [tensor(f"{name}{i}", [1, N, width] if width else [1, N]) for i in (0, 1)]


AXES = [integers("last", [2]), integers("middle", [1])]


def stage0(path):
    """Matches by the first three values of the descriptors, sigmoid(20 a.b - 10); the fourth is the confidence."""
    nodes = []
    for i in (0, 1):
        nodes += [helper.make_node("Identity", [f"descriptors{i}"], [f"state{i}"]),
                  helper.make_node("Gather", [f"descriptors{i}", "three"], [f"confidence{i}"], axis=2),
                  helper.make_node("Mul", [f"descriptors{i}", "selection"], [f"d{i}"])]
    nodes += [helper.make_node("Transpose", ["d1"], ["d1t"], perm=[0, 2, 1]),
              helper.make_node("MatMul", ["d0", "d1t"], ["products"]),
              helper.make_node("Mul", ["products", "gain"], ["scaled"]),
              helper.make_node("Add", ["scaled", "offset"], ["logits"]),
              helper.make_node("Sigmoid", ["logits"], ["probabilities"])] + masked("probabilities")
    save(path, nodes, points("keypoints", 2) + points("descriptors", D) + points("mask", 0),
         points("state", D) + [tensor("scores", [1, N, N])] + points("confidence", 0),
         AXES + [numpy_helper.from_array(np.asarray(3, np.int64), "three"),
                 constant("selection", [1, 1, 1, 0]), constant("gain", 20), constant("offset", -10)])


def stage1(path):
    """Matches by position, 1 - |k0 - k1|^2 of the normalised keypoints; the states pass through.
    An ONNX output cannot be called as an input, so the states' outputs are `next_state0` and `next_state1`."""
    nodes = [helper.make_node("Identity", [f"state{i}"], [f"next_state{i}"]) for i in (0, 1)]
    nodes += [helper.make_node("Unsqueeze", ["keypoints0", "last"], ["rows"]),       # 1 x N x 1 x 2
              helper.make_node("Unsqueeze", ["keypoints1", "middle"], ["columns"]),  # 1 x 1 x N x 2
              helper.make_node("Sub", ["rows", "columns"], ["difference"]),
              helper.make_node("Mul", ["difference", "difference"], ["squares"]),
              helper.make_node("ReduceSum", ["squares", "coordinate"], ["distance"], keepdims=0),
              helper.make_node("Sub", ["one", "distance"], ["near"])] + masked("near")
    nodes += [helper.make_node("Identity", [f"mask{i}"], [f"confidence{i}"]) for i in (0, 1)]
    constants = [integers("last", [2]), integers("middle", [1]), integers("coordinate", [3]), constant("one", 1)]
    save(path, nodes, points("state", D) + points("keypoints", 2) + points("mask", 0),
         points("next_state", D) + [tensor("scores", [1, N, N])] + points("confidence", 0), constants)


def manifest(folder):
    def entry(name):
        data = (folder / name).read_bytes()
        return {"file": name, "sha256": hashlib.sha256(data).hexdigest(), "bytes": len(data)}

    features = {**entry("plnet.onnx"), "input": "image", "normalization": "unit", "multiple": 16,
                "scores": "score_logits", "score_stride": 4, "layout": "cells",
                "maps": [{"output": "features4", "channels": D, "stride": 4}, {"output": "features8", "channels": 1, "stride": 8}],
                "half_pixel": True, "descriptor_size": D,
                "descriptor_head": {**entry("descriptor_head.onnx"), "input": "samples", "output": "descriptors"},
                "score_threshold": -5.0, "nms_radius": 2,
                "lines": {**entry("line_neck.onnx"), "field": "line_field", "junctions": "junction_maps", "stride": 4,
                          "pooled": [{"output": "line_features", "channels": LINE_CHANNELS, "stride": 4, "samples": LINE_SAMPLES},
                                     {"output": "line_context", "channels": 1, "stride": 8, "samples": CONTEXT_SAMPLES,
                                      "end_offsets": CONTEXT_OFFSETS}],
                          "reach": 16.0, "min_confidence": 0.5, "min_junction": 0.5, "max_junctions": 8, "snap": 12.0,
                          "min_support": 1.0, "double_radius": 3.0, "overlap_radius": 4.0, "max_proposals": PROPOSALS,
                          "classifier": {**entry("line_classifier.onnx"), "input": "features", "output": "logits"}}}
    matcher = {"keypoints": N, "threshold": 0.1, "exit_confidence": 0.9,
               "stages": [entry("matcher_stage0.onnx"), entry("matcher_stage1.onnx")]}
    pack = {"format": 2, "name": "test", "license": "BSD-3-Clause", "features": features, "matcher": matcher,
            "quality": {}, "training": {"note": "hand-made weights, see make_test_models.py"}}
    (folder / "manifest.json").write_text(json.dumps(pack, indent=1) + "\n")


def main():
    folder = HERE / "pack"
    folder.mkdir(exist_ok=True)
    plnet(folder / "plnet.onnx")
    descriptor_head(folder / "descriptor_head.onnx")
    line_neck(folder / "line_neck.onnx")
    line_classifier(folder / "line_classifier.onnx")
    stage0(folder / "matcher_stage0.onnx")
    stage1(folder / "matcher_stage1.onnx")
    manifest(folder)
    planes(HERE / "planes.onnx")
    save(HERE / "integers.onnx", [helper.make_node("Identity", ["x"], ["y"])],
         [tensor("x", [1, 2], TensorProto.INT64)], [tensor("y", [1, 2], TensorProto.INT64)])


if __name__ == "__main__":
    main()

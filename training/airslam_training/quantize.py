# SPDX-License-Identifier: BSD-3-Clause
"""int8 convolutions for an exported network, calibrated on our own training photos in changed light.

Layers that hand out numbers (scores, field, what the classifier reads) and those that add up coarser levels stay float: a
maximum's place within a pixel needs more than 8 bits. Ranges are percentiles, since the few largest activations of
a spot light would otherwise take the bits of all the others.
"""
from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Iterable, Iterator

import cv2
import numpy as np
import onnx
import onnxruntime
import torch
from onnxruntime.quantization import CalibrationDataReader, CalibrationMethod, QuantFormat, QuantType, quantize_static
from onnxruntime.quantization.shape_inference import quant_pre_process

from . import augment
from .cache import photo_split

# Parts of the names of layers that stay float, in PLNet and in the line neck.
FLOAT = ("score_out",)
FLOAT_NECK = ("lateral8", "lateral16", "/from", "field.1", "junctions", "pooled")


def photos(count: int, seed: int) -> Iterator[dict]:
    """Altered training photos as the network's input, one at a time."""
    files, _ = photo_split()
    generator = torch.Generator().manual_seed(seed)
    for i in np.random.default_rng(seed).permutation(len(files))[:count]:
        image = cv2.resize(cv2.imread(str(files[i]), cv2.IMREAD_GRAYSCALE), (384, 256), interpolation=cv2.INTER_LINEAR)
        x = augment.alter(torch.from_numpy(image)[None, None].float(), generator)
        yield {"image": augment.standardize(x).numpy()}


def features(plnet: Path, maps: dict[str, int], inputs: Iterable[dict]) -> Iterator[dict]:
    """What the exported network `plnet` hands out for these images, as the line neck's input; maps: name -> pixels a cell."""
    session = onnxruntime.InferenceSession(str(plnet), providers=["CPUExecutionProvider"])
    for feed in inputs:
        h, w = feed["image"].shape[2:]
        found = session.run(list(maps), feed)
        yield {name: f.reshape(1, h // s, w // s, -1) for (name, s), f in zip(maps.items(), found)}


class Reader(CalibrationDataReader):
    """An iterator as what the calibration wants to be asked."""

    def __init__(self, inputs: Iterable[dict]):
        self.inputs = iter(inputs)

    def get_next(self) -> dict | None:
        return next(self.inputs, None)


def quantize(source: Path, target: Path, inputs: Iterable[dict], kept: tuple[str, ...]) -> None:
    """Write `source` (ONNX) with int8 weights and activations in its convolutions, but for those whose names hold one of `kept`."""
    with tempfile.TemporaryDirectory() as folder:
        prepared = Path(folder) / "prepared.onnx"
        quant_pre_process(str(source), str(prepared), skip_symbolic_shape=True)
        convolutions = [n.name for n in onnx.load(str(prepared)).graph.node if n.op_type == "Conv"]
        excluded = [n for n in convolutions if any(part in n for part in kept)]
        quantize_static(str(prepared), str(target), Reader(inputs), quant_format=QuantFormat.QDQ, per_channel=True,
                        activation_type=QuantType.QUInt8, weight_type=QuantType.QInt8, op_types_to_quantize=["Conv"],
                        nodes_to_exclude=excluded, calibrate_method=CalibrationMethod.Percentile)
    onnx.checker.check_model(onnx.load(str(target)))

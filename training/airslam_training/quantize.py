# SPDX-License-Identifier: BSD-3-Clause
"""int8 convolutions for an exported network, calibrated on our own training photos in changed light.

Layers that hand out numbers (scores, descriptors, field) and those that add up levels stay float: a descriptor's angle
and a maximum's place within a pixel need more than 8 bits. Ranges are percentiles, since the few largest activations of
a spot light would otherwise take the bits of all the others.
"""
from __future__ import annotations

import tempfile
from pathlib import Path

import cv2
import numpy as np
import onnx
import torch
from onnxruntime.quantization import CalibrationDataReader, CalibrationMethod, QuantFormat, QuantType, quantize_static
from onnxruntime.quantization.shape_inference import quant_pre_process

from . import augment
from .cache import photo_split

# Parts of the names of layers that stay float.
FLOAT = ("lateral", "fuse", "descriptor", "score_out", "/from", "/field", "/rest")


class Photos(CalibrationDataReader):
    """Altered training photos as the network's input, one at a time."""

    def __init__(self, count: int, seed: int):
        files, _ = photo_split()
        chosen = np.random.default_rng(seed).permutation(len(files))[:count]
        self.files = iter([files[i] for i in chosen])
        self.generator = torch.Generator().manual_seed(seed)

    def get_next(self) -> dict | None:
        file = next(self.files, None)
        if file is None:
            return None
        image = cv2.resize(cv2.imread(str(file), cv2.IMREAD_GRAYSCALE), (384, 256), interpolation=cv2.INTER_LINEAR)
        x = augment.alter(torch.from_numpy(image)[None, None].float(), self.generator)
        return {"image": augment.standardize(x).numpy()}


def quantize(source: Path, target: Path, count: int = 120, seed: int = 5) -> None:
    """Write `source` (ONNX, input `image`) with int8 weights and activations in its convolutions."""
    with tempfile.TemporaryDirectory() as folder:
        prepared = Path(folder) / "prepared.onnx"
        quant_pre_process(str(source), str(prepared), skip_symbolic_shape=True)
        convolutions = [n.name for n in onnx.load(str(prepared)).graph.node if n.op_type == "Conv"]
        kept = [n for n in convolutions if any(part in n for part in FLOAT)]
        quantize_static(str(prepared), str(target), Photos(count, seed), quant_format=QuantFormat.QDQ, per_channel=True,
                        activation_type=QuantType.QUInt8, weight_type=QuantType.QInt8, op_types_to_quantize=["Conv"],
                        nodes_to_exclude=kept, calibrate_method=CalibrationMethod.Percentile)
    onnx.checker.check_model(onnx.load(str(target)))

# SPDX-License-Identifier: BSD-3-Clause
"""int8 layers for an exported network, calibrated on our own training photos in changed light.

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
from .lines import DecoderOptions, LineModule, classifier_features, propose
from .networks import Backbone

# Parts of the names of layers that stay float, in PLNet, in the line neck and in the classifier of proposals.
FLOAT = ("score_out",)
FLOAT_NECK = ("lateral8", "lateral16", "/from", "field.1", "junctions", "pooled")
FLOAT_CLASSIFIER = ("/4/",)
PROPOSALS = 256  # of a photo, that the classifier is calibrated with


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


@torch.no_grad()
def proposals(backbone: Backbone, module: LineModule, inputs: Iterable[dict]) -> Iterator[dict]:
    """What the classifier reads of some proposals, evenly chosen from the best to the worst, of each image that has so many."""
    for feed in inputs:
        field, maps, pooled = [m[0] for m in module.neck(*backbone(torch.from_numpy(feed["image"])))]
        ends, extra, _, _ = propose(field, maps, DecoderOptions())
        if len(ends) >= PROPOSALS:
            chosen = torch.linspace(0, len(ends) - 1, PROPOSALS).long()
            yield {"features": classifier_features(pooled, ends[chosen], extra[chosen], module.config.samples).numpy()}


class Reader(CalibrationDataReader):
    """An iterator as what the calibration wants to be asked."""

    def __init__(self, inputs: Iterable[dict]):
        self.inputs = iter(inputs)

    def get_next(self) -> dict | None:
        return next(self.inputs, None)


def quantize(source: Path, target: Path, inputs: Iterable[dict], kept: tuple[str, ...]) -> None:
    """Write `source` (ONNX) with int8 weights and activations in its convolutions and products with matrices, but for those
    whose names hold one of `kept`."""
    with tempfile.TemporaryDirectory() as folder:
        prepared = Path(folder) / "prepared.onnx"
        quant_pre_process(str(source), str(prepared), skip_symbolic_shape=True)
        layers = [n.name for n in onnx.load(str(prepared)).graph.node if n.op_type in ("Conv", "Gemm")]
        excluded = [n for n in layers if any(part in n for part in kept)]
        quantize_static(str(prepared), str(target), Reader(inputs), quant_format=QuantFormat.QDQ, per_channel=True,
                        activation_type=QuantType.QUInt8, weight_type=QuantType.QInt8, op_types_to_quantize=["Conv", "Gemm"],
                        nodes_to_exclude=excluded, calibrate_method=CalibrationMethod.Percentile)
    onnx.checker.check_model(onnx.load(str(target)))

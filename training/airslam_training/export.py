# SPDX-License-Identifier: BSD-3-Clause
"""ONNX export of PLNet, its line module and the matcher stages, and the manifest of the model pack.

    python -m airslam_training.export [--plnet c.pt] [--lines c.pt] [--matcher c.pt] [--quality results.json]
"""
from __future__ import annotations

import argparse
import contextlib
import copy
import hashlib
import json
import tempfile
from pathlib import Path

import onnx
import torch
import yaml
from torch import nn
from torch.nn.utils.fusion import fuse_conv_bn_eval

from .cache import CACHE
from .lines import END_OFFSETS, JUNCTION, REACH, STRIDE, DecoderOptions, LineConfig, LineModule, LineNeck, classifier_size
from .loop import ROOT
from .matcher import Matcher, MatcherConfig
from .networks import PLNet, PLNetConfig
from .quantize import FLOAT, FLOAT_CLASSIFIER, FLOAT_NECK, features, photos, proposals, quantize

OPSET = 17
PACK = Path(__file__).resolve().parents[2] / "models/airslam-fast"
MATCHER_POINTS = 400
CALIBRATION = 120  # photos that the ranges of int8 are taken from
MAPS = {"features4": 4, "features8": 8, "features16": 16}  # the backbone's features that PLNet hands out: pixels a cell


def widths(c: PLNetConfig) -> tuple[int, ...]:
    """Channels of each of MAPS."""
    return c.w4, c.w8, c.w16


def fold_batch_norms(net: nn.Module) -> nn.Module:
    """Copy of an eval-mode network whose Conv2d + BatchNorm2d neighbours in Sequentials are one convolution."""
    net = copy.deepcopy(net).eval()
    for m in list(net.modules()):
        if not isinstance(m, nn.Sequential):
            continue
        for i in range(len(m) - 1):
            if isinstance(m[i], nn.Conv2d) and isinstance(m[i + 1], nn.BatchNorm2d):
                m[i], m[i + 1] = fuse_conv_bn_eval(m[i], m[i + 1]), nn.Identity()
    return net


def cells(maps: torch.Tensor) -> torch.Tensor:
    """1 x C x h x w -> h * w rows of C values, cell after cell: how all maps that are sampled are handed out."""
    return maps.permute(0, 2, 3, 1).reshape(-1, maps.shape[1])


class Features(nn.Module):
    """Image -> scores, 16 a cell at /4 (row by row of its 4 x 4 pixels), and the backbone's features at /4, /8, /16, as cells.

    The features leave through 1 x 1 convolutions that change nothing: OpenVINO then writes them as cells at once, where it
    would otherwise transpose their bytes one by one (15.7 -> 14.5 ms an image of 752 x 480)."""

    def __init__(self, net: PLNet):
        super().__init__()
        self.net = net
        self.exits = nn.ModuleList(nn.Conv2d(w, w, 1, bias=False) for w in widths(net.config))
        for leave in self.exits:
            leave.weight.data = torch.eye(len(leave.weight))[..., None, None]

    def forward(self, image: torch.Tensor):
        features = self.net.backbone(image)
        maps = [cells(leave(f)) for leave, f in zip(self.exits, features)]
        return cells(self.net.keypoints.score_cells(*features[:2])), *maps


class SplitNeck(nn.Module):
    """The line neck on features 1 x h x w x C; what comes out together in training comes out of a convolution of its own."""

    def __init__(self, neck: LineNeck):
        super().__init__()
        self.neck = neck
        self.junctions, self.pooled = [self._part(neck.rest, part) for part in (slice(JUNCTION), slice(JUNCTION, None))]

    @staticmethod
    def _part(convolution: nn.Conv2d, outputs: slice) -> nn.Conv2d:
        weight, bias = convolution.weight.data[outputs], convolution.bias.data[outputs]
        part = nn.Conv2d(weight.shape[1], weight.shape[0], 1)
        part.weight.data, part.bias.data = weight.clone(), bias.clone()
        return part

    def forward(self, *features: torch.Tensor):
        x = self.neck.merge(*[f.permute(0, 3, 1, 2) for f in features])
        return self.neck.field(x), self.junctions(x), cells(self.pooled(x))


def write_onnx(net: nn.Module, path: Path, inputs: dict[str, tuple], outputs: list[str], axes: dict) -> None:
    """`inputs`: shape of each; `axes`: name -> {axis: name} of those that vary."""
    torch.onnx.export(net, tuple(torch.zeros(s) for s in inputs.values()), str(path), input_names=list(inputs),
                      output_names=outputs, dynamic_axes=axes, opset_version=OPSET, dynamo=False)
    onnx.checker.check_model(onnx.load(str(path)))


def export_plnet(net: PLNet, path: Path) -> None:
    """Write the part of PLNet that sees every image: `image` 1x1xHxW -> `score_logits` (HW/16)x16 and `features4`,
    `features8`, `features16`, cells x channels; H, W dynamic."""
    outputs = ["score_logits", *MAPS]
    write_onnx(fold_batch_norms(Features(net)), path, {"image": (1, 1, 64, 96)}, outputs,
               {"image": {2: "H", 3: "W"}} | {name: {0: f"cells_{name}"} for name in outputs})


def export_descriptor_head(net: PLNet, path: Path) -> None:
    """Write the descriptor head for features sampled at points: `features` N x (w4 + w8 + w16) -> `descriptors` N x D.
    Bilinear sampling and the head's 1 x 1 convolutions change places; only what lies between its two ReLUs is approximate."""
    write_onnx(net.keypoints.at_points().eval(), path, {"features": (2, sum(widths(net.config)))}, ["descriptors"],
               {"features": {0: "N"}, "descriptors": {0: "N"}})


def export_lines(net: PLNet, module: LineModule, path: Path, classifier: Path) -> None:
    """Write the line neck, `features4`, `features8`, `features16` 1 x h x w x C -> `line_field` 1x6xH/4xW/4, `junction_maps`
    1x3xH/4xW/4 and `line_features` (HW/16) x C, and the classifier of proposals: `features` N x D -> `logits` N x 1."""
    inputs = {name: (1, 80 // s, 112 // s, w) for (name, s), w in zip(MAPS.items(), widths(net.config))}
    axes = {name: {1: f"h_{name}", 2: f"w_{name}"} for name in MAPS}
    axes |= {name: {2: "H4", 3: "W4"} for name in ("line_field", "junction_maps")} | {"line_features": {0: "cells"}}
    write_onnx(fold_batch_norms(SplitNeck(module.neck)), path, inputs, ["line_field", "junction_maps", "line_features"], axes)
    size = classifier_size(module.config)
    write_onnx(copy.deepcopy(module.classifier.layers).eval(), classifier, {"features": (2, size)}, ["logits"],
               {"features": {0: "N"}, "logits": {0: "N"}})


def export_stage(stage: nn.Module, path: Path, n: int = MATCHER_POINTS) -> None:
    """Write one matcher stage with n points a side (static; padding is masked)."""
    stage = copy.deepcopy(stage).eval()
    first, width = stage.first, stage.confidence.in_features
    kind, size = ("descriptors", stage.embed.in_features) if first else ("state", width)
    inputs = {f"{kind}0": (1, n, size), f"{kind}1": (1, n, size), "keypoints0": (1, n, 2), "keypoints1": (1, n, 2),
              "mask0": (1, n), "mask1": (1, n)}
    # ONNX forbids an output to be called as an input, and later stages read `state0`: hence `next_state0`.
    outputs = ["next_state0", "next_state1", "scores", "confidence0", "confidence1"]
    torch.onnx.export(stage, tuple(torch.ones(s) for s in inputs.values()), str(path), input_names=list(inputs),
                      output_names=outputs, opset_version=OPSET, dynamo=False)
    onnx.checker.check_model(onnx.load(str(path)))


def load_plnet(checkpoint: Path) -> PLNet:
    """The averaged network of a training checkpoint, in eval mode."""
    state = torch.load(checkpoint, map_location="cpu", weights_only=True)
    net = PLNet(PLNetConfig(**state["config"]["network"]))
    net.load_state_dict(state["average"])
    return net.eval()


def load_lines(checkpoint: Path, net: PLNet) -> LineModule:
    """The averaged line module of a training checkpoint, for the backbone of `net`, in eval mode."""
    state = torch.load(checkpoint, map_location="cpu", weights_only=True)
    module = LineModule(net.config, LineConfig(**state["config"]["network"]))
    module.load_state_dict(state["average"])
    return module.eval()


def load_matcher(checkpoint: Path) -> Matcher:
    """The averaged matcher of a training checkpoint, in eval mode."""
    state = torch.load(checkpoint, map_location="cpu", weights_only=True)
    c = dict(state["config"]["network"])
    matcher = Matcher(MatcherConfig(**{**c, "layers": tuple(c["layers"])}))
    matcher.load_state_dict(state["average"])
    return matcher.eval()


def file_entry(path: Path) -> dict:
    data = path.read_bytes()
    return {"file": path.name, "sha256": hashlib.sha256(data).hexdigest(), "bytes": len(data)}


def lines_entry(pack: Path, c: LineConfig = LineConfig(), o: DecoderOptions = DecoderOptions()) -> dict:
    """What the manifest says of the line module that lies in `pack`."""
    return {**file_entry(pack / "line_neck.onnx"), "field": "line_field", "junctions": "junction_maps", "stride": STRIDE,
            "pooled": [{"output": "line_features", "channels": c.pooled, "stride": STRIDE, "samples": c.samples, "end_offsets": END_OFFSETS}],
            "reach": REACH, "min_confidence": o.confidence, "min_junction": o.junction, "max_junctions": o.junctions, "snap": o.snap,
            "min_support": o.support, "double_radius": o.double, "overlap_radius": o.overlap, "max_proposals": o.proposals,
            "classifier": {**file_entry(pack / "line_classifier.onnx"), "input": "features", "output": "logits"}}


def write_manifest(pack: Path, training: dict, quality: dict, c: PLNetConfig = PLNetConfig()) -> None:
    """manifest.json of the files that lie in `pack`; the C++ loader checks names, sizes and digests."""
    maps = [{"output": name, "channels": w, "stride": s} for (name, s), w in zip(MAPS.items(), widths(c))]
    head = {**file_entry(pack / "descriptor_head.onnx"), "input": "features", "output": "descriptors"}
    manifest = {"format": 2, "name": pack.name, "license": "BSD-3-Clause",
                "features": {**file_entry(pack / "plnet.onnx"), "input": "image", "normalization": "standardize",
                             "multiple": 16, "scores": "score_logits", "score_stride": STRIDE, "layout": "cells",
                             "maps": maps, "half_pixel": True, "descriptor_head": head, "descriptor_size": c.descriptor,
                             "score_threshold": -5.0, "nms_radius": 2}}
    if (pack / "line_neck.onnx").exists():
        manifest["features"]["lines"] = lines_entry(pack)
    stages = sorted(pack.glob("matcher_stage*.onnx"))
    if stages:
        manifest["matcher"] = {"keypoints": MATCHER_POINTS, "threshold": 0.1, "exit_confidence": 0.95,
                               "stages": [file_entry(p) for p in stages]}
    # Trained by `airslam train-vocabulary` on the descriptors of plnet.onnx; it names that file's digest itself.
    if (pack / "vocabulary.bin").exists():
        manifest["vocabulary"] = file_entry(pack / "vocabulary.bin")
    manifest |= {"quality": quality, "training": training}
    (pack / "manifest.json").write_text(json.dumps(manifest, indent=2) + "\n")


@contextlib.contextmanager
def scratch(name: str):
    """The path of a file that is gone afterwards."""
    with tempfile.TemporaryDirectory() as folder:
        yield Path(folder) / name


def config_of(name: str, seed: int) -> str:
    """The name of a network's configuration with this seed: each of its rounds has one of its own."""
    return next(f.name for f in sorted((ROOT / "config").glob(f"{name}*.yaml")) if yaml.safe_load(f.read_text())["seed"] == seed)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--plnet", type=Path, default=CACHE / "runs/plnet/checkpoint.pt")
    parser.add_argument("--lines", type=Path, default=CACHE / "runs/lines_long/checkpoint.pt")
    parser.add_argument("--matcher", type=Path, default=CACHE / "runs/matcher/checkpoint.pt")
    parser.add_argument("--quality", type=Path, help="json with measured numbers, copied into the manifest")
    parser.add_argument("--only", nargs="*", default=["plnet", "lines", "matcher"], help="leave the others as they are")
    options = parser.parse_args()
    PACK.mkdir(parents=True, exist_ok=True)
    manifest = PACK / "manifest.json"
    known = json.loads(manifest.read_text()) if manifest.exists() else {}
    training, quality = known.get("training", {}), known.get("quality", {})
    for name in options.only:
        checkpoint = getattr(options, name)
        if not checkpoint.exists():
            continue
        state = torch.load(checkpoint, map_location="cpu", weights_only=True)
        seed = state["config"]["seed"]
        training[name] = {"config": f"training/config/{config_of(name, seed)}", "seed": seed, "steps": state["step"]}
        if name == "plnet":
            with scratch("plnet.onnx") as raw:
                export_plnet(load_plnet(checkpoint), raw)
                quantize(raw, PACK / "plnet.onnx", photos(CALIBRATION, 5), FLOAT)
            export_descriptor_head(load_plnet(checkpoint), PACK / "descriptor_head.onnx")
        elif name == "lines":
            net = load_plnet(options.plnet)
            module = load_lines(checkpoint, net)
            with scratch("line_neck.onnx") as neck, scratch("line_classifier.onnx") as classifier:
                export_lines(net, module, neck, classifier)
                quantize(neck, PACK / "line_neck.onnx", features(PACK / "plnet.onnx", MAPS, photos(CALIBRATION, 5)), FLOAT_NECK)
                quantize(classifier, PACK / "line_classifier.onnx", proposals(net.backbone, module, photos(CALIBRATION, 5)), FLOAT_CLASSIFIER)
        else:
            for i, stage in enumerate(load_matcher(checkpoint).stages):
                export_stage(stage, PACK / f"matcher_stage{i}.onnx")
    if options.quality:
        quality = json.loads(options.quality.read_text())
    write_manifest(PACK, training, quality)
    print(json.dumps(training))


if __name__ == "__main__":
    main()

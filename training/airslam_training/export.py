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
from torch import nn
from torch.nn.utils.fusion import fuse_conv_bn_eval

from .cache import CACHE
from .lines import EXTRA, REACH, STRIDE, DecoderOptions, LineConfig, LineModule, LineNeck
from .matcher import Matcher, MatcherConfig
from .networks import PLNet, PLNetConfig
from .quantize import quantize

OPSET = 17
PACK = Path(__file__).resolve().parents[2] / "models/airslam-fast"
MATCHER_POINTS = 400


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


def export_plnet(net: nn.Module, path: Path) -> None:
    """Write PLNet as ONNX: `image` 1x1xHxW -> `descriptors` 1x64xH/4xW/4, `score_logits` 1x1xHxW; H, W dynamic."""
    folded = fold_batch_norms(net)
    axes = {"image": {2: "H", 3: "W"}, "descriptors": {2: "H4", 3: "W4"}, "score_logits": {2: "H", 3: "W"}}
    torch.onnx.export(folded, (torch.zeros(1, 1, 64, 96),), str(path), input_names=["image"],
                      output_names=["descriptors", "score_logits"], dynamic_axes=axes, opset_version=OPSET,
                      dynamo=False)
    onnx.checker.check_model(onnx.load(str(path)))


class PLNetWithLines(nn.Module):
    """All of PLNet in one graph; the pooled features come with channels last, as sampling along lines reads them."""

    def __init__(self, net: PLNet, neck: LineNeck):
        super().__init__()
        self.net, self.neck = net, neck

    def forward(self, image: torch.Tensor):
        features = self.net.backbone(image)
        field, junctions, pooled = self.neck(*features)
        return *self.net.keypoints(*features), field, junctions, pooled.permute(0, 2, 3, 1)


def export_lines(net: PLNet, module: LineModule, path: Path, classifier: Path) -> None:
    """Write PLNet with its line module, and the classifier of proposals: `features` N x D -> `logits` N, N dynamic."""
    outputs = ["descriptors", "score_logits", "line_field", "junction_maps", "line_features"]
    axes = {"image": {2: "H", 3: "W"}, "descriptors": {2: "H4", 3: "W4"}, "score_logits": {2: "H", 3: "W"},
            "line_field": {2: "H4", 3: "W4"}, "junction_maps": {2: "H4", 3: "W4"}, "line_features": {1: "H4", 2: "W4"}}
    torch.onnx.export(fold_batch_norms(PLNetWithLines(net, module.neck)), (torch.zeros(1, 1, 80, 112),), str(path),
                      input_names=["image"], output_names=outputs, dynamic_axes=axes, opset_version=OPSET, dynamo=False)
    size = module.config.samples * module.config.pooled + EXTRA
    torch.onnx.export(copy.deepcopy(module.classifier).eval(), (torch.zeros(2, size),), str(classifier),
                      input_names=["features"], output_names=["logits"],
                      dynamic_axes={"features": {0: "N"}, "logits": {0: "N"}}, opset_version=OPSET, dynamo=False)
    for file in (path, classifier):
        onnx.checker.check_model(onnx.load(str(file)))


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
    return {**file_entry(pack / "plnet_lines.onnx"), "field": "line_field", "junctions": "junction_maps",
            "pooled": "line_features", "channels": c.pooled, "samples": c.samples, "stride": STRIDE, "reach": REACH,
            "min_confidence": o.confidence, "min_junction": o.junction, "max_junctions": o.junctions, "snap": o.snap,
            "min_support": o.support, "double_radius": o.double, "max_proposals": o.proposals,
            "classifier": {**file_entry(pack / "line_classifier.onnx"), "input": "features", "output": "logits"}}


def write_manifest(pack: Path, training: dict, quality: dict) -> None:
    """manifest.json of the files that lie in `pack`; the C++ loader checks names, sizes and digests."""
    manifest = {"format": 1, "name": pack.name, "license": "BSD-3-Clause",
                "features": {**file_entry(pack / "plnet.onnx"), "input": "image", "normalization": "standardize",
                             "multiple": 16, "descriptors": "descriptors", "scores": "score_logits",
                             "descriptor_size": 64, "descriptor_stride": 4, "half_pixel": True,
                             "score_threshold": -5.0, "nms_radius": 2}}
    if (pack / "plnet_lines.onnx").exists():
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


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--plnet", type=Path, default=CACHE / "runs/plnet/checkpoint.pt")
    parser.add_argument("--lines", type=Path, default=CACHE / "runs/lines/checkpoint.pt")
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
        training[name] = {"config": f"training/config/{name}.yaml", "seed": state["config"]["seed"], "steps": state["step"]}
        if name == "plnet":
            with scratch("plnet.onnx") as raw:
                export_plnet(load_plnet(checkpoint), raw)
                quantize(raw, PACK / "plnet.onnx")
        elif name == "lines":
            net = load_plnet(options.plnet)
            with scratch("plnet_lines.onnx") as raw:
                export_lines(net, load_lines(checkpoint, net), raw, PACK / "line_classifier.onnx")
                quantize(raw, PACK / "plnet_lines.onnx")
        else:
            for i, stage in enumerate(load_matcher(checkpoint).stages):
                export_stage(stage, PACK / f"matcher_stage{i}.onnx")
    if options.quality:
        quality = json.loads(options.quality.read_text())
    write_manifest(PACK, training, quality)
    print(json.dumps(training))


if __name__ == "__main__":
    main()

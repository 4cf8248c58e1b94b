# SPDX-License-Identifier: BSD-3-Clause
"""Time ONNX models in OpenVINO on one core: `python -m airslam_training.bench [model.onnx ...]`.

Without arguments it times untrained candidates of PLNet, which is how the widths were chosen.
"""
from __future__ import annotations

import sys
import time
from pathlib import Path

import numpy as np
import openvino as ov
import torch

from .networks import PLNet, PLNetConfig

CANDIDATES = {
    "A 16-32-64-96": PLNetConfig(),
    "B 16-32-64-96 n4=4": PLNetConfig(n4=4, n8=2),
    "C 16-48-64-96": PLNetConfig(w4=48, n4=2, n8=2),
    "D 16-32-64-128": PLNetConfig(w16=128, n8=4, n16=4),
    "E 16-32-48-64 small": PLNetConfig(w8=48, w16=64, n8=2, n16=2, fused=48),
    "F 16-48-64-96 score48": PLNetConfig(w4=48, n4=3, n8=3, score=48),
}


def milliseconds(model: ov.Model, inputs: dict, precision: str, threads: int = 1, rounds: int = 15) -> float:
    """Median inference time of a model on the CPU."""
    hint = {"INFERENCE_PRECISION_HINT": precision, "INFERENCE_NUM_THREADS": threads, "NUM_STREAMS": 1}
    compiled = ov.Core().compile_model(model, "CPU", hint)
    request = compiled.create_infer_request()
    times = []
    for _ in range(rounds + 3):
        start = time.perf_counter()
        request.infer(inputs)
        times.append(time.perf_counter() - start)
    return 1e3 * float(np.median(times[3:]))


def macs(net: torch.nn.Module, h: int, w: int) -> float:
    """Multiply-accumulates of all convolutions for one image, in 1e9."""
    total = 0

    def hook(m, _, out):
        nonlocal total
        total += out.shape[2] * out.shape[3] * m.weight.numel()

    handles = [m.register_forward_hook(hook) for m in net.modules() if isinstance(m, torch.nn.Conv2d)]
    with torch.no_grad():
        net(torch.zeros(1, 1, h, w))
    for handle in handles:
        handle.remove()
    return total / 1e9


def main() -> None:
    h, w = 480, 768
    image = np.random.default_rng(0).normal(size=(1, 1, h, w)).astype(np.float32)
    if len(sys.argv) > 1:
        for name in sys.argv[1:]:
            model = ov.Core().read_model(name)
            row = [milliseconds(model, {"image": image}, p) for p in ("f32", "bf16")]
            print(f"{Path(name).name:28s} f32 {row[0]:6.2f} ms  bf16 {row[1]:6.2f} ms  (480x768, one core)")
        return
    for name, config in CANDIDATES.items():
        net = PLNet(config).eval()
        path = Path("/tmp/plnet_candidate.onnx")
        from .export import export_plnet
        export_plnet(net, path)
        model = ov.Core().read_model(path)
        row = [milliseconds(model, {"image": image}, p) for p in ("f32", "bf16")]
        params = sum(p.numel() for p in net.parameters()) / 1e3
        print(f"{name:24s} {2 * macs(net, h, w):5.2f} GFLOP {params:6.0f}k  f32 {row[0]:6.2f}  bf16 {row[1]:6.2f} ms")


if __name__ == "__main__":
    main()

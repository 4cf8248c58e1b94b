# SPDX-License-Identifier: BSD-3-Clause
import hashlib
import json

import numpy as np
import onnxruntime
import pytest
import torch

from airslam_training.export import (MAPS, PACK, export_descriptor_head, export_plnet, export_stage, widths,
                                     write_manifest)
from airslam_training.matcher import Matcher, MatcherConfig
from airslam_training.networks import PLNet


def session(path):
    return onnxruntime.InferenceSession(str(path), providers=["CPUExecutionProvider"])


def shake(net, seed=0):
    """Random batch-norm statistics and weights, so that nothing is hidden by zeros."""
    g = torch.Generator().manual_seed(seed)
    for name, value in net.state_dict().items():
        if value.is_floating_point():
            low = 0.5 if "var" in name else -0.3
            value.copy_(torch.rand(value.shape, generator=g) * 0.6 + low if value.ndim < 2 else value + 0.05
                        * torch.randn(value.shape, generator=g))
    return net.eval()


def test_plnet_torch_and_onnx_agree_at_two_sizes(tmp_path):
    net = shake(PLNet())
    export_plnet(net, tmp_path / "plnet.onnx")
    run = session(tmp_path / "plnet.onnx")
    for h, w in ((64, 96), (80, 48)):
        x = torch.randn(1, 1, h, w, generator=torch.Generator().manual_seed(1))
        with torch.no_grad():
            features, scores = net.backbone(x), net(x)[1][0, 0].numpy()
        got = run.run(["score_logits", *MAPS], {"image": x.numpy()})
        plane = got[0].reshape(h // 4, w // 4, 4, 4).transpose(0, 2, 1, 3).reshape(h, w)
        assert np.allclose(scores, plane, atol=1e-3 * max(1, np.abs(scores).max()))
        for a, b in zip(features, got[1:]):
            assert np.allclose(a[0].permute(1, 2, 0).reshape(b.shape).numpy(), b, atol=1e-3 * max(1, np.abs(b).max()))


def test_the_descriptor_head_equals_the_dense_one_where_all_cells_are_alike(tmp_path):
    net = shake(PLNet(), 3)
    export_descriptor_head(net, tmp_path / "head.onnx")
    levels = [torch.randn(1, c, 1, 1, generator=torch.Generator().manual_seed(c)) for c in widths(net.config)]
    with torch.no_grad():
        dense = net.keypoints(*[v.expand(-1, -1, 64 // s, 96 // s) for v, s in zip(levels, MAPS.values())])[0]
    rows = torch.cat([v[0, :, 0, 0] for v in levels])[None].repeat(5, 1)
    got = session(tmp_path / "head.onnx").run(None, {"features": rows.numpy()})[0]
    assert np.allclose(got, dense[0, :, 7, 9].numpy(), atol=1e-4 * np.abs(got).max())


@pytest.fixture(scope="module")
def matcher():
    return shake(Matcher(MatcherConfig()), 5)


def points_and_descriptors(n, valid, seed):
    g = torch.Generator().manual_seed(seed)
    p = torch.rand(1, n, 2, generator=g) * 2 - 1
    d = torch.nn.functional.normalize(torch.randn(1, n, 64, generator=g), dim=-1)
    return p, d, (torch.arange(n) < valid).float()[None]


def test_stages_in_onnx_equal_the_training_forward(tmp_path, matcher):
    n = 48
    p0, d0, m0 = points_and_descriptors(n, 40, 1)
    p1, d1, m1 = points_and_descriptors(n, 33, 2)
    inputs = dict(keypoints0=p0, keypoints1=p1, mask0=m0, mask1=m1)
    state = dict(descriptors0=d0, descriptors1=d1)
    with torch.no_grad():
        raw = matcher(p0, d0, m0, p1, d1, m1)
    from airslam_training.matcher import log_scores
    for i, stage in enumerate(matcher.stages):
        export_stage(stage, tmp_path / f"s{i}.onnx", n)
        run = session(tmp_path / f"s{i}.onnx")
        assert {x.name for x in run.get_inputs()} == set(inputs) | set(state)
        feed = {k: v.numpy() if torch.is_tensor(v) else v for k, v in {**inputs, **state}.items()}
        out = dict(zip([o.name for o in run.get_outputs()], run.run(None, feed)))
        state = {f"state{s}": out[f"next_state{s}"] for s in (0, 1)}
        expected = log_scores(raw[i]).exp()[0, :40, :33].numpy()
        assert np.allclose(out["scores"][0, :40, :33], expected, atol=2e-3)
        assert (out["scores"][0, 40:] == 0).all() and (out["scores"][0, :, 33:] == 0).all()


def test_padding_does_not_change_the_scores(matcher):
    p0, d0, m0 = points_and_descriptors(32, 20, 3)
    p1, d1, m1 = points_and_descriptors(32, 25, 4)
    stage = matcher.stages[0]
    with torch.no_grad():
        padded = stage(d0, d1, p0, p1, m0, m1)[2][0, :20, :25]
        exact = stage(d0[:, :20], d1[:, :25], p0[:, :20], p1[:, :25], m0[:, :20], m1[:, :25])[2][0]
    assert torch.allclose(padded, exact, atol=1e-5)


def test_untrained_matcher_is_nearest_neighbour():
    p, d, m = points_and_descriptors(30, 30, 6)
    order = torch.randperm(30, generator=torch.Generator().manual_seed(7))
    stage = Matcher().eval().stages[0]
    with torch.no_grad():
        scores = stage(d, d[:, order], p, p[:, order], m, m)[2][0]
    assert torch.equal(order[scores.argmax(1)], torch.arange(30))


def test_manifest_states_digests_and_sizes(tmp_path):
    (tmp_path / "plnet.onnx").write_bytes(b"net")
    (tmp_path / "descriptor_head.onnx").write_bytes(b"head")
    write_manifest(tmp_path, {}, {})
    entry = json.loads((tmp_path / "manifest.json").read_text())["features"]
    assert entry["sha256"] == hashlib.sha256(b"net").hexdigest() and entry["bytes"] == 3


def test_manifest_keeps_a_vocabulary(tmp_path):
    (tmp_path / "plnet.onnx").write_bytes(b"network")
    (tmp_path / "descriptor_head.onnx").write_bytes(b"head")
    write_manifest(tmp_path, {}, {})
    assert "vocabulary" not in json.loads((tmp_path / "manifest.json").read_text())
    (tmp_path / "vocabulary.bin").write_bytes(b"words")
    write_manifest(tmp_path, {}, {})
    entry = json.loads((tmp_path / "manifest.json").read_text())["vocabulary"]
    assert entry["file"] == "vocabulary.bin" and entry["bytes"] == 5


def test_shipped_pack_matches_its_manifest():
    if not (PACK / "manifest.json").exists():
        pytest.skip(f"no model pack in {PACK}")
    manifest = json.loads((PACK / "manifest.json").read_text())
    features = manifest["features"]
    lines = [features["lines"], features["lines"]["classifier"]] if "lines" in features else []
    for entry in [features, features["descriptor_head"], *lines, *manifest.get("matcher", {}).get("stages", [])]:
        data = (PACK / entry["file"]).read_bytes()
        assert hashlib.sha256(data).hexdigest() == entry["sha256"] and len(data) == entry["bytes"]

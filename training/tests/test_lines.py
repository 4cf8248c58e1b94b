# SPDX-License-Identifier: BSD-3-Clause
import json

import subprocess

import cv2
import numpy as np
import onnxruntime
import pytest
import torch

from airslam_training.export import MAPS, PACK, export_lines
from airslam_training.line_data import Wireframe, clip_segments, encode, warp_segments
from airslam_training.line_labels import (PHOTOS, end_distance, join_ends, merge_views, read_packed, read_wireframe, refine,
                                          visibility, without_doubles, write_packed)
from airslam_training.lines import (END_OFFSETS, EXTRA, REACH, DecoderOptions, LineConfig, LineModule, classifier_features,
                                    classifier_size, decode_field, discount_overlaps, find_junctions, propose, sample_ends)
from airslam_training.loop import ROOT
from airslam_training.networks import PLNet
from airslam_training.pack import PackNetworks
from airslam_training.procedural import make_views
from airslam_training.train_lines import field_losses, grow, junction_losses, label_proposals
from airslam_training.validate_lines import average_precision, hits
from test_export import shake

SEGMENTS = np.array([[20, 30, 200, 90, 1.0], [150, 120, 150, 10, 0.8], [10, 110, 120, 112, 0.6]])
H, W = 32, 56


def logit(p):
    p = np.clip(p, 1e-5, 1 - 1e-5)
    return np.log(p / (1 - p))


def raw_maps(segments):
    """What a perfect network would give."""
    field, junctions = encode(segments, H, W)
    raw = np.stack([np.where(field[0] > 0, 4, -4), logit(field[1] / REACH), field[2], field[3],
                    logit(field[4] / (np.pi / 2)), logit(-field[5] / (np.pi / 2))])
    heat = np.stack([np.where(junctions[0] > 0, 3, -6), *np.arctanh(2 * junctions[1:])])
    return torch.from_numpy(raw).float(), torch.from_numpy(heat).float(), field, junctions


def test_encoding_and_decoding_are_inverse():
    raw, _, field, _ = raw_maps(SEGMENTS)
    cells = torch.nonzero(torch.from_numpy(field[0]) > 0)
    assert len(cells) > 200
    found = decode_field(raw.double(), cells).numpy()
    clear = field[1][cells[:, 0], cells[:, 1]] > 0.5  # nearer cells cannot say where the ends are
    assert end_distance(found, SEGMENTS).min(1)[clear].max() < 0.05


def test_perfect_maps_propose_the_segments():
    raw, heat, _, _ = raw_maps(SEGMENTS)
    points, score = find_junctions(heat, DecoderOptions())
    ends = SEGMENTS[:, :4].reshape(-1, 2)
    assert len(points) == 6 and (score > 0.9).all()
    assert np.abs(points.numpy()[:, None] - ends[None]).sum(-1).min(0).max() < 0.01
    lines, extras, pairs, junctions = propose(raw, heat, DecoderOptions())
    assert len(lines) == 3 and extras.shape == (3, EXTRA) and pairs.max() < len(junctions)
    assert end_distance(lines.numpy(), SEGMENTS).min(0).max() < 0.01
    assert (lines[:, 0] <= lines[:, 2]).all()


def test_perfect_maps_cost_little_and_proposals_take_their_labels():
    raw, heat, field, junctions = raw_maps(SEGMENTS)
    losses = field_losses(raw[None], torch.from_numpy(field)[None], 1.0)
    losses |= junction_losses(heat[None], torch.from_numpy(junctions)[None], 1.0, 4.0)
    assert losses["field"] < 0.01 and losses["ends"] < 0.02 and losses["offset"] < 1e-3
    scores = label_proposals(torch.tensor([[201.0, 91, 20, 30], [20, 30, 200, 60]]), SEGMENTS, 60.0, 1.0)
    assert scores.tolist() == [1.0, 0.0]
    assert label_proposals(torch.zeros(2, 4), np.zeros((0, 5)), 60.0, 1.0).tolist() == [0, 0]


def test_labels_are_packed_within_half_a_step(tmp_path):
    labels = {"a": np.array([[1.3, 2, 30, 40.06, 0.5], [0, 0, 319, 12, 1]], np.float32), "b": np.zeros((0, 5), np.float32),
              "c": np.array([[5, 6, 7, 8, 0.25]], np.float32)}
    write_packed(tmp_path / "labels.npz", labels)
    known = read_packed(tmp_path / "labels.npz")
    assert list(known) == ["a", "b", "c"] and read_packed(tmp_path / "none.npz") == {}
    for name, rows in labels.items():
        assert known[name].shape == rows.shape and (np.abs(known[name] - rows) <= [0.0626] * 4 + [0.002]).all()


def test_the_shipped_labels_are_segments_of_photos():
    labels = read_packed(PHOTOS)
    assert len(labels) > 1500
    rows = np.concatenate(list(labels.values()))
    assert (rows[:, :4] > -3).all() and (rows[:, 4] > 0).all() and (rows[:, 4] <= 1).all()


def test_clipping_and_warping():
    cut = clip_segments(np.array([[-10, 20, 30, 20, 1.0], [5, -50, 5, -2, 1], [3, 3, 6, 3, 1], [0, 0, 99, 99, 0.5]]), 64)
    assert np.allclose(cut, [[0, 20, 30, 20, 1], [0, 0, 63, 63, 0.5]])
    turned = warp_segments(np.array([[0, -1.0, 63], [1, 0, 0], [0, 0, 1]]), np.array([[10, 20, 40, 20, 0.7]]), 64)
    assert np.allclose(turned, [[43, 10, 43, 40, 0.7]])


def drawn_edge():
    image = np.full((80, 100), 60, np.uint8)
    image[41:] = 160  # the edge lies at y = 40.5
    return image


def test_refinement_finds_the_gradient_and_visibility_the_contrast():
    rough = np.array([[20, 39.0, 80, 41.5, 0.9]])
    assert np.allclose(refine(drawn_edge(), rough)[0, [1, 3]], 40.5, atol=0.1)
    far = np.array([[20, 60.0, 80, 60.0, 0.9]])
    assert np.array_equal(refine(drawn_edge(), far)[0, [0, 2, 4]], far[0, [0, 2, 4]])
    assert visibility(drawn_edge(), np.array([[20, 40.5, 80, 40.5], [20, 60, 80, 60]])).tolist() == [1, 0]


def test_what_all_views_see_is_surer():
    views = {f"view_from_image{k}": np.diag([512 / 100, 512 / 80, 1.0]) for k in range(2)}
    views |= {"segments0": np.array([[10, 10, 90, 12, 0.8], [20, 60, 70, 60, 0.6]]),
              "segments1": np.array([[91, 12, 10, 11, 0.6]])}
    merged = merge_views(views, (80, 100))
    assert np.allclose(merged[:, 4], [0.7, 0.3]) and np.allclose(merged[0, :4], [10, 10.43, 90.43, 12], atol=0.01)


def test_ends_are_joined_and_doubles_dropped():
    joined = join_ends(np.array([[0, 0, 50, 50, 1.0], [51, 51, 90, 10, 1.0]]))
    assert np.allclose(joined[0, 2:4], 50.5) and np.allclose(joined[1, :2], 50.5)
    assert len(without_doubles(np.array([[0, 0, 50, 50, 0.4], [50, 51, 1, 0, 0.9], [0, 0, 50, 0, 0.1]]))) == 2


def test_average_precision_by_hand():
    truth = np.array([[0, 0, 10, 10], [50, 50, 60, 60.0]])
    found = np.array([[10, 10, 0, 1, 0.9], [0, 0, 10, 10, 0.8], [50, 50, 60, 62, 0.7]])
    assert hits(found, truth, 5).tolist() == [True, False, True]
    # Recall 0.5 at precision 1, then 1 at 2/3.
    assert average_precision([(found, truth)], 5) == pytest.approx(100 * (0.5 + 0.5 * 2 / 3))
    assert average_precision([(np.zeros((0, 5)), truth)], 5) == 0


def annotation(tmp_path, name="00031546", **change):
    data = {"filename": f"{name}.jpg", "junctions": [[10, 20], [60, 20], [60, 70]], "edges_positive": [[0, 1], [1, 2]]}
    path = tmp_path / f"{name}.json"
    path.write_text(json.dumps({**data, **change}))
    return path


def test_the_classifier_sees_beyond_the_ends():
    # The map says where a pixel lies: channel 0 its x, channel 1 its y.
    y, x = torch.meshgrid(torch.arange(40.0) * 4 + 1.5, torch.arange(60.0) * 4 + 1.5, indexing="ij")
    ends = torch.tensor([[60.0, 80, 120, 80], [80, 60, 110, 100]])
    seen = sample_ends(torch.stack([x, y]), ends).view(2, 2, len(END_OFFSETS), 2)
    off = torch.tensor(END_OFFSETS)
    assert torch.allclose(seen[0, 0, :, 0], 60 + off, atol=1e-3) and torch.allclose(seen[0, 1, :, 0], 120 - off, atol=1e-3)
    assert torch.allclose(seen[0, ..., 1], torch.tensor(80.0), atol=1e-3)
    assert torch.allclose(seen[1, 1], torch.stack([110 - 0.6 * off, 100 - 0.8 * off], 1), atol=1e-3)
    features = classifier_features(torch.stack([x, y]), ends, torch.zeros(2, EXTRA))
    assert features.shape == (2, classifier_size(LineConfig(pooled=2)))


def test_a_grown_classifier_begins_as_the_small_one_ended():
    torch.manual_seed(3)
    module, config = LineModule(), LineConfig()
    hidden, read = config.hidden - 32, config.samples * config.pooled + EXTRA
    small = torch.nn.Sequential(torch.nn.Linear(read, hidden), torch.nn.ReLU(), torch.nn.Linear(hidden, hidden),
                                torch.nn.ReLU(), torch.nn.Linear(hidden, 1))
    trained = module.state_dict() | {f"classifier.layers.{k}": v for k, v in small.state_dict().items()}
    grow(module, {k: v.clone() for k, v in trained.items()})
    features = torch.randn(20, classifier_size(config))
    assert torch.allclose(module.classifier(features), small(features[:, :read])[:, 0], atol=1e-5)


def test_of_several_guesses_at_a_lines_ends_the_surest_keeps_its_score():
    lines = torch.tensor([[0, 60, 100, 60, 0.9], [0, 0, 100, 0, 0.8], [0, 0, 50, 2, 0.5], [0, 0, 100, 60, 0.3]])
    found = discount_overlaps(lines, 8.0)
    assert torch.allclose(found[:, 4], torch.tensor([0.9, 0.8, 0.5 * (1 - 0.8 * 0.5), 0.3]), atol=1e-3)
    assert torch.equal(discount_overlaps(lines, 0.0), lines) and discount_overlaps(lines[:0], 8.0).shape == (0, 5)


def test_the_wireframe_format_is_read(tmp_path):
    name, segments = read_wireframe(annotation(tmp_path))
    assert name == "00031546.jpg"
    assert segments.tolist() == [[10, 20, 60, 20, 1], [60, 20, 60, 70, 1]]
    with pytest.raises(ValueError, match="names a junction outside 0..2"):
        read_wireframe(annotation(tmp_path, edges_positive=[[0, 3]]))
    broken = tmp_path / "broken.json"
    broken.write_text('{"points": []}')
    with pytest.raises(ValueError, match="not a Wireframe annotation"):
        read_wireframe(broken)


def test_a_wireframe_folder_is_a_source(tmp_path):
    with pytest.raises(FileNotFoundError, match="no annotation"):
        Wireframe(tmp_path)
    annotation(tmp_path)
    with pytest.raises(FileNotFoundError, match="no image 00031546.jpg"):
        Wireframe(tmp_path)
    cv2.imwrite(str(tmp_path / "00031546.jpg"), np.full((80, 100), 90, np.uint8))
    source = Wireframe(tmp_path)
    assert source.image(0).shape == (80, 100) and len(source.segments[0]) == 2


def test_lines_in_onnx_equal_pytorch(tmp_path):
    net, module = shake(PLNet(), 1), shake(LineModule(), 2)
    export_lines(net, module, tmp_path / "lines.onnx", tmp_path / "classifier.onnx")
    run = onnxruntime.InferenceSession(str(tmp_path / "lines.onnx"), providers=["CPUExecutionProvider"])
    for h, w in ((64, 96), (80, 112)):  # 80 / 16 is odd: the coarsest map is cut on its way up
        x = torch.randn(1, 1, h, w, generator=torch.Generator().manual_seed(1))
        with torch.no_grad():
            features = net.backbone(x)
            field, junctions, pooled = module.neck(*features)
            expected = [field, junctions, pooled[0].permute(1, 2, 0).flatten(0, 1)]
        feed = {name: f.permute(0, 2, 3, 1).contiguous().numpy() for name, f in zip(MAPS, features)}
        for a, b in zip(expected, run.run(None, feed)):
            assert np.allclose(a.numpy(), b, atol=2e-3 * max(1, np.abs(b).max()))
    run = onnxruntime.InferenceSession(str(tmp_path / "classifier.onnx"), providers=["CPUExecutionProvider"])
    features = torch.randn(5, run.get_inputs()[0].shape[1])
    with torch.no_grad():
        expected = module.classifier(features).numpy()
    assert np.allclose(expected, run.run(None, {"features": features.numpy()})[0][:, 0], atol=1e-4)


def test_the_program_agrees_with_python(tmp_path):
    program = ROOT.parent / "build/bin/airslam"
    if not program.exists() or not (PACK / "line_neck.onnx").exists():
        pytest.skip(f"no {program} or no line module in {PACK}")
    image = make_views(100003, [], 1)[1][0].images[0]
    cv2.imwrite(str(tmp_path / "room.png"), image)
    subprocess.run([program, "detect", tmp_path / "room.png", "--out", tmp_path / "out", "--line-scale", "1"], check=True,
                   capture_output=True)
    found = np.loadtxt(tmp_path / "out/room.lines.csv", delimiter=",", ndmin=2)
    expected = PackNetworks().lines(image)
    sure = expected[expected[:, 4] > 0.4]
    distance = end_distance(sure, found)
    # The program computes in bf16 where the CPU has it: a few junctions and scores fall out otherwise.
    same = distance.min(1) < 1.5
    assert len(sure) > 10 and same.mean() > 0.9
    assert np.abs(sure[same, 4] - found[distance.argmin(1)[same], 4]).mean() < 0.05

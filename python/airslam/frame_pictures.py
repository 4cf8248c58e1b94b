# SPDX-License-Identifier: BSD-3-Clause
"""Keyframes as pictures for a page: the camera's image with keypoints and lines drawn over it as SVG."""

from __future__ import annotations

import base64
import io
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from PIL import Image

from .raw_images import RawCamera, bent, left_images, raw_camera
from .results import Results

IN_MAP_POINT, POINT, IN_MAP_LINE, LINE = "#27e0a0", "#ffffff", "#ff9d2e", "#ffe27a"
LINE_SCORE = 0.4  # lines below are proposals that mapping does not use


@dataclass
class FramePicture:
    """One picture and what to say below it."""

    svg: str
    timestamp_ns: int
    points: int
    points_in_map: int
    lines: int
    lines_in_map: int


def used_lines(keyframe: object) -> np.ndarray:
    """(n,) bools: the lines of a keyframe that mapping uses."""
    return np.asarray(keyframe.line_scores) >= LINE_SCORE


def _jpeg(file: Path, quality: int = 82) -> tuple[str, tuple[int, int]]:
    """A grey image file as base64 JPEG, and its size."""
    image = Image.open(file)
    if image.mode.startswith(("I", "F")):  # 16 bits: to 8 by its own range
        values = np.asarray(image, dtype=np.float64)
        image = Image.fromarray((255 * values / max(values.max(), 1)).astype(np.uint8))
    stream = io.BytesIO()
    image.convert("L").save(stream, "JPEG", quality=quality)
    return base64.b64encode(stream.getvalue()).decode(), image.size


def _circles(pixels: np.ndarray, style: str) -> str:
    path = "".join(f"M{x - 2.6:.1f} {y:.1f}a2.6 2.6 0 1 0 5.2 0a2.6 2.6 0 1 0-5.2 0" for x, y in pixels)
    return f'<path d="{path}" {style}/>' if path else ""


def _lines(segments: np.ndarray, camera: RawCamera, style: str) -> str:
    path = "".join("M" + "L".join(f"{x:.1f} {y:.1f}" for x, y in strip) for strip in bent(segments, camera))
    return f'<path d="{path}" {style}/>' if path else ""


def _picture(file: Path, keyframe: object, camera: RawCamera) -> FramePicture:
    data, (width, height) = _jpeg(file)
    pixels = camera.distort(np.asarray(keyframe.keypoints, dtype=float))
    point_seen = np.asarray(keyframe.landmark_ids) >= 0
    used = used_lines(keyframe)
    segments = np.asarray(keyframe.lines, dtype=float)[used]
    ids = np.asarray(keyframe.line_landmark_ids)
    line_seen = ids[used] >= 0 if len(ids) == len(used) else np.zeros(len(segments), dtype=bool)
    thin, thick = 'fill="none" stroke-width="1.3"', 'fill="none" stroke-width="2.6"'
    svg = (f'<svg viewBox="0 0 {width} {height}" role="img"><image width="{width}" height="{height}" '
           f'href="data:image/jpeg;base64,{data}"/>'
           + _lines(segments[~line_seen], camera, f'{thin} stroke="{LINE}" opacity="0.75"')
           + _lines(segments[line_seen], camera, f'{thick} stroke="{IN_MAP_LINE}"')
           + _circles(pixels[~point_seen], f'{thin} stroke="{POINT}" opacity="0.7"')
           + _circles(pixels[point_seen], f'{thin} stroke="{IN_MAP_POINT}"') + "</svg>")
    return FramePicture(svg, int(keyframe.timestamp_ns), len(pixels), int(point_seen.sum()),
                        len(segments), int(line_seen.sum()))


def frame_pictures(results: Results, dataset: Path | None, count: int = 6) -> list[FramePicture]:
    """Pictures of keyframes spread evenly over the map; none where the images are not at hand."""
    images = left_images(dataset) if dataset is not None else {}
    times = results.map.timestamps_ns
    rows = [row for row in range(len(times)) if images.get(int(times[row]), Path()).is_file()]
    if not rows:
        return []
    calibration = results.map.calibration
    camera = raw_camera(dataset, calibration.camera_matrix, calibration.body_from_camera)
    chosen = sorted({rows[round(i)] for i in np.linspace(0, len(rows) - 1, min(count, len(rows)))})
    return [_picture(images[int(times[row])], results.map.keyframe(row), camera) for row in chosen]

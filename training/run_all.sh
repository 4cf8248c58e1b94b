#!/bin/sh
# SPDX-License-Identifier: BSD-3-Clause
# Everything from data to weights and tables. Each step can be repeated; trainings go on from their last checkpoint.
# Needs /work/shared (photos, teachers, Oxford) and training/requirements.txt; writes to /work/cache/train.
set -e
cd "$(dirname "$0")"
. ./env.sh
python=${PYTHON:-/work/venv/train/bin/python}

$python -m airslam_training.procedural --scenes 131 --held 12  # rooms with depth, poses and edges
$python -m airslam_training.cache photos --count 13600         # crops and the teacher's answers
$python -m airslam_training.cache procedural --count 2400
$python -m airslam_training.train_plnet                        # config/plnet.yaml
$python -m airslam_training.export                             # models/airslam-fast/plnet.onnx, manifest.json
$python -m airslam_training.mlsd                               # the line teacher's answers to views of each photo
$python -m airslam_training.line_labels                        # merged, fitted to gradients; exact edges of scenes
$python -m airslam_training.train_lines                        # config/lines.yaml, then what it was gone on with
$python -m airslam_training.train_lines --config config/lines_ends.yaml --run lines_ends --processes 1
$python -m airslam_training.train_lines --config config/lines_long.yaml --run lines_long --processes 1
../build/bin/airslam train-vocabulary /work/shared/data/photos --out ../models/airslam-fast/vocabulary.bin  # its words; make build
$python -m airslam_training.features                           # our features of altered views
$python -m airslam_training.train_matcher                      # config/matcher.yaml
$python -m airslam_training.export                             # line module and matcher stages, too
$python -m airslam_training.evaluate_lines                     # results/lines.md
$python -m airslam_training.evaluate                           # results/*.md, quality.json
$python -m airslam_training.export --quality results/quality.json
$python -m airslam_training.bench                              # times on one core
$python -m airslam_training.draw                               # curves and pictures

#!/usr/bin/env bash
# SPDX-License-Identifier: BSD-3-Clause
#
# Maps the example sequence, evaluates the trajectory and writes the page about it: out/demo/report.html. `make demo` builds
# what this needs. Arguments: [dataset] [output folder].
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."

readonly dataset=${1:-examples/warehouse_day}
readonly out=${2:-out/demo}
readonly airslam=build/bin/airslam
readonly python=.venv/bin/python
readonly mav0=$dataset/mav0
readonly truth=$mav0/state_groundtruth_estimate0/data.csv

for needed in "$airslam" "$python" "$truth"; do
  [ -e "$needed" ] || { echo "demo: $needed is missing; run \`make demo\`" >&2; exit 1; }
done

# The image of the n-th row (from 1) of the left camera's list.
left_image() {
  printf '%s/cam0/data/%s' "$mav0" "$(sed -n "$(($1 + 1))p" "$mav0/cam0/data.csv" | tr -d '\r' |
    cut -d, -f2 | tr -d ' ')"
}

echo "== airslam map $dataset --out $out"
"$airslam" map "$dataset" --out "$out"
echo
echo "== airslam eval $truth $out/trajectory.tum"
"$airslam" eval "$truth" "$out/trajectory.tum"
echo
echo "== airslam features: two frames one second apart"
"$airslam" features "$(left_image 41)" "$(left_image 51)" --out "$out/matches.png"
echo
echo "== python -m airslam report $out"
PYTHONPATH=build/python "$python" -m airslam report "$out" --truth "$truth" --dataset "$dataset" --pictures

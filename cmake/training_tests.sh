#!/usr/bin/env bash
# SPDX-License-Identifier: BSD-3-Clause
#
# Runs training/tests with the given Python. Exit code 77, which CTest shows as skipped, where that
# Python lacks what training needs (training/requirements.txt): the product does not install it.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."

readonly python=$1
readonly skipped=77
for package in pytest numpy torch cv2 onnx onnxruntime openvino; do
  if ! "$python" -c "import importlib.util as u; exit(u.find_spec('$package') is None)"; then
    echo "skipped: $python has no $package (training/requirements.txt)"
    exit "$skipped"
  fi
done
code=0
"$python" -m pytest -q -p no:cacheprovider training/tests || code=$?
if [ "$code" -eq 5 ]; then  # pytest's word for "nothing was collected"
  echo "skipped: pytest collected no test"
  exit "$skipped"
fi
exit "$code"

#!/usr/bin/env bash
# SPDX-License-Identifier: BSD-3-Clause
#
# Builds the fuzzers of fuzz/ with clang (installed when missing) and runs each for SECONDS seconds
# (60), then prints a table. The inputs found on the way are kept in build-fuzz/corpus/, what breaks
# a reader in build-fuzz/crashes/: such a file belongs into fuzz/corpus/<target>/ once it is mended.
#   scripts/fuzz.sh [target...]
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."

readonly seconds=${FUZZ_SECONDS:-60}
readonly build=build-fuzz

find_clang() { compgen -c clang++ | grep -Ex 'clang\+\+(-[0-9]+)?' | sort -V | tail -1; }
if [ -z "$(find_clang)" ]; then
  as_root=$([ "$(id -u)" -eq 0 ] || echo sudo)
  $as_root apt-get install -y --no-install-recommends clang llvm >&2
fi
clang=$(find_clang)

cmake -S . -B "$build" -G Ninja -DAIRSLAM_FUZZ=ON -DAIRSLAM_TESTS=OFF -DCMAKE_BUILD_TYPE=None \
  "-DCMAKE_CXX_FLAGS=-O1" -DCMAKE_CXX_COMPILER="$clang" >/dev/null
ninja -C "$build" -j"${JOBS:-$(nproc)}" fuzzers >&2

targets=("$@")
[ ${#targets[@]} -gt 0 ] || targets=($(ls fuzz/corpus))
export ASAN_OPTIONS=detect_leaks=0:allocator_may_return_null=0
status=0
printf '| target | seconds | executions | crashes, hangs, large allocations | peak memory, MB |\n|---|---|---|---|---|\n'
for target in "${targets[@]}"; do
  mkdir -p "$build/corpus/$target" "$build/crashes/$target"
  log=$build/$target.log
  "$build/bin/fuzz_$target" "$build/corpus/$target" "fuzz/corpus/$target" -max_total_time="$seconds" \
    -timeout=10 -malloc_limit_mb=512 -rss_limit_mb=2048 -max_len=65536 -print_final_stats=1 \
    -artifact_prefix="$build/crashes/$target/" >"$log" 2>&1 || status=1
  found=$(find "$build/crashes/$target" -type f | wc -l)
  runs=$(sed -n 's/^stat::number_of_executed_units: *//p' "$log")
  peak=$(sed -n 's/^stat::peak_rss_mb: *//p' "$log")
  printf '| %s | %s | %s | %s | %s |\n' "$target" "$seconds" "${runs:-?}" "$found" "${peak:-?}"
done
exit "$status"

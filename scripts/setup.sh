#!/usr/bin/env bash
# SPDX-License-Identifier: BSD-3-Clause
#
# Everything that a bare Debian 12 lacks to build, test and demonstrate AirSLAM:
#   1. Debian's packages (installed only when missing; asks sudo when not root),
#   2. .venv/            Python tools of evaluation and plots (scripts/requirements.txt),
#   3. third_party/ov/   OpenVINO, unpacked from PyPI's wheel: headers, libraries, CMake package.
# and with the argument "view", for the tests:
#   4. rerun in .venv        (scripts/requirements-view.txt).
# Each step is skipped when its result is there, so that a second run costs a fraction of a second.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."

readonly openvino_version=2026.4.1
readonly packages=(
  build-essential cmake ninja-build ccache pkg-config
  python3 python3-venv python3-dev
  libeigen3-dev libceres-dev libopencv-dev libturbojpeg0-dev libspng-dev
  libsqlite3-dev sqlite3 libssl-dev
  libspdlog-dev libfmt-dev libyaml-cpp-dev libcli11-dev nlohmann-json3-dev
  libgtest-dev libgmock-dev libbenchmark-dev
)

say() { printf 'setup: %s\n' "$*"; }

fail() {
  printf 'setup: %s\n' "$*" >&2
  exit 1
}

# As root, or through sudo.
as_root() {
  if [ "$(id -u)" -eq 0 ]; then
    "$@"
  elif command -v sudo >/dev/null; then
    sudo "$@"
  else
    fail "these packages must be installed by root, and there is no sudo: ${missing[*]}"
  fi
}

install_debian_packages() {
  command -v apt-get >/dev/null ||
    fail "this is not Debian or Ubuntu; install the equivalents of: ${packages[*]}"
  missing=()
  local package
  for package in "${packages[@]}"; do
    if [ "$(dpkg-query -W -f '${db:Status-Status}' "$package" 2>/dev/null)" != installed ]; then
      missing+=("$package")
    fi
  done
  if [ "${#missing[@]}" -eq 0 ]; then return; fi
  say "installing ${missing[*]}"
  as_root env DEBIAN_FRONTEND=noninteractive apt-get update -qq
  as_root env DEBIAN_FRONTEND=noninteractive \
    apt-get install -y -qq --no-install-recommends "${missing[@]}"
}

# Debian's own Python where there is one: a version manager's shim may be of any version.
python() {
  if [ -x /usr/bin/python3 ]; then /usr/bin/python3 "$@"; else python3 "$@"; fi
}

create_virtual_environment() {
  local stamp
  stamp=.venv/.stamp-$(sha256sum scripts/requirements.txt | cut -c1-16)
  if [ -e "$stamp" ]; then return; fi
  say "creating .venv with the Python tools"
  rm -rf .venv
  python -m venv .venv
  .venv/bin/python -m pip install --quiet --disable-pip-version-check -r scripts/requirements.txt
  touch "$stamp"
}

install_viewer() {
  local stamp
  stamp=.venv/.stamp-view-$(sha256sum scripts/requirements-view.txt | cut -c1-16)
  if [ -e "$stamp" ]; then return; fi
  say "installing the viewer"
  .venv/bin/python -m pip install --quiet --disable-pip-version-check -r scripts/requirements-view.txt
  touch "$stamp"
}

# Unpacked beside its place and moved there as a whole, so that an interrupted run leaves no half.
unpack_openvino() {
  if [ -d "third_party/ov/openvino-$openvino_version.dist-info" ]; then return; fi
  say "unpacking OpenVINO $openvino_version"
  rm -rf third_party/ov.partial
  mkdir -p third_party
  .venv/bin/python -m pip install --quiet --disable-pip-version-check --no-deps \
    --target third_party/ov.partial "openvino==$openvino_version"
  rm -rf third_party/ov
  mv third_party/ov.partial third_party/ov
}

install_debian_packages
create_virtual_environment
unpack_openvino
if [ "${1:-}" = view ]; then install_viewer; fi
say "everything is there"

# SPDX-License-Identifier: BSD-3-Clause
#
# Each target does all of its own set-up on a bare Debian 12 and is incremental the second time.
#   make build     the program, build/bin/airslam, and the Python package in build/python
#   make test      build, then every test
#   make demo      build, then map the example sequence, evaluate it and draw it
#   make sanitize  every test under AddressSanitizer and UndefinedBehaviorSanitizer
#   make tsan      the queue, pipeline and shared-map tests under ThreadSanitizer (some minutes)
#   make fuzz      every reader of foreign files under libFuzzer, SECONDS=60 each; installs clang
#   make bench     the micro-benchmarks
#   make docs      the site of docs/: out/site/index.html
#   make format    clang-format over src/
#   make clean     removes what was built; the set-up stays

JOBS ?= $(shell nproc)
SHELL := /bin/bash
.SHELLFLAGS := -euo pipefail -c
.ONESHELL:
.DEFAULT_GOAL := build
.PHONY: setup build test demo sanitize tsan fuzz bench docs format clean

CTEST := ctest --output-on-failure -j$(JOBS)
# Debug for its assertions (Eigen's too), optimised so that the tests still end in minutes.
CHECKED := -DCMAKE_BUILD_TYPE=Debug "-DCMAKE_CXX_FLAGS_DEBUG=-O1 -g1"
# ThreadSanitizer needs a memory layout without much randomness where the kernel allows to ask.
FIXED_LAYOUT := $(shell setarch -R true 2>/dev/null && echo setarch -R)

setup:
	@scripts/setup.sh

build: setup
	@cmake -S . -B build -G Ninja -DCMAKE_BUILD_TYPE=Release >/dev/null
	ninja -C build -j$(JOBS) airslam airslam_python_stub

test: build
	@scripts/setup.sh view
	ninja -C build -j$(JOBS)
	cd build && $(CTEST)

demo: build
	@scripts/demo.sh

sanitize: setup
	@export ASAN_OPTIONS=detect_stack_use_after_return=1
	export UBSAN_OPTIONS=print_stacktrace=1:halt_on_error=1
	export LSAN_OPTIONS=suppressions=$(CURDIR)/scripts/sanitizers/lsan.supp:print_suppressions=0
	cmake -S . -B build-asan -G Ninja $(CHECKED) -DAIRSLAM_SANITIZE=address,undefined >/dev/null
	ninja -C build-asan -j$(JOBS)
	cd build-asan && $(CTEST)

tsan: setup
	@export TSAN_OPTIONS=halt_on_error=1:second_deadlock_stack=1
	cmake -S . -B build-tsan -G Ninja $(CHECKED) -DAIRSLAM_SANITIZE=thread >/dev/null
	$(FIXED_LAYOUT) ninja -C build-tsan -j$(JOBS) airslam_common_test airslam_dataset_test \
	  airslam_odometry_test airslam_relocalize_test
	cd build-tsan && $(FIXED_LAYOUT) $(CTEST) --timeout 1800 -R '[Pp]ipeline|[Qq]ueue|LiveSequence|ManyThreads'

fuzz: setup
	@FUZZ_SECONDS=$(or $(SECONDS),60) JOBS=$(JOBS) scripts/fuzz.sh

bench: setup
	@cmake -S . -B build-bench -G Ninja -DCMAKE_BUILD_TYPE=Release -DAIRSLAM_TESTS=OFF \
	  -DAIRSLAM_BENCHMARKS=ON
	ninja -C build-bench -j$(JOBS)
	for program in build-bench/bin/*_benchmark; do "$$program"; done

docs:
	@scripts/docs/build.sh

format:
	@command -v clang-format >/dev/null || { echo "apt-get install clang-format" >&2; exit 1; }
	find src -name '*.h' -o -name '*.cc' | xargs clang-format -i

clean:
	@rm -rf build build-asan build-tsan build-fuzz build-bench

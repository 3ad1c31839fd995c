# Forwards only: CMake builds, CTest tests, .ci/demo runs the demo.
.PHONY: build test demo bench report sanitize fuzz clean install

build: install
	cmake --preset release
	cmake --build --preset release

install:
	.ci/install

test: build
	ctest --preset release

demo: build
	.ci/demo

bench: build
	.ci/bench

report: build
	.ci/report

sanitize: install
	cmake --preset sanitize
	cmake --build --preset sanitize
	ctest --preset sanitize

fuzz: install
	.ci/fuzz

clean:
	rm -rf build

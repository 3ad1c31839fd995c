# Forwards only: CMake builds, CTest tests, .ci/ has what is more than one command.
.PHONY: build programs test demo bench report sanitize fuzz package nightly clean install

build: install
	cmake --preset release
	cmake --build --preset release

programs:
	.ci/install programs
	cmake --preset release -D FATHOM_BUILD_TESTS=OFF
	cmake --build --preset release --target programs

test: build
	.ci/test

demo: programs
	.ci/demo

package: programs
	cpack --config build/release/CPackConfig.cmake -B build/package

bench: build
	.ci/bench

report: build
	.ci/report

sanitize: install
	cmake --preset sanitize
	cmake --build --preset sanitize
	.ci/test sanitize

fuzz:
	.ci/install nightly
	.ci/fuzz

nightly:
	.ci/install nightly
	.ci/nightly

install:
	.ci/install

clean:
	rm -rf build

"""Installs Fathom's libraries, builds the examples beside it as a project of its own, and holds what they print to what
is known: examples_test.py BUILD_FOLDER."""
import os
import re
import struct
import subprocess
import sys
import tempfile


def run(*command, **options):
    return subprocess.run(command, check=True, stdout=subprocess.PIPE, text=options.pop("text", True), **options).stdout


def numbers(text):
    return [float(word) for word in re.findall(r"-?\d+(?:\.\d+)?", text)]


def expect(condition, text):
    if not condition:
        sys.exit(f"unexpected:\n{text}")


def pd0(number):
    """An ensemble in the ship's frame: 1.5 m/s forward, 0.1 m/s starboard, 0.02 m/s down, over the ground at 2.15 m."""
    fixed = bytearray(59)
    struct.pack_into("<H", fixed, 4, 0x0200)  # 30 degree beams, down-looking
    fixed[25], fixed[58] = 0x17, 30
    variable = bytearray(65)
    struct.pack_into("<HH7B", variable, 0, 0x0080, number, 14, 12, 19, 17, 17, 55, 94)
    struct.pack_into("<H", variable, 14, 1500)
    track = bytearray(81)
    struct.pack_into("<H", track, 0, 0x0600)
    struct.pack_into("<4H4h", track, 16, 200, 210, 220, 230, -100, -1500, 20, 3)  # [cm], [mm/s]
    offsets, at = [], 12
    for block in (fixed, variable, track):
        offsets.append(at)
        at += len(block)
    data = struct.pack("<BBHBB3H", 0x7F, 0x7F, at, 0, 3, *offsets) + fixed + variable + track
    return data + struct.pack("<H", sum(data) & 0xFFFF)


examples = os.path.dirname(os.path.abspath(__file__))
with tempfile.TemporaryDirectory() as folder:
    prefix, build = os.path.join(folder, "prefix"), os.path.join(folder, "build")
    run("cmake", "--install", sys.argv[1], "--component", "development", "--prefix", prefix)
    # Headers that are installed include only what is installed with them, of Fathom.
    include = os.path.join(prefix, "include", "fathom")
    for place, _, files in os.walk(include):
        for name in files:
            with open(os.path.join(place, name)) as header:
                for path in re.findall(r'^#include "(.+)"', header.read(), re.MULTILINE):
                    expect(os.path.exists(os.path.join(include, path)), f"{place}/{name} includes {path}, which is not installed")
    run("cmake", "-S", examples, "-B", build, "-G", "Ninja", f"-DCMAKE_PREFIX_PATH={prefix}")
    run("cmake", "--build", build)

    # Least squares by hand: the measurements disagree by 0.3 m, of which each of the four takes a quarter.
    text = run(f"{build}/solver")
    known = [9, 2.25, 0, 0, 0, 1.025, 0, 0, 2.05, 0, 0, 3.075, 0, 0]
    found = numbers(text.replace("chi2", ""))
    expect(len(found) == len(known) and all(abs(a - b) < 2e-4 for a, b in zip(found, known)), text)

    text = run(f"{build}/stereo")
    vertices, triangles, depth, worst = numbers(text)
    expect(vertices > 400 and triangles > 1.5 * vertices and abs(depth - 2) < 0.002 and worst < 0.02, text)

    text = run(f"{build}/map_codec")
    size, blocks, worst = numbers(text)
    expect(0 < size <= 256 and blocks == 16 and 0 < worst <= 0.05, text)

    damaged = pd0(8)[:-1] + b"\0"
    text = run(f"{build}/decoders", input=b"noise" + pd0(7) + damaged + pd0(9), text=False).decode()
    expect(text == f"7 1.500 0.100 0.020 2.15\n9 1.500 0.100 0.020 2.15\ngood 2 skipped {5 + len(damaged)}\n", text)

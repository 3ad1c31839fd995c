// Writes the sample dive as packets.bin, for the browser test.
#include <fstream>
#include <iostream>

#include "tests/monitor/sample_dive.hpp"

int main(int argc, char** argv) {
  if (argc != 2) {
    std::cerr << "usage: monitor_sample_packets OUT\n";
    return 2;
  }
  std::ofstream stream(argv[1], std::ios::binary);
  bool good = stream.good();
  fathom::monitor::SampleDive().run([&](std::int64_t utc_ns, std::span<const std::uint8_t> frame) {
    good = fathom::telemetry::writePacket(stream, utc_ns, frame) && good;
  });
  return good ? 0 : 1;
}

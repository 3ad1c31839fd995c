// Writes the sample dive as packets.bin: a short one for the browser test, or with `whole` one of 7,500 m2
// and five hours, for measuring the page.
#include <fstream>
#include <iostream>
#include <string_view>

#include "tests/monitor/sample_dive.hpp"

int main(int argc, char** argv) {
  const bool whole = argc == 3 && std::string_view(argv[2]) == "whole";
  if (argc < 2 || (argc > 2 && !whole)) {
    std::cerr << "usage: monitor_sample_packets OUT [whole]\n";
    return 2;
  }
  fathom::monitor::SampleDive dive;
  if (whole) {
    dive.duration_s = 5 * 3600;
    dive.rate_bps = 600;
    dive.line_m = 125;
    dive.spacing_m = 0.84;  // 72 lines, 60 m
  }
  std::ofstream stream(argv[1], std::ios::binary);
  bool good = stream.good();
  dive.run([&](std::int64_t utc_ns, std::span<const std::uint8_t> frame) {
    good = fathom::telemetry::writePacket(stream, utc_ns, frame) && good;
  });
  return good ? 0 : 1;
}

#include <benchmark/benchmark.h>

#include <filesystem>
#include <vector>

#include "firmware_if/devices/can/can_text.hpp"
#include "firmware_if/devices/can/n2k_decoder.hpp"
#include "firmware_if/devices/dvl/pd0_decoder.hpp"
#include "tests/support/text_files.hpp"

namespace {

// A real capture, or an empty vector where it is absent.
std::vector<std::uint8_t> capture(const char* relative) {
  return fathom::test::readBytes(std::filesystem::path(FATHOM_DATA_DIR) / relative);
}

// PD0 of a real AUV dive, fed in pieces of the given size [bytes]: 16 is a serial line, 65536 a file.
void devicePd0Decode(benchmark::State& state) {
  const std::vector<std::uint8_t> bytes = capture("dvl/adcp.adc");
  if (bytes.empty()) return state.SkipWithError("no real captures in FATHOM_DATA_DIR");
  const auto piece = static_cast<std::size_t>(state.range(0));
  std::uint64_t ensembles = 0;
  for (auto _ : state) {
    fathom::io::Pd0Decoder decoder;
    for (std::size_t at = 0; at < bytes.size(); at += piece) {
      decoder.feed(std::span(bytes).subspan(at, std::min(piece, bytes.size() - at)),
                   [&](const fathom::io::Pd0Ensemble& ensemble) { benchmark::DoNotOptimize(&ensemble); });
    }
    ensembles += decoder.counts().good;
  }
  state.SetBytesProcessed(static_cast<std::int64_t>(state.iterations()) *
                          static_cast<std::int64_t>(bytes.size()));
  state.counters["ensembles/s"] =
      benchmark::Counter(static_cast<double>(ensembles), benchmark::Counter::kIsRate);
}
BENCHMARK(devicePd0Decode)->Arg(16)->Arg(65536)->Unit(benchmark::kMillisecond);

// Text of a real NMEA 2000 bus to frames.
void deviceCandumpRead(benchmark::State& state) {
  const std::vector<std::uint8_t> text = capture("can/candumpSample3.txt");
  if (text.empty()) return state.SkipWithError("no real captures in FATHOM_DATA_DIR");
  for (auto _ : state) {
    fathom::io::CanTextReader reader;
    reader.feed(text, [](const fathom::io::CanFrame& frame) { benchmark::DoNotOptimize(&frame); });
  }
  state.SetBytesProcessed(static_cast<std::int64_t>(state.iterations()) *
                          static_cast<std::int64_t>(text.size()));
}
BENCHMARK(deviceCandumpRead)->Unit(benchmark::kMillisecond);

// Its frames to decoded messages; bytes are those of the frames' data.
void deviceN2kDecode(benchmark::State& state) {
  const std::vector<std::uint8_t> text = capture("can/candumpSample3.txt");
  if (text.empty()) return state.SkipWithError("no real captures in FATHOM_DATA_DIR");
  std::vector<fathom::io::CanFrame> frames;
  std::int64_t bytes = 0;
  fathom::io::CanTextReader reader;
  reader.feed(text, [&](const fathom::io::CanFrame& frame) {
    frames.push_back(frame);
    bytes += frame.size;
  });
  fathom::io::N2kDecoder decoder;
  for (auto _ : state) {
    for (const auto& frame : frames) benchmark::DoNotOptimize(decoder.add(frame));
  }
  state.SetBytesProcessed(static_cast<std::int64_t>(state.iterations()) * bytes);
  state.SetItemsProcessed(static_cast<std::int64_t>(state.iterations() * frames.size()));
}
BENCHMARK(deviceN2kDecode)->Unit(benchmark::kMicrosecond);

}  // namespace

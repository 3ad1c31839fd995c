// PD0 from standard input, a line an ensemble with bottom track: number, velocity over the ground [m/s],
// altitude [m].
#include <array>
#include <cstdint>
#include <cstdio>
#include <optional>

#include "firmware_if/devices/dvl/dvl_sample.hpp"
#include "firmware_if/devices/dvl/pd0_decoder.hpp"

int main() {
  using namespace fathom;
  const auto print = [](const io::Pd0Ensemble& ensemble) {
    const std::optional<DvlSample> sample = io::toDvlSample(ensemble);
    if (!sample || !sample->velocity) return;
    std::printf("%u %.3f %.3f %.3f", ensemble.number, sample->velocity->x(), sample->velocity->y(),
                sample->velocity->z());
    std::printf(sample->altitude ? " %.2f\n" : " -\n", sample->altitude.value_or(0));
  };

  io::Pd0Decoder decoder;
  std::array<std::uint8_t, 4096> bytes{};
  while (const std::size_t count = std::fread(bytes.data(), 1, bytes.size(), stdin))
    decoder.feed({bytes.data(), count}, print);
  decoder.drain(print);
  std::printf("good %ju skipped %ju\n", static_cast<std::uintmax_t>(decoder.counts().good),
              static_cast<std::uintmax_t>(decoder.counts().skipped_bytes));
}

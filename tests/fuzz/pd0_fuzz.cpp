// Any bytes, cut in two anywhere, must decode the same as in one piece, and never more than they hold.
#include <cstdlib>

#include "firmware_if/devices/dvl/dvl_sample.hpp"
#include "firmware_if/devices/dvl/pd0_decoder.hpp"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace fathom::io;
  const std::span<const std::uint8_t> bytes(data, size);
  // A small limit, so that short inputs reach the buffer's end too.
  const Pd0Decoder::Config config{.max_ensemble_bytes = 512};
  const auto use = [](const Pd0Ensemble& ensemble) { (void)toDvlSample(ensemble); };

  Pd0Decoder whole(config);
  whole.feed(bytes, use);
  whole.drain(use);

  Pd0Decoder cut(config);
  const std::size_t at = size == 0 ? 0 : data[0] * size / 256;
  cut.feed(bytes.first(at), use);
  cut.feed(bytes.subspan(at), use);
  cut.drain(use);

  const Pd0Decoder::Counts& a = whole.counts();
  const Pd0Decoder::Counts& b = cut.counts();
  if (a.good != b.good || a.bad_checksum != b.bad_checksum || a.skipped_bytes != b.skipped_bytes)
    std::abort();
  if (a.skipped_bytes > size) std::abort();
  return 0;
}

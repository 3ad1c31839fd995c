// Any bytes, cut in two anywhere, must decode as PD4, PD5 and PD6 the same as in one piece.
#include <cstdlib>

#include "firmware_if/devices/dvl/dvl_sample.hpp"
#include "firmware_if/devices/dvl/pd45_decoder.hpp"
#include "firmware_if/devices/dvl/pd6_decoder.hpp"

namespace {

using namespace fathom::io;

void feed(Pd45Decoder& decoder, std::span<const std::uint8_t> bytes) {
  do {
    bytes = bytes.subspan(decoder.accept(bytes));
    while (const Pd45Ensemble* found = decoder.next())
      (void)toDvlSample(toPd0(*found, 1'700'000'000'000'000'000));
  } while (!bytes.empty());
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const std::span<const std::uint8_t> bytes(data, size);
  const std::size_t at = size == 0 ? 0 : data[0] * size / 256;
  Pd45Decoder whole, cut;
  feed(whole, bytes);
  feed(cut, bytes.first(at));
  feed(cut, bytes.subspan(at));
  if (whole.counts().good != cut.counts().good ||
      whole.counts().skipped_bytes != cut.counts().skipped_bytes || whole.counts().skipped_bytes > size)
    std::abort();
  Pd6Decoder text;
  std::size_t ensembles = 0;
  for (const std::uint8_t byte : bytes) {
    if (!text.push(byte)) continue;
    ++ensembles;
    // Only what came can be in it: line ends may have been shorter.
    if (text.rawEnsemble().size() > 2 * size) std::abort();
    const auto& velocity = text.ensemble().sample.velocity;
    if (velocity && !(velocity->array().abs() < 33).all()) std::abort();
  }
  if (ensembles != text.counts().good || text.counts().skipped_bytes > size) std::abort();
  return 0;
}

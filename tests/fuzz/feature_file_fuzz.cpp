#include "firmware_if/mission/feature_file.hpp"

#include <zlib.h>

#include <vector>

#include "tests/fuzz/scratch_file.hpp"

using namespace fathom;

namespace {

void readAndWriteBack(const std::vector<std::uint8_t>& bytes) {
  fuzz::readsOrRefuses([&] {
    StereoFeatureFrame frame;
    io::parseFeatureFile(bytes, "pair.feat", frame);
    if (io::encodeFeatureFile(frame) != bytes) __builtin_trap();
  });
}

}  // namespace

// Any bytes as a feature file, as they are and with a right CRC; what is read is written back to the byte.
extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  std::vector<std::uint8_t> bytes(data, data + size);
  readAndWriteBack(bytes);
  if (size >= 4) {
    const auto crc = static_cast<std::uint32_t>(::crc32(0, data, static_cast<uInt>(size - 4)));
    for (std::size_t k = 0; k < 4; ++k) bytes[size - 4 + k] = static_cast<std::uint8_t>(crc >> (8 * k));
    readAndWriteBack(bytes);
  }
  return 0;
}

#include "firmware_if/mission/log/raw_auv.hpp"
#include "tests/fuzz/scratch_file.hpp"

using namespace fathom;

// Any bytes as a RAW.auv; what is read is written again.
extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  static const fuzz::ScratchFile file("fuzz.RAW.auv");
  static const fuzz::ScratchFile copy("copy");
  file.write(data, size);
  fuzz::readsOrRefuses([] {
    const Geodetic origin{-0.5, 2.0};
    io::RawAuvReader reader(file.path(), origin);
    io::RawAuvWriter writer(copy.path(), origin, 0.1);
    while (const auto sample = reader.next()) writer.write(*sample);
  });
  return 0;
}

// Key files: 64 hexadecimal digits or a refusal that shows nothing of the file.
#include "telemetry/wire/link_key.hpp"
#include "tests/fuzz/scratch_file.hpp"

using namespace fathom;

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  static const fuzz::ScratchFile file("ship.key");
  file.write(data, size);
  fuzz::readsOrRefuses([] {
    std::string warning;
    (void)telemetry::readLinkKey(file.path(), warning);
  });
  return 0;
}

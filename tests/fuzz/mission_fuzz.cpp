#include "firmware_if/mission/mission.hpp"

#include "tests/fuzz/scratch_file.hpp"

using namespace fathom;

// Any bytes as mission.toml; one that is read must be written and read again.
extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  static const fuzz::ScratchFile file("mission.toml");
  file.write(data, size);
  fuzz::readsOrRefuses([] {
    const io::MissionConfig config = io::readMissionConfig(file.folder());
    try {
      io::writeMissionConfig(file.folder(), config);
      static_cast<void>(io::readMissionConfig(file.folder()));
    } catch (const InputError&) {
      __builtin_trap();
    }
  });
  return 0;
}

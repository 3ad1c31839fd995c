#include "firmware_if/mission/pose_files.hpp"
#include "recon/geometry/stereo_rig.hpp"
#include "tests/fuzz/scratch_file.hpp"

using namespace fathom;

// Any bytes as each of the mission's text files of poses or their covariances, and as stereo.calib; what is
// read is written and read again.
extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  static const fuzz::ScratchFile file("poses");
  static const std::filesystem::path copy = file.folder() / "copy";
  file.write(data, size);
  fuzz::readsOrRefuses([] {
    io::writeStereoPoses(copy, io::readStereoPoses(file.path()));
    static_cast<void>(io::readStereoPoses(copy));
  });
  fuzz::readsOrRefuses([] {
    io::writeVehiclePoses(copy, io::readVehiclePoses(file.path()));
    static_cast<void>(io::readVehiclePoses(copy));
  });
  fuzz::readsOrRefuses([] {
    io::writeTrajectory(copy, io::readTrajectory(file.path()));
    static_cast<void>(io::readTrajectory(copy));
  });
  fuzz::readsOrRefuses([] {
    io::writePoseCovariances(copy, io::readPoseCovariances(file.path()));
    static_cast<void>(io::readPoseCovariances(copy));
  });
  fuzz::readsOrRefuses([] {
    writeStereoCalib(copy, readStereoCalib(file.path()));
    static_cast<void>(readStereoCalib(copy));
  });
  return 0;
}

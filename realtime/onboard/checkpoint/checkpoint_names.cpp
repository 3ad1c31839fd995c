#include "realtime/onboard/checkpoint/checkpoint_names.hpp"

#include <fstream>
#include <iterator>
#include <string>

#include "realtime/onboard/checkpoint/checkpoint_file.hpp"
#include "recon/geometry/colour.hpp"

namespace fathom::onboard {
namespace {

std::string textOf(const std::filesystem::path& path) {
  std::ifstream in(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(in), {}};
}

}  // namespace

CheckpointNames checkpointNames(const std::filesystem::path& folder, const OnboardConfig& config,
                                const io::MissionConfig& mission) {
  const io::MissionPaths paths(folder);
  CheckpointNames names;
  names.configuration = checkpointHash(config.text);
  for (const std::filesystem::path& file :
       {paths.root / "mission.toml", paths.calib(), coloursBeside(paths.calib())})
    names.configuration = checkpointHash(textOf(file), names.configuration);
  names.mission =
      checkpointHash(mission.vehicle_name + " " + std::to_string(mission.vehicle_id) + " " +
                     std::to_string(mission.dive_id) + " " + std::to_string(mission.start_utc_ns));
  return names;
}

}  // namespace fathom::onboard

#pragma once

#include <Eigen/Core>
#include <filesystem>

namespace fathom::onboard::testing {

// RMS distance in plan of a replay's stereo poses from the true ones [m].
struct TrackError {
  double absolute = 0;
  double shape = 0;                                 // after taking out the mean shift
  Eigen::Vector2d shift = Eigen::Vector2d::Zero();  // that is it, north and east
};

// `output`: the folder that the replay wrote. The mission has truth/.
[[nodiscard]] TrackError trackError(const std::filesystem::path& mission,
                                    const std::filesystem::path& output);

}  // namespace fathom::onboard::testing

#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "firmware_if/mission/log/onboard_input.hpp"

namespace fathom::test {

// The first pairs of a recorded mission, flown forward, then back over the same track with the same images in
// reverse order, then forward again, without end: a mission of any length whose sensors, images and fixes
// agree with one another. On the return track times run on, the DVL's velocity is the opposite, and
// everything else is what it was at the same place.
class Shuttle {
 public:
  // Inputs without samples give a shuttle without steps, which must not be asked for one.
  Shuttle(const std::vector<io::OnboardInput>& inputs, std::size_t pairs);

  struct Step {
    std::int64_t arrival_ns = 0;  // since the shuttle began
    SensorSample sample;          // with times since the shuttle began; images by their recorded names
  };
  // Step `number` of the endless mission; arrival times never fall.
  [[nodiscard]] Step at(std::uint64_t number) const;
  [[nodiscard]] std::size_t stepsOfLeg() const { return legs_[0].size(); }
  // The recorded images of one side, in recorded order.
  [[nodiscard]] const std::vector<std::string>& images(CameraSide side) const {
    return images_[static_cast<std::size_t>(side)];
  }

 private:
  std::vector<Step> legs_[2];  // forward and back, times since the leg began
  std::int64_t leg_ns_ = 0;
  std::vector<std::string> images_[2];
};

}  // namespace fathom::test

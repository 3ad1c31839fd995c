#pragma once

#include <chrono>
#include <optional>
#include <string>

#include "firmware_if/mission/images/image_file.hpp"
#include "realtime/onboard/onboard_system.hpp"

namespace fathom::onboard {

// Images or features of a recorded mission; holds one pair.
class RecordedPairs {
 public:
  RecordedPairs(const io::MissionPaths& paths, const io::MissionConfig& mission, const StereoRig& rig)
      : paths_(paths), images_(paths, mission, rig) {}

  // Of images, or of features where the mission has these instead.
  [[nodiscard]] OnboardSystem::PairSource source();

  [[nodiscard]] double seconds() const { return seconds_; }  // spent reading
  // Why the first unreadable image was refused; "" if all were read.
  [[nodiscard]] const std::string& firstRefusal() const { return first_refusal_; }

 private:
  using Clock = std::chrono::steady_clock;
  std::optional<ImageView> read(const std::string& name, CameraSide side);
  const StereoFeatureFrame* readFeatures(const std::string& left_image);
  void refuse(const std::string& why);

  static constexpr int kMaxWarnings = 5;  // the rest is in the counters
  io::MissionPaths paths_;
  StereoFeatureFrame features_;
  io::MissionImages images_;
  io::ImageFile left_, right_;
  int unreadable_ = 0;
  std::string first_refusal_;
  double seconds_ = 0;
};

}  // namespace fathom::onboard

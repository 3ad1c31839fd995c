#pragma once

#include <vector>

#include "firmware_if/mission/mission.hpp"
#include "recon/topside/input/survey_stage.hpp"
#include "recon/topside/localise/feature_store.hpp"

namespace fathom::topside {

// The pairs that have a pose, by time, and where to find what they are recognised by.
struct Frames {
  const FeatureStore* features = nullptr;  // by pair, not by frame
  std::vector<std::uint32_t> pair;         // index of the mission's pair
  std::vector<SE3> reckoned;               // T_nav_cam
  std::vector<double> range;               // to the seafloor along the camera's axis [m]
  std::vector<double> travelled;           // track length up to it [m]

  [[nodiscard]] bool blank(std::size_t frame) const { return features->count(pair[frame]) == 0; }
  void load(std::size_t frame, closure::FrameFeatures& out) const { features->load(pair[frame], out); }
};

// `features` must outlive it.
[[nodiscard]] Frames framesOf(const io::MissionConfig& mission, const Survey& survey,
                              const FeatureStore& features);

}  // namespace fathom::topside

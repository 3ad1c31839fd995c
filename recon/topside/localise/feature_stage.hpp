#pragma once

#include <cstddef>
#include <vector>

#include "firmware_if/mission/mission.hpp"
#include "recon/closure/frame_features.hpp"
#include "recon/geometry/stereo_rig.hpp"
#include "recon/topside/input/survey_stage.hpp"

namespace fathom::topside {

// What the pairs of a mission are recognised by, kept where the caller wants. load() may be called by several
// threads at once.
class FeatureStore {
 public:
  virtual ~FeatureStore() = default;
  [[nodiscard]] virtual std::size_t count(std::size_t pair) const = 0;  // 0: cannot be read, or shows nothing
  // Replaces `out`; its memory is used again. Throws InputError for a file that cannot be read any more.
  virtual void load(std::size_t pair, closure::FrameFeatures& out) const = 0;
};

// As `to` would have triangulated what `from` did.
void retriangulate(const StereoRig& from, const StereoRig& to, closure::FrameFeatures& features);
class RetriangulatedFeatures : public FeatureStore {
 public:
  // All must outlive it.
  RetriangulatedFeatures(const FeatureStore& of, const StereoRig& from, const StereoRig& to)
      : of_(of), from_(from), to_(to) {}
  [[nodiscard]] std::size_t count(std::size_t pair) const override { return of_.count(pair); }
  void load(std::size_t pair, closure::FrameFeatures& out) const override {
    of_.load(pair, out);
    retriangulate(from_, to_, out);
  }

 private:
  const FeatureStore& of_;
  const StereoRig &from_, &to_;
};

// The pairs that have a pose, by time, and where to find what they are recognised by.
struct Frames {
  const FeatureStore* features = nullptr;  // by pair, not by frame
  std::vector<std::uint32_t> pair;         // index of the mission's pair
  std::vector<SE3> reckoned;               // T_nav_cam
  std::vector<double> range;               // to the seafloor along the camera's axis [m]
  std::vector<double> travelled;           // track length up to it [m]
  // Whether stereo sees the seafloor far beyond the DVL's altitude, whose velocity is then that of something
  // in the water.
  std::vector<bool> false_bottom;

  [[nodiscard]] bool blank(std::size_t frame) const { return features->count(pair[frame]) == 0; }
  void load(std::size_t frame, closure::FrameFeatures& out) const { features->load(pair[frame], out); }
};

// `features` must outlive it.
[[nodiscard]] Frames framesOf(const io::MissionConfig& mission, const Survey& survey,
                              const FeatureStore& features);

}  // namespace fathom::topside

#include "realtime/onboard/recorded_pairs.hpp"

#include <cstdio>

#include "firmware_if/mission/feature_file.hpp"
#include "realtime/base/input_error.hpp"
#include "realtime/base/units.hpp"

namespace fathom::onboard {

using rt::secondsSince;

OnboardSystem::PairSource RecordedPairs::source() {
  if (io::isFeatureMission(paths_))
    return {{}, [this](const std::string& left_image) { return readFeatures(left_image); }};
  return {[this](const std::string& name, CameraSide side) { return read(name, side); }, {}};
}

std::optional<ImageView> RecordedPairs::read(const std::string& name, CameraSide side) {
  io::ImageFile& slot = side == CameraSide::kLeft ? left_ : right_;
  const auto start = Clock::now();
  try {
    slot = images_.read(name, side);
  } catch (const InputError& e) {
    refuse(e.what());
    seconds_ += secondsSince(start);
    return std::nullopt;
  }
  seconds_ += secondsSince(start);
  return slot.view;
}

const StereoFeatureFrame* RecordedPairs::readFeatures(const std::string& left_image) {
  const auto start = Clock::now();
  const StereoFeatureFrame* read = &features_;
  try {
    io::readFeatureFile(paths_.features() / io::featureFileName(left_image), features_);
  } catch (const InputError& e) {
    refuse(e.what());
    read = nullptr;
  }
  seconds_ += secondsSince(start);
  return read;
}

void RecordedPairs::refuse(const std::string& why) {
  if (unreadable_ == 0) first_refusal_ = why;
  if (unreadable_++ < kMaxWarnings)
    std::fprintf(stderr, "fathom-onboard: %s; the pair is dropped\n", why.c_str());
}

}  // namespace fathom::onboard

#pragma once

#include <gmock/gmock.h>

#include "tests/firmware_if/recorder/synthetic_dive.hpp"
#include "tests/support/test_data.hpp"

namespace fathom::test {

// A synthetic dive in a fresh folder, and recorders of it that take no room beforehand and keep none free.
class RecordedDive : public ::testing::Test {
 protected:
  explicit RecordedDive(int width = 64, int height = 48) : dive_config_{width, height, 50} {}

  static io::RecorderConfig bareConfig(double planned_hours = 0) {
    io::RecorderConfig config{.planned_hours = planned_hours};
    config.image_reserve_mib = config.log_reserve_mib = 0;
    return config;
  }
  std::unique_ptr<io::Recorder> recorder(const io::RecorderConfig& config = bareConfig()) {
    return std::make_unique<io::Recorder>(folder_, dive_.mission(), dive_.rig(), config, player_.viewOf(),
                                          player_.release());
  }
  // Offers the next inputs, letting the recorder work every now and then.
  void play(io::Recorder& recorder, std::uint64_t inputs) {
    for (const std::uint64_t end = next_ + inputs; next_ < end; ++next_) {
      EXPECT_TRUE(player_.offer(recorder, next_));
      if (next_ % 10 == 9) recorder.work(20);
    }
  }
  // Nothing is wrong with what is in the folder, which holds so many inputs.
  SyntheticDive::Found expectInputs(std::uint64_t inputs) const {
    SyntheticDive::Found found = dive_.check(folder_);
    EXPECT_THAT(found.wrong, ::testing::IsEmpty());
    EXPECT_EQ(found.inputs, inputs);
    return found;
  }

  TemporaryFolder parent_;
  std::filesystem::path folder_ = parent_.path() / "dive";
  SyntheticDive::Config dive_config_;
  SyntheticDive dive_{dive_config_};
  DivePlayer player_{dive_, dive_config_, 16};
  std::uint64_t next_ = 0;  // input
};

}  // namespace fathom::test

#pragma once

#include "firmware_if/mission/log/onboard_input.hpp"
#include "firmware_if/mission/mission.hpp"
#include "realtime/onboard/live/live_system.hpp"

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

// What devices give, each step when its time has come by the vehicle's clock.
class Playback {
 public:
  struct Step {
    std::int64_t due_ns = 0;
    std::optional<SensorSample> sample;  // in the vehicle's time; none: for nobody
  };
  virtual ~Playback() = default;
  // Nothing after the end.
  [[nodiscard]] virtual std::optional<Step> at(std::size_t number) const = 0;
  std::size_t first = 0;  // step that is played
};

// A recorded mission.
struct PlayedMission final : Playback {
  std::vector<io::OnboardInput> inputs;
  std::int64_t shift_ns = 0;  // added to the mission's times gives the vehicle's

  // So that the first input comes `lead_s` from now.
  PlayedMission(const std::filesystem::path& mission, const rt::VehicleClock& clock, double lead_s);
  // With that shift; what was due by now has been missed.
  PlayedMission(const std::filesystem::path& mission, const rt::VehicleClock& clock,
                std::int64_t with_shift_ns);
  [[nodiscard]] std::optional<Step> at(std::size_t number) const override;
  [[nodiscard]] double lengthSeconds() const;
  [[nodiscard]] std::int64_t dueNs(std::size_t input) const {
    return inputs[input].arrival_utc_ns + shift_ns;
  }
};

// A shuttle that begins at a time of the vehicle.
class PlayedShuttle final : public Playback {
 public:
  PlayedShuttle(const Shuttle& shuttle, std::int64_t begin_utc_ns)
      : shuttle_(shuttle), begin_ns_(begin_utc_ns) {}
  [[nodiscard]] std::optional<Step> at(std::size_t number) const override;

 private:
  const Shuttle& shuttle_;
  std::int64_t begin_ns_;
};

// Of a dive in `folder` with the mission and calibration of that one, in soft mode and with pools for some
// minutes, by a configuration in a file beside the folder, `more` behind it (a busy machine must not pass for
// a mapper that hangs: `stuck_after_s`); `clear_folder`: what was in the folder is removed. As on a vehicle,
// the two are there before the dive. The mapper is fathom-onboard.
[[nodiscard]] onboard::LiveSetup liveSetup(const std::filesystem::path& mission,
                                           const std::filesystem::path& folder, bool clear_folder,
                                           const std::string& more = "", double stuck_after_s = 30);
// The program beside this one.
[[nodiscard]] std::filesystem::path onboardProgram();

struct PlayedOptions {
  std::size_t pool_frames = 12;
  std::uint64_t lost_left = UINT64_MAX;              // this exposure of the left camera never comes
  std::uint64_t exposures = UINT64_MAX;              // of each camera, then no more
  std::atomic<std::uint64_t>* given_left = nullptr;  // counts exposures
  // Every image is decoded once into a file without a name in this folder, so that giving one out takes no
  // heap; empty: each when it is due.
  std::filesystem::path scratch;
};

// Two cameras and one source of everything else, with the images of the mission in `folder`. All that is
// referred to must outlive them.
[[nodiscard]] onboard::LiveDevices playedDevices(const Playback& played, const std::filesystem::path& folder,
                                                 const io::MissionConfig& mission, const StereoRig& rig,
                                                 const rt::VehicleClock& clock,
                                                 const PlayedOptions& options = {});

}  // namespace fathom::test

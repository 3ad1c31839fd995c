#include "tests/onboard/live/played_devices.hpp"

#include <algorithm>
#include <cstring>
#include <ctime>
#include <utility>

#include "firmware_if/files/images/image_file.hpp"

namespace fathom::test {
namespace {

// Sleeps until the vehicle's clock says so, at most `timeout_ms`; whether it is time.
bool waitFor(const rt::VehicleClock& clock, std::int64_t utc_ns, int timeout_ms) {
  constexpr long kStep_ns = 1'000'000;
  for (long slept = 0; clock.utcNs() < utc_ns; slept += kStep_ns) {
    if (slept >= timeout_ms * 1'000'000L) return false;
    const timespec pause = {0, kStep_ns};
    ::clock_nanosleep(CLOCK_MONOTONIC, 0, &pause, nullptr);
  }
  return true;
}

class PlayedSamples final : public io::SampleSource {
 public:
  PlayedSamples(const PlayedMission& played, const rt::VehicleClock& clock)
      : played_(played), clock_(clock), next_(played.first) {}

  bool poll(int timeout_ms, io::SampleSink& sink) noexcept override {
    for (; next_ < played_.inputs.size(); ++next_) {
      const auto* sample = std::get_if<SensorSample>(&played_.inputs[next_].what);
      if (sample == nullptr || std::holds_alternative<ImageEvent>(*sample)) continue;
      if (!waitFor(clock_, played_.dueNs(next_), timeout_ms)) return true;
      SensorSample now = *sample;
      std::visit([this](auto& s) { s.utc_ns += played_.shift_ns; }, now);
      sink.sample(clock_.utcNs(), now);
      ++given_;
      ++next_;
      return true;
    }
    (void)waitFor(clock_, INT64_MAX, timeout_ms);
    return true;
  }
  void updateHealth(io::DeviceHealth& health) const noexcept override { health.samples = given_; }
  [[nodiscard]] io::DeviceHealth health() const override {
    return {"played sensors", true, 0, given_, 0, {}};
  }

 private:
  const PlayedMission& played_;
  const rt::VehicleClock& clock_;
  std::size_t next_ = 0;
  std::uint64_t given_ = 0;
};

class PlayedCamera final : public io::CameraSource {
 public:
  PlayedCamera(const PlayedMission& played, std::filesystem::path images, CameraSide side, PixelFormat format,
               int bits, const Camera& camera, const rt::VehicleClock& clock, const PlayedOptions& options)
      : played_(played),
        images_(std::move(images)),
        side_(side),
        format_(format),
        bits_(bits),
        width_(camera.width),
        height_(camera.height),
        clock_(clock),
        options_(options),
        pool_(options.pool_frames,
              static_cast<std::size_t>(width_) * static_cast<std::size_t>(height_) * sampleBytes()),
        next_(played.first) {}

  bool poll(int timeout_ms, io::FrameSink& sink) noexcept override {
    for (; next_ < played_.inputs.size(); ++next_) {
      const ImageEvent* event = io::imageOf(played_.inputs[next_]);
      if (event == nullptr || event->side != side_) continue;
      if (!waitFor(clock_, played_.dueNs(next_), timeout_ms)) return true;
      give(*event, sink);
    }
    (void)waitFor(clock_, INT64_MAX, timeout_ms);
    return true;
  }
  [[nodiscard]] rt::SharedBlocks& pool() noexcept override { return pool_; }
  [[nodiscard]] ImageView view(const io::CameraFrame& frame) noexcept override {
    return {pool_.bytes(frame.block).data(),
            width_,
            height_,
            static_cast<std::size_t>(width_) * sampleBytes(),
            format_,
            bits_};
  }
  void updateHealth(io::DeviceHealth& health) const noexcept override {
    health.samples = frames_;
    health.counters[0].second = pool_full_;
  }
  [[nodiscard]] io::DeviceHealth health() const override {
    return {side_ == CameraSide::kLeft ? "left camera" : "right camera",
            true,
            0,
            frames_,
            0,
            {{"pool_full", pool_full_}}};
  }

 private:
  [[nodiscard]] std::size_t sampleBytes() const { return bits_ == 8 ? 1 : 2; }

  void give(const ImageEvent& event, io::FrameSink& sink) {
    const std::uint64_t number = exposures_++;
    if (side_ == CameraSide::kLeft && number == options_.lost_left) return;
    const io::ImageFile file =
        io::readImage(images_ / event.file_name.view(), format_, bits_, width_, height_);
    io::CameraFrame frame;
    frame.block = pool_.acquire();
    if (frame.block == rt::SharedBlocks::kNone) {
      ++pool_full_;
      return;
    }
    const std::size_t row = static_cast<std::size_t>(width_) * sampleBytes();
    for (int y = 0; y < height_; ++y)
      std::memcpy(
          pool_.bytes(frame.block).data() + static_cast<std::size_t>(y) * row,
          static_cast<const std::byte*>(file.view.data) + static_cast<std::size_t>(y) * file.view.stride,
          row);
    frame.side = side_;
    frame.frame_id = number;
    frame.utc_ns = event.utc_ns + played_.shift_ns;
    frame.arrival_utc_ns = clock_.utcNs();
    frame.exposure_s = event.exposure_s;
    ++frames_;
    sink.frame(frame);
  }

  const PlayedMission& played_;
  std::filesystem::path images_;
  CameraSide side_;
  PixelFormat format_;
  int bits_, width_, height_;
  const rt::VehicleClock& clock_;
  PlayedOptions options_;
  rt::SharedBlocks pool_;
  std::size_t next_ = 0;
  std::uint64_t frames_ = 0, exposures_ = 0, pool_full_ = 0;
};

}  // namespace

PlayedMission::PlayedMission(const std::filesystem::path& mission, const rt::VehicleClock& clock,
                             double lead_s) {
  std::uint64_t damaged = 0;
  inputs = io::readOnboardInputs(mission, damaged);
  shift_ns = clock.utcNs() + static_cast<std::int64_t>(lead_s * 1e9) - inputs.front().arrival_utc_ns;
}

PlayedMission::PlayedMission(const std::filesystem::path& mission, const rt::VehicleClock& clock,
                             std::int64_t with_shift_ns)
    : shift_ns(with_shift_ns) {
  std::uint64_t damaged = 0;
  inputs = io::readOnboardInputs(mission, damaged);
  const std::int64_t now = clock.utcNs();
  while (first < inputs.size() && dueNs(first) < now) ++first;
}

double PlayedMission::lengthSeconds() const {
  return static_cast<double>(inputs.back().arrival_utc_ns - inputs.front().arrival_utc_ns) * 1e-9;
}

onboard::LiveSetup liveSetup(const std::filesystem::path& mission_folder, const std::filesystem::path& folder,
                             bool anew) {
  if (anew) {
    std::filesystem::remove_all(folder);
    std::filesystem::create_directories(folder);
    for (const char* name : {"mission.toml", "stereo.calib"})
      std::filesystem::copy_file(mission_folder / name, folder / name);
  }
  const io::MissionConfig mission = io::readMissionConfig(folder);
  onboard::OnboardConfig config = onboard::readOnboardConfig(std::nullopt, mission);
  config.max_pairs = config.localisation.max_keyframes = 400;
  config.live.realtime.soft = true;
  config.live.recorder.planned_hours = 0.01;
  config.live.recorder.image_reserve_mib = 1;
  config.live.memory.heap_bytes = std::size_t{16} << 20;
  config.live.memory.budget_bytes = std::size_t{2048} << 20;
  return {folder, config, mission, readStereoCalib(io::MissionPaths(folder).calib())};
}

onboard::LiveDevices playedDevices(const PlayedMission& played, const std::filesystem::path& folder,
                                   const io::MissionConfig& mission, const StereoRig& rig,
                                   const rt::VehicleClock& clock, const PlayedOptions& options) {
  const std::filesystem::path images = io::MissionPaths(folder).images();
  onboard::LiveDevices devices;
  devices.samples.push_back(std::make_unique<PlayedSamples>(played, clock));
  devices.left =
      std::make_unique<PlayedCamera>(played, images, CameraSide::kLeft, mission.cameras.left_format,
                                     mission.cameras.bits, rig.left, clock, options);
  devices.right =
      std::make_unique<PlayedCamera>(played, images, CameraSide::kRight, mission.cameras.right_format,
                                     mission.cameras.bits, rig.right, clock, options);
  return devices;
}

}  // namespace fathom::test

#include <fcntl.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <fstream>
#include <functional>
#include <map>
#include <system_error>
#include <type_traits>
#include <utility>
#include <variant>

#include "firmware_if/mission/images/image_file.hpp"
#include "tests/onboard/live/played_devices.hpp"

namespace fathom::test {

namespace {

// Sleeps until the vehicle's clock says so, at most `timeout_ms`; whether it is time.
bool waitFor(const rt::VehicleClock& clock, std::int64_t utc_ns, int timeout_ms) {
  // Waking up costs more than anything else here.
  constexpr long kStep_ns = 1'000'000, kFarStep_ns = 5'000'000;
  constexpr std::int64_t kFar_ns = 50'000'000;
  long slept = 0;
  for (std::int64_t now = clock.utcNs(); now < utc_ns; now = clock.utcNs()) {
    if (slept >= timeout_ms * 1'000'000L) return false;
    const long step = utc_ns - now > kFar_ns ? kFarStep_ns : kStep_ns;
    const timespec pause = {0, step};
    ::clock_nanosleep(CLOCK_MONOTONIC, 0, &pause, nullptr);
    slept += step;
  }
  return true;
}

class PlayedSamples final : public io::SampleSource {
 public:
  PlayedSamples(const Playback& played, const rt::VehicleClock& clock)
      : played_(played), clock_(clock), next_(played.first) {}

  bool poll(int timeout_ms, io::SampleSink& sink) noexcept override {
    for (; const auto step = played_.at(next_); ++next_) {
      if (!step->sample || std::holds_alternative<ImageEvent>(*step->sample)) continue;
      if (!waitFor(clock_, step->due_ns, timeout_ms)) return true;
      sink.sample(clock_.utcNs(), *step->sample);
      ++given_;
      ++next_;
      return true;
    }
    (void)waitFor(clock_, INT64_MAX, timeout_ms);
    return true;
  }
  [[nodiscard]] io::DeviceHealth health() const override {
    io::DeviceHealth health;
    health.name = "played sensors";
    health.open = true;
    health.samples = given_;
    return health;
  }

 private:
  const Playback& played_;
  const rt::VehicleClock& clock_;
  std::size_t next_ = 0;
  std::uint64_t given_ = 0;
};

class PlayedCamera final : public io::CameraSource {
 public:
  PlayedCamera(const Playback& played, std::filesystem::path images, CameraSide side,
               const io::MissionConfig& mission, const Camera& camera, const rt::VehicleClock& clock,
               const PlayedOptions& options)
      : played_(played),
        images_(std::move(images)),
        side_(side),
        format_(side == CameraSide::kLeft ? mission.cameras.left_format : mission.cameras.right_format),
        bits_(mission.cameras.bits),
        width_(camera.width),
        height_(camera.height),
        clock_(clock),
        options_(options),
        pool_(options.pool_frames, frameBytes()),
        next_(played.first) {
    if (!options.scratch.empty()) decodeAll();
  }
  ~PlayedCamera() override {
    if (scratch_ >= 0) ::close(scratch_);
  }
  PlayedCamera(const PlayedCamera&) = delete;
  PlayedCamera& operator=(const PlayedCamera&) = delete;

  bool poll(int timeout_ms, io::FrameSink& sink) noexcept override {
    while (exposures_ < options_.exposures) {
      const auto step = played_.at(next_);
      if (!step) break;
      const auto* event = step->sample ? std::get_if<ImageEvent>(&*step->sample) : nullptr;
      if (event != nullptr && event->side == side_) {
        if (!waitFor(clock_, step->due_ns, timeout_ms)) return true;
        give(*event, sink);
        ++next_;
        return true;
      }
      ++next_;
    }
    (void)waitFor(clock_, INT64_MAX, timeout_ms);
    return true;
  }
  [[nodiscard]] rt::SharedBlocks& pool() noexcept override { return pool_; }
  [[nodiscard]] ImageView view(const io::CameraFrame& frame) noexcept override {
    return {pool_.bytes(frame.block).data(), width_, height_, rowBytes(), format_, bits_};
  }
  [[nodiscard]] io::DeviceHealth health() const override {
    io::DeviceHealth health;
    health.name = side_ == CameraSide::kLeft ? "left camera" : "right camera";
    health.open = true;
    health.samples = frames_;
    health.counters = {{"pool_full", missed_}};
    return health;
  }

 private:
  [[nodiscard]] std::size_t rowBytes() const {
    return static_cast<std::size_t>(width_) * (bits_ == 8 ? 1 : 2);
  }
  [[nodiscard]] std::size_t frameBytes() const { return rowBytes() * static_cast<std::size_t>(height_); }

  void decode(std::string_view name, std::byte* pixels) const {
    const io::ImageFile file = io::readImage(images_ / name, format_, bits_, width_, height_);
    for (std::size_t y = 0; y < static_cast<std::size_t>(height_); ++y)
      std::memcpy(pixels + y * rowBytes(),
                  static_cast<const std::byte*>(file.view.data) + y * file.view.stride, rowBytes());
  }

  void decodeAll() {
    const auto require = [&](bool good) {
      if (!good)
        throw std::system_error(errno, std::generic_category(),
                                "scratch file in " + options_.scratch.string());
    };
    scratch_ = ::open(options_.scratch.c_str(), O_TMPFILE | O_RDWR | O_CLOEXEC, 0600);
    require(scratch_ >= 0);
    std::vector<std::byte> pixels(frameBytes());
    for (std::size_t n = played_.first; const auto step = played_.at(n); ++n) {
      const auto* event = step->sample ? std::get_if<ImageEvent>(&*step->sample) : nullptr;
      if (event == nullptr || event->side != side_) continue;
      if (!place_.emplace(event->file_name.view(), place_.size()).second) break;  // it comes round again
      decode(event->file_name.view(), pixels.data());
      require(::write(scratch_, pixels.data(), frameBytes()) == static_cast<ssize_t>(frameBytes()));
    }
  }

  [[nodiscard]] bool fill(std::string_view name, std::byte* pixels) {
    if (scratch_ < 0) {
      decode(name, pixels);
      return true;
    }
    const auto place = place_.find(name);
    return place != place_.end() &&
           ::pread(scratch_, pixels, frameBytes(), static_cast<off_t>(place->second * frameBytes())) ==
               static_cast<ssize_t>(frameBytes());
  }

  void give(const ImageEvent& event, io::FrameSink& sink) {
    const std::uint64_t number = exposures_++;
    if (options_.given_left != nullptr && side_ == CameraSide::kLeft)
      options_.given_left->store(exposures_, std::memory_order_relaxed);
    if (side_ == CameraSide::kLeft && number == options_.lost_left) return;
    io::CameraFrame frame{.block = pool_.acquire()};
    if (frame.block == rt::SharedBlocks::kNone) {
      ++missed_;
      return;
    }
    if (!fill(event.file_name.view(), pool_.bytes(frame.block).data())) {
      pool_.release(frame.block);
      ++missed_;
      return;
    }
    frame.side = side_;
    frame.frame_id = number;
    frame.utc_ns = event.utc_ns;
    frame.arrival_utc_ns = clock_.utcNs();
    frame.exposure_s = event.exposure_s;
    ++frames_;
    sink.frame(frame);
  }

  const Playback& played_;
  std::filesystem::path images_;
  CameraSide side_;
  PixelFormat format_;
  int bits_, width_, height_;
  const rt::VehicleClock& clock_;
  PlayedOptions options_;
  rt::SharedBlocks pool_;
  std::size_t next_ = 0;
  std::uint64_t frames_ = 0, exposures_ = 0, missed_ = 0;
  int scratch_ = -1;
  std::map<std::string, std::size_t, std::less<>> place_;  // of an image in the scratch file
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

std::optional<Playback::Step> PlayedMission::at(std::size_t number) const {
  if (number >= inputs.size()) return std::nullopt;
  Step step{dueNs(number), std::nullopt};
  if (const auto* sample = std::get_if<SensorSample>(&inputs[number].what)) {
    step.sample = *sample;
    std::visit([&](auto& s) { s.utc_ns += shift_ns; }, *step.sample);
  }
  return step;
}

std::optional<Playback::Step> PlayedShuttle::at(std::size_t number) const {
  Shuttle::Step step = shuttle_.at(number);
  std::visit(
      [&](auto& s) {
        s.utc_ns += begin_ns_;
        if constexpr (std::is_same_v<std::decay_t<decltype(s)>, UsblFix>) s.arrival_utc_ns += begin_ns_;
      },
      step.sample);
  return Step{begin_ns_ + step.arrival_ns, std::move(step.sample)};
}

double PlayedMission::lengthSeconds() const {
  return static_cast<double>(inputs.back().arrival_utc_ns - inputs.front().arrival_utc_ns) * 1e-9;
}

std::filesystem::path onboardProgram() {
  return std::filesystem::read_symlink("/proc/self/exe").parent_path() / "fathom-onboard";
}

onboard::LiveSetup liveSetup(const std::filesystem::path& mission_folder, const std::filesystem::path& folder,
                             bool clear_folder, const std::string& more, double stuck_after_s) {
  if (clear_folder) {
    std::filesystem::remove_all(folder);
    std::filesystem::create_directories(folder);
    for (const char* name : {"mission.toml", "stereo.calib"})
      std::filesystem::copy_file(mission_folder / name, folder / name);
  }
  const std::filesystem::path config_file = folder.string() + ".toml";
  std::ofstream(config_file)
      << "[slam]\nmax_pairs = 400\nmax_keyframes = 400\n"
         "[realtime]\nsoft = true\nstuck_after_s = "
      << stuck_after_s
      << "\n"
         "[recorder]\nplanned_hours = 0.01\nimage_reserve_mib = 1\nlog_reserve_mib = 1\n"
         "[memory]\nheap_mib = 16\nbudget_mib = 2048\n"
         "[restart]\ncheckpoint_s = 2\n"
      << more;
  const io::MissionConfig mission = io::readMissionConfig(folder);
  const onboard::OnboardConfig config = onboard::readOnboardConfig(config_file, mission);
  return {folder,           config,     mission, readStereoCalib(io::MissionPaths(folder).calib()),
          onboardProgram(), config_file};
}

onboard::LiveDevices playedDevices(const Playback& played, const std::filesystem::path& folder,
                                   const io::MissionConfig& mission, const StereoRig& rig,
                                   const rt::VehicleClock& clock, const PlayedOptions& options) {
  const auto camera = [&](CameraSide side, const Camera& model) {
    return std::make_unique<PlayedCamera>(played, io::MissionPaths(folder).images(), side, mission, model,
                                          clock, options);
  };
  onboard::LiveDevices devices;
  devices.samples.push_back(std::make_unique<PlayedSamples>(played, clock));
  devices.left = camera(CameraSide::kLeft, rig.left);
  devices.right = camera(CameraSide::kRight, rig.right);
  return devices;
}

namespace {

// A sample with another time, as `time` says for each of its time stamps; DVL velocities times `direction`.
SensorSample moved(SensorSample sample, const std::function<std::int64_t(std::int64_t)>& time,
                   double direction) {
  std::visit(
      [&](auto& s) {
        using Sample = std::decay_t<decltype(s)>;
        const std::int64_t before = s.utc_ns;
        s.utc_ns = time(before);
        if constexpr (std::is_same_v<Sample, UsblFix>) s.arrival_utc_ns += s.utc_ns - before;
        if constexpr (std::is_same_v<Sample, DvlSample>)
          if (s.velocity) *s.velocity *= direction;
      },
      sample);
  return sample;
}

std::int64_t timeOf(const SensorSample& sample) {
  return std::visit([](const auto& s) { return s.utc_ns; }, sample);
}

}  // namespace

Shuttle::Shuttle(const std::vector<io::OnboardInput>& inputs, std::size_t pairs) {
  std::int64_t begin = 0, end = 0;
  std::vector<Step> forward;
  for (const io::OnboardInput& input : inputs) {
    const auto* sample = std::get_if<SensorSample>(&input.what);
    if (sample == nullptr) continue;
    if (forward.empty()) begin = timeOf(*sample);
    if (const auto* image = std::get_if<ImageEvent>(sample)) {
      auto& names = images_[static_cast<std::size_t>(image->side)];
      if (images_[0].size() >= pairs && images_[1].size() >= pairs) break;
      if (names.size() >= pairs) continue;
      names.push_back(image->file_name);
    }
    end = std::max(end, timeOf(*sample));
    forward.push_back({input.arrival_utc_ns, *sample});
  }
  // A pause between two legs as between two exposures, so that the last pair is not taken twice at once.
  constexpr std::int64_t kPauseNs = 500'000'000;
  leg_ns_ = end - begin + kPauseNs;
  for (const Step& step : forward) {
    const std::int64_t late = std::max<std::int64_t>(step.arrival_ns - timeOf(step.sample), 0);
    const auto ahead = [&](std::int64_t utc) { return utc - begin; };
    const auto back = [&](std::int64_t utc) { return end - utc; };
    for (const bool forth : {true, false}) {
      Step moved_step;
      moved_step.sample = forth ? moved(step.sample, ahead, 1.0) : moved(step.sample, back, -1.0);
      moved_step.arrival_ns = std::clamp<std::int64_t>(timeOf(moved_step.sample) + late, 0, leg_ns_);
      legs_[forth ? 0 : 1].push_back(std::move(moved_step));
    }
  }
  for (auto& leg : legs_)
    std::stable_sort(leg.begin(), leg.end(),
                     [](const Step& a, const Step& b) { return a.arrival_ns < b.arrival_ns; });
}

Shuttle::Step Shuttle::at(std::uint64_t number) const {
  const std::uint64_t leg = number / stepsOfLeg();
  const auto begin = static_cast<std::int64_t>(leg) * leg_ns_;
  Step step = legs_[leg % 2][static_cast<std::size_t>(number % stepsOfLeg())];
  step.arrival_ns += begin;
  step.sample = moved(
      std::move(step.sample), [begin](std::int64_t t) { return t + begin; }, 1.0);
  return step;
}

}  // namespace fathom::test

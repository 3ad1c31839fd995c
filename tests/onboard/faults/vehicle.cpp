#include "tests/onboard/faults/vehicle.hpp"

#include <array>
#include <fstream>
#include <limits>
#include <random>
#include <thread>
#include <utility>

#include "realtime/base/command_line.hpp"
#include "realtime/onboard/live/status_publisher.hpp"
#include "tests/onboard/live/played_devices.hpp"
#include "tests/support/bad_parts.hpp"
#include "tests/support/mapped_file.hpp"

namespace fathom::test {
namespace {

using namespace fathom::onboard;
namespace fs = std::filesystem;

// Devices that give what no device should, while the part that they belong to is PartFault::kCorrupt:
// impossible values and times; noise for pixels, and times; bytes of no frame.
constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
constexpr std::array<double, 5> kImpossible = {kNan, std::numeric_limits<double>::infinity(), -1e300, 1e9,
                                               -40};

bool corrupt(std::string_view part) {
  const BadPartsControl* const all = fathomBadParts();
  if (all == nullptr || all->fault != PartFault::kCorrupt || part != all->part) return false;
  return nowNs() < all->until_ns;
}

std::int64_t impossibleTime(std::int64_t utc_ns, std::uint64_t number) {
  constexpr std::int64_t kDay = 86'400'000'000'000;
  const std::array<std::int64_t, 6> times = {utc_ns, 0, utc_ns + kDay, utc_ns - kDay, INT64_MAX, INT64_MIN};
  return times[number % times.size()];
}

struct Spoil {
  double value;
  void operator()(DvlSample& s) const {
    s.velocity = Eigen::Vector3d::Constant(value);
    s.altitude = value;
    s.range.fill(value);
    s.sound_speed = value;
  }
  void operator()(AttitudeSample& s) const { s.roll = s.pitch = s.heading = value; }
  void operator()(DepthSample& s) const { s.depth = value; }
  void operator()(UsblFix& s) const { s.latitude = s.longitude = s.depth = s.sigma_horizontal = value; }
  void operator()(GpsFix& s) const { s.latitude = s.longitude = s.sigma_horizontal = value; }
  void operator()(WaterSample& s) const { s.sound_speed = s.temperature = s.conductivity = value; }
  void operator()(BatterySample& s) const { s.voltage = s.charge = value; }
  void operator()(MissionProgressSample& s) const { s.fraction = value; }
  void operator()(GyroSample& s) const { s.body_rate = Eigen::Vector3d::Constant(value); }
  void operator()(ImageEvent& s) const { s.exposure_s = value; }
};

class SpoiltSamples final : public io::SampleSource, private io::SampleSink {
 public:
  explicit SpoiltSamples(std::unique_ptr<io::SampleSource> source) : source_(std::move(source)) {}
  bool poll(int timeout_ms, io::SampleSink& sink) override {
    to_ = &sink;
    return source_->poll(timeout_ms, *this);
  }
  [[nodiscard]] io::DeviceHealth health() const override { return source_->health(); }

 private:
  // Beside the true one, which every other device of the vehicle would give. Navigation's own input is when
  // a sample came; the recorder's, bytes of any size.
  void sample(std::int64_t arrival_utc_ns, const SensorSample& sample) noexcept override {
    const bool misdated = corrupt("navigation");
    to_->sample(misdated ? impossibleTime(arrival_utc_ns, number_++) : arrival_utc_ns, sample);
    if (corrupt("recorder")) spoilRaw(arrival_utc_ns);
    if (!corrupt("samples")) return;
    SensorSample wrong = sample;
    std::visit(Spoil{kImpossible[number_ % kImpossible.size()]}, wrong);
    std::visit([&](auto& s) { s.utc_ns = impossibleTime(s.utc_ns, number_ / kImpossible.size()); }, wrong);
    ++number_;
    to_->sample(arrival_utc_ns, wrong);
  }
  void raw(std::int64_t arrival_utc_ns, std::string_view source,
           std::span<const std::uint8_t> bytes) noexcept override {
    to_->raw(arrival_utc_ns, source, bytes);
  }

  void spoilRaw(std::int64_t arrival_utc_ns) noexcept {
    const std::size_t size = noise_() % bytes_.size();
    for (std::uint8_t& byte : std::span(bytes_).first(size)) byte = static_cast<std::uint8_t>(noise_());
    to_->raw(impossibleTime(arrival_utc_ns, number_++), "RAW_DVL", std::span(bytes_).first(size));
  }

  std::unique_ptr<io::SampleSource> source_;
  io::SampleSink* to_ = nullptr;
  std::uint64_t number_ = 0;
  std::minstd_rand noise_;
  std::array<std::uint8_t, 20'000> bytes_{};
};

class SpoiltCamera final : public io::CameraSource, private io::FrameSink {
 public:
  explicit SpoiltCamera(std::unique_ptr<io::CameraSource> camera)
      : camera_(std::move(camera)), name_(camera_->health().name) {}
  bool poll(int timeout_ms, io::FrameSink& sink) override {
    to_ = &sink;
    return camera_->poll(timeout_ms, *this);
  }
  [[nodiscard]] rt::SharedBlocks& pool() noexcept override { return camera_->pool(); }
  [[nodiscard]] ImageView view(const io::CameraFrame& frame) noexcept override {
    return camera_->view(frame);
  }
  [[nodiscard]] io::DeviceHealth health() const override { return camera_->health(); }

 private:
  void frame(const io::CameraFrame& frame) noexcept override {
    if (corrupt(name_))
      for (std::byte& pixel : pool().bytes(frame.block)) pixel = static_cast<std::byte>(noise_());
    to_->frame(frame);
  }

  std::unique_ptr<io::CameraSource> camera_;
  io::FrameSink* to_ = nullptr;
  std::string_view name_;
  std::minstd_rand noise_;
};

// Takes frames and gives none but those.
class SpoiltModem final : public FramePort {
 public:
  bool send(std::span<const std::uint8_t>) noexcept override { return true; }
  std::size_t receive(std::span<std::uint8_t> buffer) noexcept override {
    // A few at each look.
    if (++looks_ % 3 == 0 || !corrupt("modem")) return 0;
    const std::size_t size = 1 + noise_() % kMaxFrameBytes;
    for (std::uint8_t& byte : buffer.first(size)) byte = static_cast<std::uint8_t>(noise_());
    return size;
  }
  [[nodiscard]] std::uint64_t droppedFrames() const noexcept override { return 0; }

 private:
  std::minstd_rand noise_;
  std::uint64_t looks_ = 0;
};

constexpr std::int64_t kLook_ns = 20'000'000, kSupervise_ns = 50'000'000;
constexpr double kLead_s = 0.5;        // of the vehicle's time, from arming to the first input
constexpr double kBeforeImages_s = 2;  // that the sensors come before the first exposure
constexpr double kLongestEnd_s = 60;
constexpr double kJump_m = 3;  // that no vehicle moves between two looks

// Begins when the vehicle is armed for the first time.
class ArmedMission final : public Playback {
 public:
  ArmedMission(const fs::path& mission, const rt::VehicleClock& clock, const VehicleSeen& seen)
      : seen_(seen), mission_(mission, clock, seen.shift_ns) {
    first = mission_.first;
    mission_.shift_ns = 0;
    if (seen_.shift_ns != 0) return;
    for (first = 0; first < mission_.inputs.size() && io::imageOf(mission_.inputs[first]) == nullptr;)
      ++first;
    const std::int64_t from_ns = mission_.inputs.at(first).arrival_utc_ns - seconds(kBeforeImages_s);
    while (first > 0 && mission_.inputs[first - 1].arrival_utc_ns >= from_ns) --first;
  }
  [[nodiscard]] std::optional<Step> at(std::size_t number) const override {
    const std::int64_t shift_ns = seen_.shift_ns;
    std::optional<Step> step = mission_.at(number);
    if (!step) return step;
    step->due_ns = shift_ns == 0 ? INT64_MAX : step->due_ns + shift_ns;
    if (step->sample) std::visit([&](auto& s) { s.utc_ns += shift_ns; }, *step->sample);
    return step;
  }
  [[nodiscard]] std::int64_t shiftToBegin(std::int64_t now_ns) const {
    return now_ns + seconds(kLead_s) - mission_.inputs.at(first).arrival_utc_ns;
  }

 private:
  static std::int64_t seconds(double s) { return static_cast<std::int64_t>(s * 1e9); }
  const VehicleSeen& seen_;
  PlayedMission mission_;
};

// Shows the judge the visible state of the program, independently of the program's threads.
class Observer {
 public:
  Observer(LiveSystem& live, VehicleSeen& seen) : live_(live), seen_(seen), thread_([this] { run(); }) {}
  ~Observer() {
    stop_ = true;
    thread_.join();
  }
  Observer(const Observer&) = delete;
  Observer& operator=(const Observer&) = delete;

 private:
  void run() {
    while (!stop_) {
      look();
      rt::restFor(kLook_ns);
    }
  }
  void look() {
    if (const std::uint64_t beats = live_.navigationBeats(); beats != beats_) {
      beats_ = beats;
      ++seen_.beats;
    }
    seen_.phase = static_cast<std::uint32_t>(live_.mapper().up().current());
    seen_.mapper = live_.mapperPid();
    seen_.mapper_starts = live_.supervisor().mapperStarts();
    MapState map;
    (void)live_.mapper().up().readMap(map);
    seen_.pairs = map.pairs + map.pairs_shed;
    seen_.lag_ns = map.lag_ns;
    NavState nav;
    if (!live_.hard().readForSupervisor(nav) || nav.pose_utc_ns == 0) return;
    const Eigen::Vector3d position = nav.T_odom_body.translation();
    if (!position.allFinite() || !nav.velocity_body.allFinite() ||
        (known_ && (position - position_).norm() > kJump_m))
      ++seen_.wild_poses;
    position_ = position;
    known_ = true;
  }

  LiveSystem& live_;
  VehicleSeen& seen_;
  std::uint64_t beats_ = 0;
  Eigen::Vector3d position_ = Eigen::Vector3d::Zero();
  bool known_ = false;
  std::atomic<bool> stop_{false};
  std::thread thread_;
};

void say(const std::string& line) {
  std::printf("%s\n", line.c_str());
  std::fflush(stdout);
}

}  // namespace

void prepareDive(const VehiclePlaces& places) {
  fs::remove_all(places.dive());
  fs::create_directories(places.dive());
  for (const char* name : {"mission.toml", "stereo.calib"})
    fs::copy_file(places.mission / name, places.dive() / name);
  // Pools for a minute, which cost a dive little; states as often as can be.
  std::ofstream(places.config()) << "[slam]\nmax_pairs = 60\nmax_keyframes = 60\nfeatures = 200\n"
                                    "max_links = 500\nmax_fixes = 100\n"
                                    "[map]\nmax_tiles = 256\n"
                                    "[link]\nmax_squares = 64\n"
                                    "[realtime]\nsoft = true\nend_within_s = 60\nstuck_after_s = "
                                 << kStuckAfter_s * kRate
                                 << "\n"
                                    "stack_kib = 512\nlibrary_stack_kib = 128\n"
                                    "[recorder]\nplanned_hours = 0.01\nimage_reserve_mib = 1\n"
                                    "log_reserve_mib = 1\nraw_queue_kib = 16\n"
                                    "[memory]\nheap_mib = 8\nvehicle_heap_mib = 4\nbudget_mib = 2048\n"
                                    "[restart]\ncheckpoint_s = 1\nbuffer_mib = 8\n";
}

int runVehicle(const VehiclePlaces& places) {
  const MappedFile<VehicleSeen> seen(places.seen());
  // This program has the calls in itself; the mapper that it starts is another.
  ::setenv("LD_PRELOAD", FATHOM_BIN_DIR "/libfathom_bad_disk.so", 1);
  const io::MissionConfig mission = io::readMissionConfig(places.dive());
  const StereoRig rig = readStereoCalib(io::MissionPaths(places.dive()).calib());
  const OnboardConfig config = readOnboardConfig(places.config(), mission);
  rt::VehicleClock clock(seen->clock);
  ArmedMission played(places.mission, clock, *seen);
  LiveDevices devices = playedDevices(played, places.mission, mission, rig, clock);
  devices.samples[0] = std::make_unique<SpoiltSamples>(std::move(devices.samples[0]));
  devices.left = std::make_unique<SpoiltCamera>(std::move(devices.left));
  devices.right = std::make_unique<SpoiltCamera>(std::move(devices.right));
  devices.modem = std::make_unique<SpoiltModem>();

  std::unique_ptr<StatusPublisher> publisher;
  const auto lost = [](const std::string& why) {
    say("lost: " + why);
    std::_Exit(kExitFailedWork);
  };
  LiveSystem live({places.dive(), config, mission, rig, onboardProgram(), places.config(), lost},
                  std::move(devices), clock);
  const std::size_t lane = live.addBestEffort(
      "publisher", [&publisher] { publisher->step(); }, [&publisher] { return publisher->restNs(); });
  publisher = std::make_unique<StatusPublisher>(live, nullptr, mission, places.dive(),
                                                StatusPublisher::Config{1, lane}, clock);
  for (const std::string& line : live.resumeSaid()) say(line);
  if (!live.arm().armed()) return kExitFailedWork;
  seen->armed_utc_ns = clock.utcNs();
  ++seen->lives;
  if (seen->shift_ns == 0) seen->shift_ns = played.shiftToBegin(clock.utcNs());
  LiveSystem::End end;
  {
    const Observer observer(live, *seen);
    while (!seen->end) {
      for (const std::string& event : live.supervise()) say(event);
      rt::restFor(kSupervise_ns);
    }
    const std::int64_t begin_ns = clock.monotonicNs();
    end = live.end(kLongestEnd_s * kRate);
    seen->end_s = static_cast<double>(clock.monotonicNs() - begin_ns) * 1e-9 / kRate;
  }
  for (const std::string& line : end.left_out) say("left out: " + line);
  if (const auto* loop = live.hardLoop(); loop != nullptr)
    seen->skipped_s = static_cast<double>(loop->skipped_cycles) *
                      static_cast<double>(config.live.realtime.period_ns) * 1e-9 / kRate;
  seen->mapped = end.mapped;
  seen->ended = true;
  if (live.hangs()) std::_Exit(kExitFailedWork);
  return kExitSuccess;
}

}  // namespace fathom::test

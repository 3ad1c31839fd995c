#include "tests/bench/realtime/shuttle_devices.hpp"

#include <fcntl.h>
#include <unistd.h>

#include <cerrno>
#include <ctime>
#include <map>
#include <system_error>
#include <utility>

#include "firmware_if/files/images/image_file.hpp"

namespace fathom::bench {
namespace {

constexpr std::size_t kPoolFrames = 12;

// Sleeps until the vehicle's clock says so, at most `timeout_ms` of the machine's; whether it is time.
bool waitFor(const rt::VehicleClock& clock, std::int64_t utc_ns, int timeout_ms) {
  constexpr long kStepNs = 1'000'000;
  for (long slept = 0; clock.utcNs() < utc_ns; slept += kStepNs) {
    if (slept >= timeout_ms * 1'000'000L) return false;
    const timespec pause{0, kStepNs};
    ::clock_nanosleep(CLOCK_MONOTONIC, 0, &pause, nullptr);
  }
  return true;
}

class ShuttleSamples final : public io::SampleSource {
 public:
  ShuttleSamples(const Shuttle& shuttle, const rt::VehicleClock& clock, std::int64_t begin)
      : shuttle_(shuttle), clock_(clock), begin_(begin) {}

  bool poll(int timeout_ms, io::SampleSink& sink) noexcept override {
    while (std::holds_alternative<ImageEvent>(shuttle_.at(next_).sample)) ++next_;
    const Shuttle::Step step = shuttle_.at(next_);
    if (!waitFor(clock_, begin_ + step.arrival_ns, timeout_ms)) return true;
    ++next_;
    SensorSample sample = step.sample;
    std::visit([this](auto& s) { s.utc_ns += begin_; }, sample);
    if (auto* fix = std::get_if<UsblFix>(&sample)) fix->arrival_utc_ns += begin_;
    sink.sample(clock_.utcNs(), sample);
    ++given_;
    return true;
  }
  void updateHealth(io::DeviceHealth& health) const noexcept override { health.samples = given_; }
  [[nodiscard]] io::DeviceHealth health() const override { return {"sensors", true, 0, given_, 0, {}}; }

 private:
  const Shuttle& shuttle_;
  const rt::VehicleClock& clock_;
  std::int64_t begin_;
  std::uint64_t next_ = 0, given_ = 0;
};

class ShuttleCamera final : public io::CameraSource {
 public:
  ShuttleCamera(const Shuttle& shuttle, CameraSide side, const io::MissionConfig& mission,
                const Camera& camera, const rt::VehicleClock& clock, std::int64_t begin,
                std::uint64_t exposures, std::atomic<std::uint64_t>* given)
      : shuttle_(shuttle),
        side_(side),
        format_(side == CameraSide::kLeft ? mission.cameras.left_format : mission.cameras.right_format),
        bits_(mission.cameras.bits),
        width_(camera.width),
        height_(camera.height),
        clock_(clock),
        begin_(begin),
        exposures_(exposures),
        given_(given),
        pool_(kPoolFrames, frameBytes()) {}
  ~ShuttleCamera() override {
    if (scratch_ >= 0) ::close(scratch_);
  }
  ShuttleCamera(const ShuttleCamera&) = delete;
  ShuttleCamera& operator=(const ShuttleCamera&) = delete;

  // Decodes every image of the way once.
  void load(const std::filesystem::path& images, const std::filesystem::path& scratch_folder) {
    scratch_ = ::open(scratch_folder.c_str(), O_TMPFILE | O_RDWR | O_CLOEXEC, 0600);
    if (scratch_ < 0)
      throw std::system_error(errno, std::generic_category(),
                              "no scratch file in " + scratch_folder.string());
    const std::size_t row = static_cast<std::size_t>(width_) * sampleBytes();
    for (const std::string& name : shuttle_.images(side_)) {
      const io::ImageFile file = io::readImage(images / name, format_, bits_, width_, height_);
      const auto number = place_.size();
      place_[name] = number;
      for (int y = 0; y < height_; ++y) {
        const auto* from =
            static_cast<const std::byte*>(file.view.data) + static_cast<std::size_t>(y) * file.view.stride;
        const auto at = static_cast<off_t>(number * frameBytes() + static_cast<std::size_t>(y) * row);
        if (::pwrite(scratch_, from, row, at) != static_cast<ssize_t>(row))
          throw std::system_error(errno, std::generic_category(), "scratch file full");
      }
    }
  }

  bool poll(int timeout_ms, io::FrameSink& sink) noexcept override {
    while (frames_ + missed_ < exposures_) {
      const Shuttle::Step step = shuttle_.at(next_);
      const auto* event = std::get_if<ImageEvent>(&step.sample);
      if (event != nullptr && event->side == side_) {
        if (!waitFor(clock_, begin_ + step.arrival_ns, timeout_ms)) return true;
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
    return {pool_.bytes(frame.block).data(),
            width_,
            height_,
            static_cast<std::size_t>(width_) * sampleBytes(),
            format_,
            bits_};
  }
  void updateHealth(io::DeviceHealth& health) const noexcept override { health.samples = frames_; }
  [[nodiscard]] io::DeviceHealth health() const override {
    return {side_ == CameraSide::kLeft ? "left camera" : "right camera", true, 0, frames_, 0, {}};
  }

 private:
  [[nodiscard]] std::size_t sampleBytes() const { return bits_ == 8 ? 1 : 2; }
  [[nodiscard]] std::size_t frameBytes() const {
    return static_cast<std::size_t>(width_) * static_cast<std::size_t>(height_) * sampleBytes();
  }

  void give(const ImageEvent& event, io::FrameSink& sink) noexcept {
    io::CameraFrame frame;
    frame.block = pool_.acquire();
    const auto place = place_.find(event.file_name);
    const auto bytes = static_cast<ssize_t>(frameBytes());
    if (frame.block == rt::SharedBlocks::kNone || place == place_.end()) {
      ++missed_;
    } else if (::pread(scratch_, pool_.bytes(frame.block).data(), frameBytes(),
                       static_cast<off_t>(place->second * frameBytes())) != bytes) {
      pool_.release(frame.block);
      ++missed_;
    } else {
      frame.side = side_;
      frame.frame_id = frames_++;
      frame.utc_ns = begin_ + event.utc_ns;
      frame.arrival_utc_ns = clock_.utcNs();
      frame.exposure_s = event.exposure_s;
      sink.frame(frame);
    }
    if (given_ != nullptr) given_->store(frames_ + missed_, std::memory_order_relaxed);
  }

  const Shuttle& shuttle_;
  CameraSide side_;
  PixelFormat format_;
  int bits_, width_, height_;
  const rt::VehicleClock& clock_;
  std::int64_t begin_;
  std::uint64_t exposures_;
  std::atomic<std::uint64_t>* given_;
  rt::SharedBlocks pool_;
  std::map<std::string, std::size_t> place_;  // of an image in the scratch file
  int scratch_ = -1;
  std::uint64_t next_ = 0, frames_ = 0, missed_ = 0;
};

}  // namespace

onboard::LiveDevices shuttleDevices(const Shuttle& shuttle, const std::filesystem::path& images,
                                    const std::filesystem::path& scratch_folder,
                                    const io::MissionConfig& mission, const StereoRig& rig,
                                    const rt::VehicleClock& clock, std::int64_t begin_utc_ns,
                                    std::uint64_t pairs, std::atomic<std::uint64_t>& given) {
  const auto camera = [&](CameraSide side, const Camera& model, std::atomic<std::uint64_t>* count) {
    auto made =
        std::make_unique<ShuttleCamera>(shuttle, side, mission, model, clock, begin_utc_ns, pairs, count);
    made->load(images, scratch_folder);
    return made;
  };
  onboard::LiveDevices devices;
  devices.samples.push_back(std::make_unique<ShuttleSamples>(shuttle, clock, begin_utc_ns));
  devices.left = camera(CameraSide::kLeft, rig.left, &given);
  devices.right = camera(CameraSide::kRight, rig.right, nullptr);
  return devices;
}

}  // namespace fathom::bench

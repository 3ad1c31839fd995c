#include "tests/onboard/faults/spoilt_devices.hpp"

#include <array>
#include <cstring>
#include <limits>
#include <random>
#include <utility>

#include "tests/support/bad_parts_control.hpp"
#include "tests/support/mapped_file.hpp"

namespace fathom::test {
namespace {

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
  void updateHealth(io::DeviceHealth& health) const noexcept override { source_->updateHealth(health); }
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
  void updateHealth(io::DeviceHealth& health) const noexcept override { camera_->updateHealth(health); }
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

}  // namespace

std::unique_ptr<io::SampleSource> spoilt(std::unique_ptr<io::SampleSource> source) {
  return std::make_unique<SpoiltSamples>(std::move(source));
}
std::unique_ptr<io::CameraSource> spoilt(std::unique_ptr<io::CameraSource> camera) {
  return std::make_unique<SpoiltCamera>(std::move(camera));
}
std::unique_ptr<FramePort> spoiltModem() {
  return std::make_unique<SpoiltModem>();
}

}  // namespace fathom::test

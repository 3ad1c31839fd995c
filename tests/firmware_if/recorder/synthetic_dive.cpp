#include "tests/firmware_if/recorder/synthetic_dive.hpp"

#include <algorithm>
#include <cstring>
#include <set>

#include "firmware_if/mission/images/image_file.hpp"
#include "firmware_if/mission/log/log_events.hpp"
#include "realtime/base/input_error.hpp"

namespace fathom::test {
namespace {

constexpr int kBits = 12;

// SplitMix64 (Steele et al., 2014).
std::uint64_t mixed(std::uint64_t x) {
  x += 0x9e3779b97f4a7c15;
  x = (x ^ x >> 30) * 0xbf58476d1ce4e5b9;
  x = (x ^ x >> 27) * 0x94d049bb133111eb;
  return x ^ x >> 31;
}

double unit(std::uint64_t number, std::uint64_t salt) {
  return static_cast<double>(mixed(8 * number + salt) >> 11) * 0x1.0p-53;
}

std::vector<std::uint8_t> rawBytes(std::uint64_t number) {
  std::vector<std::uint8_t> bytes(400 + mixed(number) % 400);
  for (std::size_t i = 0; i < bytes.size(); ++i) bytes[i] = static_cast<std::uint8_t>(mixed(number + i));
  return bytes;
}

bool carriesRaw(std::uint64_t number) {
  return number % 20 == 2;
}

std::string named(std::uint64_t number, const std::string& what) {
  return "input " + std::to_string(number) + ": " + what;
}

}  // namespace

io::MissionConfig SyntheticDive::mission() const {
  io::MissionConfig mission;
  mission.dive_id = 12;
  mission.origin = {-0.49, 2.01};
  mission.start_utc_ns = kStartUtcNs;
  mission.cameras.left_format = PixelFormat::kBayerRggb;
  mission.cameras.bits = kBits;
  mission.cameras.rate_hz = 100.0 / static_cast<double>(config_.inputs_per_pair);
  return mission;
}

StereoRig SyntheticDive::rig() const {
  const double focal = config_.width;
  const Camera camera{
      config_.width, config_.height, focal, focal, 0.5 * (config_.width - 1), 0.5 * (config_.height - 1)};
  return {camera, camera, SE3::fromEuler(0, 0, 0, {-0.07, 0, 0})};
}

io::OnboardInput SyntheticDive::input(std::uint64_t number) const {
  const std::int64_t arrival = kStartUtcNs + static_cast<std::int64_t>(number) * kInputIntervalNs;
  const std::int64_t utc_ns = arrival - 1'000'000;
  const std::uint64_t of_pair = number % config_.inputs_per_pair;
  if (of_pair == 3 || of_pair == 4) {
    const CameraSide side = of_pair == 3 ? CameraSide::kLeft : CameraSide::kRight;
    return {arrival, SensorSample(ImageEvent{utc_ns, side, io::imageFileName(utc_ns, side), 0.002})};
  }
  if (number % 10 == 0) return {arrival, io::Tick{}};
  if (number % 10 == 5) return {arrival, SensorSample(DepthSample{utc_ns, 20 + unit(number, 0)})};
  if (number % 20 == 2) {
    DvlSample dvl{.utc_ns = utc_ns,
                  .velocity = Eigen::Vector3d(unit(number, 0), unit(number, 1), unit(number, 2)),
                  .range = {},
                  .altitude = 2 + unit(number, 3)};
    return {arrival, SensorSample(dvl)};
  }
  if (number % 100 == 57) {
    io::ModemFrame frame{.size = 32};
    for (std::size_t i = 0; i < frame.size; ++i)
      frame.bytes[i] = static_cast<std::uint8_t>(mixed(number * 64 + i));
    return {arrival, frame};
  }
  return {arrival,
          SensorSample(AttitudeSample{utc_ns, unit(number, 0), unit(number, 1), 6 * unit(number, 2), true})};
}

std::vector<std::uint16_t> SyntheticDive::pixels(const ImageEvent& image) const {
  std::vector<std::uint16_t> pixels(static_cast<std::size_t>(config_.width) *
                                    static_cast<std::size_t>(config_.height));
  std::uint64_t state =
      mixed(static_cast<std::uint64_t>(image.utc_ns) + static_cast<std::uint64_t>(image.side));
  for (std::uint16_t& pixel : pixels) {
    state = state * 6364136223846793005 + 1442695040888963407;
    pixel = static_cast<std::uint16_t>(state >> (64 - kBits));
  }
  return pixels;
}

SyntheticDive::Found SyntheticDive::check(const std::filesystem::path& folder) const {
  Found found;
  const io::MissionPaths paths(folder);
  io::LogEventReader log(paths.log());
  io::LogEvent event;
  std::set<std::string> lost;
  while (log.next(event)) {
    if (event.channel == io::kGapChannel) {
      const auto gap = io::decodeGap(event.data);
      if (!gap) found.wrong.push_back("a gap cannot be decoded");
      if (gap && gap->kind == io::RecordingGap::Kind::kImage) lost.insert(gap->what);
      continue;
    }
    if (event.channel.substr(0, 4) == "RAW_") {
      if (!io::decodeRaw(event.data)) found.wrong.push_back("raw bytes cannot be decoded");
      continue;
    }
    if (!io::carriesInput(event.channel)) continue;
    const auto read = io::decodeInput(event.channel, event.data);
    if (!read) {
      found.wrong.push_back("an input on " + std::string(event.channel) + " cannot be decoded");
      continue;
    }
    const auto number = static_cast<std::uint64_t>((read->arrival_utc_ns - kStartUtcNs) / kInputIntervalNs);
    if (number < found.next) found.wrong.push_back(named(number, "comes after a later one"));
    found.skipped += number - found.next;
    found.next = number + 1;
    ++found.inputs;
    const io::OnboardInput offered = input(number);
    const io::LogMessage expected = io::encodeInput(offered);
    if (expected.channel != event.channel ||
        !std::equal(expected.data.begin(), expected.data.end(), event.data.begin(), event.data.end()))
      found.wrong.push_back(named(number, "differs from what was offered"));
    const ImageEvent* exposure = io::imageOf(offered);
    if (exposure == nullptr) continue;
    const std::string name = exposure->file_name;
    if (lost.contains(name)) {
      ++found.images_lost;
      continue;
    }
    ++found.images;
    try {
      const io::ImageFile image =
          io::readImage(paths.images() / name, PixelFormat::kMono, kBits, config_.width, config_.height);
      const std::vector<std::uint16_t> right = pixels(*exposure);
      if (image.bytes.size() != 2 * right.size() ||
          std::memcmp(image.bytes.data(), right.data(), image.bytes.size()) != 0)
        found.wrong.push_back(named(number, name + " holds other pixels"));
    } catch (const InputError& e) {
      found.wrong.push_back(named(number, e.what()));
    }
  }
  // The end may be cut; nothing before it may be damaged.
  if (log.damagedStretches() > 1) found.wrong.push_back("the log is damaged in more than its end");
  return found;
}

DivePlayer::DivePlayer(const SyntheticDive& dive, const SyntheticDive::Config& config, std::size_t blocks)
    : dive_(dive),
      config_(config),
      blocks_(blocks, 2 * static_cast<std::size_t>(config.width) * static_cast<std::size_t>(config.height)) {}

io::Recorder::ViewOf DivePlayer::viewOf() {
  return [this](const io::CameraFrame& frame) {
    return ImageView{.data = blocks_.bytes(frame.block).data(),
                     .width = config_.width,
                     .height = config_.height,
                     .stride = 2 * static_cast<std::size_t>(config_.width),
                     .format = frame.side == CameraSide::kLeft ? PixelFormat::kBayerRggb : PixelFormat::kMono,
                     .bits = kBits};
  };
}

io::Recorder::Release DivePlayer::release() {
  return [this](const io::CameraFrame& frame) { blocks_.release(frame.block); };
}

bool DivePlayer::offer(io::Recorder& recorder, std::uint64_t number) {
  const io::OnboardInput input = dive_.input(number);
  if (const ImageEvent* image = io::imageOf(input)) {
    io::CameraFrame frame;
    frame.side = image->side;
    frame.utc_ns = image->utc_ns;
    frame.block = blocks_.acquire();
    if (frame.block == rt::SharedBlocks::kNone) {
      ++without_block_;
    } else {
      const std::vector<std::uint16_t> pixels = dive_.pixels(*image);
      std::memcpy(blocks_.bytes(frame.block).data(), pixels.data(), 2 * pixels.size());
      recorder.offerImage(frame);
    }
  }
  if (carriesRaw(number)) (void)recorder.offerRaw(0, input.arrival_utc_ns, "RAW_DVL", rawBytes(number));
  return recorder.offerInput(input);
}

}  // namespace fathom::test

#include "sim/hil/gige/simulated_gige_camera.hpp"

#include <sys/prctl.h>

#include <algorithm>
#include <charconv>
#include <cstring>
#include <deque>
#include <fstream>
#include <future>
#include <random>
#include <set>
#include <utility>
#include <vector>

#include "firmware_if/devices/camera/pixel_unpack.hpp"
#include "firmware_if/mission/images/image_file.hpp"
#include "firmware_if/mission/mission.hpp"
#include "firmware_if/mission/sensor_log.hpp"
#include "realtime/base/input_error.hpp"
#include "sim/hil/gige/gige_device.hpp"

namespace fathom::sim {
namespace {

constexpr int kLastId = 65535;         // is followed by 1
constexpr std::size_t kLoadAhead = 3;  // images read before they are exposed
constexpr std::int64_t kIdleNs = 100'000'000;

// Reads the schedule's images ahead in other threads, so that clients are answered at the same time.
class ImageLoader {
 public:
  ImageLoader(const GigeCameraOptions& options, const GigeSchedule& schedule, int width, int height)
      : options_(options), schedule_(schedule), width_(width), height_(height) {}
  // Of the next exposure. Throws InputError for one that cannot be read.
  [[nodiscard]] io::ImageFile next() {
    while (waiting_.size() < kLoadAhead && begun_ < schedule_.exposures.size())
      waiting_.push_back(
          std::async(std::launch::async, [this, path = options_.images / schedule_.exposures[begun_++].file] {
            return io::readImage(path, options_.format, options_.bits, width_, height_);
          }));
    io::ImageFile image = waiting_.front().get();
    waiting_.pop_front();
    return image;
  }

 private:
  const GigeCameraOptions& options_;
  const GigeSchedule& schedule_;
  int width_, height_;
  std::size_t begun_ = 0;
  std::deque<std::future<io::ImageFile>> waiting_;
};

// The region of an image that the registers select, in the wire format; empty for invalid registers.
std::vector<std::byte> wireImage(const GigeRegisters& registers, const ImageView& image) {
  const auto formats = io::wireFormats();
  const auto wire = std::find_if(formats.begin(), formats.end(), [&](const io::WireFormat& format) {
    return format.code == registers.get(gige::kPixelFormat);
  });
  const std::size_t left = registers.get(gige::kOffsetX), top = registers.get(gige::kOffsetY);
  const std::size_t width = registers.get(gige::kWidth), height = registers.get(gige::kHeight);
  if (wire == formats.end() || left + width > static_cast<std::size_t>(image.width) ||
      top + height > static_cast<std::size_t>(image.height))
    return {};
  const std::size_t from_bytes = image.bits == 8 ? 1 : 2, to_bytes = wire->bits == 8 ? 1 : 2;
  std::vector<std::byte> pixels(width * height * to_bytes);
  for (std::size_t y = 0; y < height; ++y) {
    const auto* from =
        static_cast<const std::byte*>(image.data) + (y + top) * image.stride + left * from_bytes;
    std::byte* to = pixels.data() + y * width * to_bytes;
    if (from_bytes == to_bytes) {
      std::memcpy(to, from, width * to_bytes);
    } else {
      for (std::size_t x = 0; x < width; ++x) {
        std::uint16_t pixel;
        std::memcpy(&pixel, from + 2 * x, sizeof pixel);
        to[x] = static_cast<std::byte>(pixel >> (image.bits - 8));
      }
    }
  }
  std::vector<std::byte> bytes(io::wireBytes(wire->packing, width * height));
  (void)io::packPixels(wire->packing, width * height, pixels, bytes);
  return bytes;
}

class SimulatedGigeCamera {
 public:
  SimulatedGigeCamera(const GigeCameraOptions& options, const GigeSchedule& schedule);
  void run(const std::atomic<bool>& stop, const std::function<void()>& ready);

 private:
  struct Fate {
    const char* word = "away";
    int id = 0;
    std::int64_t clock_ns = 0;
    std::uint32_t packets = 0;
    std::size_t lost = 0;
  };
  void expose(std::size_t n);
  [[nodiscard]] Fate play(std::size_t n, const ImageView& image);
  [[nodiscard]] int firstId(std::size_t n) const;
  void restartWhenDue();
  [[nodiscard]] std::int64_t monoNs(double mission_s) const {
    return start_mono_ns_ + static_cast<std::int64_t>(mission_s / options_.rate * 1e9);
  }
  [[nodiscard]] std::int64_t dueNs(const GigeExposure& exposure) const {
    return monoNs(exposure.mission_s) + static_cast<std::int64_t>(exposure.late_s * 1e9);
  }

  GigeCameraOptions options_;
  const GigeSchedule& schedule_;
  rt::RealClock clock_;
  std::int64_t utc_ahead_ns_, start_mono_ns_;
  io::ImageFile first_;
  GigeDevice device_;
  ImageLoader images_;
  std::size_t reboot_ = 0;  // the next
  int next_id_;
  bool exposed_ = false;  // a client has had an exposure
  std::mt19937_64 random_;
  std::ofstream log_;
};

SimulatedGigeCamera::SimulatedGigeCamera(const GigeCameraOptions& options, const GigeSchedule& schedule)
    : options_(options),
      schedule_(schedule),
      utc_ahead_ns_(clock_.utcNs() - clock_.monotonicNs()),
      start_mono_ns_(options.start_utc_ns - utc_ahead_ns_),
      // All images have its size.
      first_(io::readImage(options.images / schedule.exposures.front().file, options.format, options.bits)),
      device_({.interface = options.interface,
               .serial = options.serial,
               .width = first_.view.width,
               .height = first_.view.height,
               .bayer = options.format == PixelFormat::kBayerRggb,
               .bits = options.bits,
               .clock_ppm = options.clock_ppm}),
      images_(options_, schedule_, first_.view.width, first_.view.height),
      next_id_(options.frame_id_start),
      random_(options.seed) {
  if (options_.log.empty()) return;
  log_.open(options_.log);
  if (!log_) throw InputError(options_.log, "", "cannot be written");
  log_ << "number,mission_s,file,frame_id,device_ns,exposed_utc_ns,fate,packets,packets_lost,late_s\n";
}

// Id of the first exposure for a client, from which consecutive ids reach the number of the schedule's first
// wrap; the next id when there is none before a restart.
int SimulatedGigeCamera::firstId(std::size_t n) const {
  for (std::size_t i = n; i < schedule_.exposures.size() && !schedule_.exposures[i].away; ++i) {
    const int wanted = schedule_.exposures[i].frame_id;
    if (wanted == 0) continue;
    const int ahead = static_cast<int>((i - n) % static_cast<std::size_t>(kLastId));
    return (wanted - 1 - ahead + kLastId) % kLastId + 1;
  }
  return next_id_;
}

SimulatedGigeCamera::Fate SimulatedGigeCamera::play(std::size_t n, const ImageView& image) {
  const GigeExposure& e = schedule_.exposures[n];
  if (!device_.on()) return {};
  if (!device_.streaming()) return {.word = "idle"};
  if (!exposed_) next_id_ = firstId(n);
  exposed_ = true;
  Fate fate{
      .word = "lost", .id = e.frame_id != 0 ? e.frame_id : next_id_, .clock_ns = device_.clockNs(dueNs(e))};
  next_id_ = fate.id % kLastId + 1;
  const GigeRegisters& registers = device_.registers();
  GvspFrame frame{.id = static_cast<std::uint16_t>(fate.id),
                  .ticks = GigeDevice::ticksOf(fate.clock_ns),
                  .pixel_format = registers.get(gige::kPixelFormat),
                  .width = registers.get(gige::kWidth),
                  .height = registers.get(gige::kHeight),
                  .data_bytes = device_.dataBytes(),
                  .image = wireImage(registers, image)};
  if (e.lost || frame.image.empty()) return fate;
  fate.word = "sent";
  fate.packets = frame.packets();
  std::set<std::uint32_t> lost;
  std::uniform_int_distribution<std::uint32_t> any(0, fate.packets - 1);
  while (lost.size() < std::min(static_cast<std::uint32_t>(e.lost_packets), fate.packets))
    lost.insert(any(random_));
  fate.lost = lost.size();
  device_.send(std::move(frame), lost, e.resend ? std::set<std::uint32_t>{} : lost);
  return fate;
}

void SimulatedGigeCamera::expose(std::size_t n) {
  const GigeExposure& e = schedule_.exposures[n];
  const io::ImageFile image = images_.next();
  const Fate fate = play(n, image.view);
  if (!log_.is_open()) return;
  log_ << n << ',' << e.mission_s << ',' << e.file << ',' << fate.id << ',' << fate.clock_ns << ','
       << dueNs(e) + utc_ahead_ns_ << ',' << fate.word << ',' << fate.packets << ',' << fate.lost << ','
       << e.late_s << '\n';
  log_.flush();
}

void SimulatedGigeCamera::restartWhenDue() {
  if (reboot_ == schedule_.reboots.size()) return;
  const GigeReboot& reboot = schedule_.reboots[reboot_];
  const std::int64_t now = clock_.monotonicNs();
  if (device_.on() && now >= monoNs(reboot.at_s)) device_.powerOff();
  if (device_.on() || now < monoNs(reboot.at_s + reboot.for_s)) return;
  next_id_ = 1;
  device_.powerOn(0);
  ++reboot_;
}

void SimulatedGigeCamera::run(const std::atomic<bool>& stop, const std::function<void()>& ready) {
  ::prctl(PR_SET_TIMERSLACK, 1);  // wakes without the default slack of 50 us
  device_.powerOn(static_cast<std::int64_t>(options_.clock_offset_s * 1e9));
  ready();
  std::size_t next = 0;
  while (!stop.load() && (next < schedule_.exposures.size() || !options_.exit_when_done)) {
    restartWhenDue();
    std::int64_t until = clock_.monotonicNs() + kIdleNs;
    if (reboot_ < schedule_.reboots.size()) {
      const GigeReboot& reboot = schedule_.reboots[reboot_];
      until = std::min(until, monoNs(device_.on() ? reboot.at_s : reboot.at_s + reboot.for_s));
    }
    if (next < schedule_.exposures.size()) {
      const std::int64_t send = dueNs(schedule_.exposures[next]) + device_.exposureNs();
      if (clock_.monotonicNs() >= send) {
        expose(next++);
        continue;
      }
      until = std::min(until, send);
    }
    device_.serveUntil(until);
  }
}

}  // namespace

std::vector<GigeExposure> missionExposures(const std::filesystem::path& mission, CameraSide side,
                                           std::int64_t first_utc_ns) {
  std::vector<GigeExposure> exposures;
  io::SensorLogReader log(mission);
  while (const auto entry = log.next()) {
    const auto* event = std::get_if<ImageEvent>(&entry->sample);
    if (event == nullptr || event->side != side || event->utc_ns < first_utc_ns) continue;
    if (!io::plainFileName(event->file_name)) continue;
    const double mission_s = static_cast<double>(event->utc_ns - first_utc_ns) * 1e-9;
    if (!exposures.empty() && mission_s <= exposures.back().mission_s) continue;  // a camera exposes in order
    exposures.push_back({.mission_s = mission_s, .file = event->file_name});
  }
  if (exposures.empty())
    throw InputError(mission, side == CameraSide::kLeft ? "left images" : "right images",
                     "has none after the start; give a mission with images, or an earlier start");
  return exposures;
}

std::vector<GigeExposure> listedExposures(const std::filesystem::path& list) {
  std::ifstream in(list);
  if (!in) throw InputError(list, "", "cannot be read; give lines of <mission second>,<image file>");
  std::vector<GigeExposure> exposures;
  std::string line;
  for (int number = 1; std::getline(in, line); ++number) {
    const std::size_t comma = line.find(',');
    GigeExposure exposure;
    const char* end = line.data() + std::min(comma, line.size());
    const auto [stop, error] = std::from_chars(line.data(), end, exposure.mission_s);
    if (comma != std::string::npos) exposure.file = line.substr(comma + 1);
    if (error != std::errc() || stop != end || !(exposure.mission_s >= 0) ||
        !io::plainFileName(exposure.file) ||
        (!exposures.empty() && exposure.mission_s <= exposures.back().mission_s))
      throw InputError(list, "line " + std::to_string(number),
                       "is no <mission second>,<image file> later than the line before");
    exposures.push_back(std::move(exposure));
  }
  if (exposures.empty()) throw InputError(list, "", "is empty; give lines of <mission second>,<image file>");
  return exposures;
}

GigeSchedule withFaults(std::vector<GigeExposure> exposures, const FaultScript& script, CameraSide side) {
  GigeSchedule schedule{.exposures = std::move(exposures), .reboots = {}};
  for (const Fault& fault : script.faults) {
    if (!fault.hits(side)) continue;
    if (fault.kind == FaultKind::kCameraReboot) schedule.reboots.push_back({fault.at_s, fault.for_s});
    int count = 0;
    for (GigeExposure& exposure : schedule.exposures) {
      if (fault.kind == FaultKind::kIdWrap) {
        if (exposure.mission_s < fault.at_s) continue;
        exposure.frame_id = fault.frame_id;
        break;
      }
      if (!fault.covers(exposure.mission_s)) continue;
      const bool hit = count++ % fault.every == 0;
      switch (fault.kind) {
        case FaultKind::kCameraReboot:
          exposure.away = true;
          break;
        case FaultKind::kSkew:
          if (hit) exposure.late_s = fault.offset_s;
          break;
        case FaultKind::kLostFrames:
          if (hit) exposure.lost = true;
          break;
        case FaultKind::kLostPackets:
          if (hit) {
            exposure.lost_packets = fault.packets;
            exposure.resend = fault.resend;
          }
          break;
        default:
          break;
      }
    }
  }
  return schedule;
}

void serveGigeCamera(const GigeCameraOptions& options, const GigeSchedule& schedule,
                     const std::atomic<bool>& stop, const std::function<void()>& ready) {
  SimulatedGigeCamera(options, schedule).run(stop, ready);
}

}  // namespace fathom::sim

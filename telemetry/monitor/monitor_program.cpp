#include "telemetry/monitor/monitor_program.hpp"

#include <algorithm>
#include <cctype>
#include <chrono>
#include <iostream>
#include <memory>
#include <thread>

#include "firmware_if/devices/modem/modem_ports.hpp"
#include "realtime/base/input_error.hpp"
#include "realtime/kernel/time/clock.hpp"
#include "telemetry/monitor/frame_feed.hpp"
#include "telemetry/monitor/session.hpp"
#include "telemetry/monitor/web/web_server.hpp"
#include "telemetry/web/access.hpp"

namespace fathom::monitor {
namespace {

using namespace std::chrono_literals;

constexpr auto kPollInterval = 20ms;  // far shorter than any frame on the link

void require(bool good, const char* option, const char* fix) {
  if (!good) throw InputError(option, "", fix);
}

std::optional<telemetry::LinkIdentity> identityOf(const MonitorOptions& options) {
  if (!options.vehicle && !options.dive) return std::nullopt;
  require(options.vehicle && options.dive, "--vehicle/--dive", "give both or neither");
  require(*options.vehicle >= 0 && *options.vehicle <= 255, "--vehicle", "is outside 0 to 255");
  require(*options.dive >= 0 && *options.dive <= 65535, "--dive", "is outside 0 to 65535");
  return telemetry::LinkIdentity{static_cast<std::uint8_t>(*options.vehicle),
                                 static_cast<std::uint16_t>(*options.dive)};
}

LiveFeed openPorts(const MonitorOptions& options) {
  std::vector<std::unique_ptr<FramePort>> ports;
  if (options.udp_port) {
    require(*options.udp_port >= 1 && *options.udp_port <= 65535, "--udp", "is outside 1 to 65535");
    ports.push_back(std::make_unique<io::UdpFramePort>(options.bind_address,
                                                       static_cast<std::uint16_t>(*options.udp_port), "", 0));
  }
  if (!options.serial_device.empty())
    ports.push_back(std::make_unique<io::SerialFramePort>(options.serial_device, options.baud));
  return LiveFeed(std::move(ports));
}

std::string tokenOf(const MonitorOptions& options) {
  if (options.token_file.empty()) return web::isLoopback(options.http_address) ? "" : web::makeToken();
  std::string warning;
  std::string token = web::readToken(options.token_file, warning);
  if (!warning.empty()) std::cerr << "fathom-monitor: " << warning << std::endl;
  return token;
}

std::optional<telemetry::LinkKey> keyOf(const MonitorOptions& options) {
  if (options.key.empty()) return std::nullopt;
  std::string warning;
  const telemetry::LinkKey key = telemetry::readLinkKey(options.key, warning);
  if (!warning.empty()) std::cerr << "fathom-monitor: " << warning << std::endl;
  return key;
}

// Loads what an earlier run received into the same folder.
void reload(SessionFiles& files, MonitorModel& model) {
  std::string damage;
  const std::size_t count =
      files.reload([&](std::span<const std::uint8_t> bytes,
                       std::int64_t utc_ns) { return model.accept(bytes, utc_ns).verdict; },
                   [&] { model.noteDamage(); }, damage);
  if (!damage.empty()) std::cerr << "fathom-monitor: " << damage << std::endl;
  const auto& identity = model.receiver().identity();
  if (count > 0 && identity)
    std::cout << "fathom-monitor: continues with " << count << " frames of vehicle "
              << int{identity->vehicle_id} << ", dive " << identity->dive_id
              << " (for another dive give another --out)" << std::endl;
}

// Passes received frames to the model, and the page's requests to the vehicle or the recording.
class Reception {
 public:
  Reception(SharedModel& shared, const MonitorOptions& options, SessionFiles* files)
      : shared_(shared), files_(files), listen_only_(options.listen) {
    if (options.packets.empty()) {
      live_.emplace(openPorts(options));
    } else {
      require(options.speed >= 0, "--speed", "is negative");
      recording_.emplace(options.packets);
      recording_->setSpeed(options.speed, clock_.monotonicNs());
      const std::lock_guard lock(shared.mutex);
      publish();
    }
  }

  [[nodiscard]] std::string damage() const { return recording_ ? recording_->damage() : ""; }
  [[nodiscard]] bool recorded() const { return recording_.has_value(); }
  [[nodiscard]] bool mayEnd() const { return !recording_ || recording_->finished(); }

  // Returns how many frames came.
  std::size_t step() {
    const std::lock_guard lock(shared_.mutex);
    const auto take = [&](std::span<const std::uint8_t> bytes, std::int64_t utc_ns) {
      return shared_.model->receive(bytes, utc_ns,
                                    [&](const auto& frame, std::span<const std::uint8_t> link_frame) {
                                      if (files_ != nullptr)
                                        files_->log(frame, link_frame, utc_ns, recorded());
                                    });
    };
    if (live_) {
      shared_.now_utc_ns = clock_.utcNs();
      const std::size_t count = live_->poll(take);
      std::array<std::uint8_t, FramePort::kMaxFrameBytes> frame;
      // Only frames on the disk are acknowledged: the vehicle does not send acknowledged ones again.
      if (const std::size_t size =
              listen_only_ ? 0
                           : shared_.model->speak(clock_.utcNs(), frame,
                                                  [&] { return files_ == nullptr || files_->keep(); });
          size > 0)
        (void)live_->send(std::span<const std::uint8_t>(frame).first(size));
      return count;
    }
    for (const PlaybackRequest& request : shared_.playback_requests) apply(request);
    shared_.playback_requests.clear();
    const std::size_t count = recording_->poll(take, clock_.monotonicNs());
    publish();
    return count;
  }

 private:
  void apply(const PlaybackRequest& request) {
    const std::int64_t now = clock_.monotonicNs();
    if (request.speed) recording_->setSpeed(*request.speed, now);
    if (request.playing) recording_->setPlaying(*request.playing, now);
    if (request.seek_utc_ns && recording_->seek(*request.seek_utc_ns, now)) shared_.reset();
  }

  void publish() {
    shared_.now_utc_ns = recording_->atUtcNs();
    shared_.playback = {recording_->firstUtcNs(), recording_->lastUtcNs(), recording_->atUtcNs(),
                        recording_->speed(),      recording_->playing(),   recording_->finished()};
  }

  SharedModel& shared_;
  SessionFiles* files_;
  bool listen_only_;
  rt::RealClock clock_;
  std::optional<LiveFeed> live_;
  std::optional<Recording> recording_;
};

}  // namespace

int runMonitor(const MonitorOptions& options, const std::atomic<bool>& stop) {
  const rt::RealClock clock;
  const bool live = options.udp_port || !options.serial_device.empty();
  require(live != !options.packets.empty(), "the source of frames",
          "give --udp and/or --serial, or else --packets");
  require(options.http_port >= 0 && options.http_port <= 65535, "--http", "is outside 0 to 65535");
  web::PageServerConfig page;
  page.address = options.http_address;
  page.port = options.http_port;
  page.option = "--http";
  page.page = web::pageFolder(options.page, "monitor");
  page.token = tokenOf(options);
  SharedModel shared(identityOf(options), keyOf(options), static_cast<std::uint64_t>(clock.utcNs()));
  shared.listens = options.listen;
  std::optional<SessionFiles> files;
  if (!options.out.empty()) files.emplace(options.out);
  const WebServer server(shared, page);
  Reception reception(shared, options, files ? &*files : nullptr);
  if (files && live) {
    const std::lock_guard lock(shared.mutex);
    reload(*files, *shared.model);
  }
  std::cout << "fathom-monitor: http://" << options.http_address << ':' << server.port() << '/'
            << (page.token.empty() ? "" : "?token=" + page.token) << std::endl;
  int exit_code = kExitSuccess;
  if (const std::string damage = reception.damage(); !damage.empty()) {  // what came before it is shown
    std::cerr << "fathom-monitor: " << damage << std::endl;
    exit_code = kExitBadInput;
  }

  const SessionKeeper keeper(shared, files ? &*files : nullptr, options.out);
  std::int64_t last_frame_ns = clock.monotonicNs();
  while (!stop) {
    const std::size_t count = reception.step();
    const std::int64_t now = clock.monotonicNs();
    shared.grew.notify_all();
    if (count > 0 || !reception.mayEnd()) last_frame_ns = now;
    if (options.exit_after_idle_s && reception.mayEnd() &&
        static_cast<double>(now - last_frame_ns) >= *options.exit_after_idle_s * 1e9)
      break;
    if (count == 0) std::this_thread::sleep_for(kPollInterval);
  }
  return exit_code;
}

}  // namespace fathom::monitor

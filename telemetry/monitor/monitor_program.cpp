#include "telemetry/monitor/monitor_program.hpp"

#include <chrono>
#include <iostream>
#include <memory>
#include <thread>

#include "firmware_if/modem_ports.hpp"
#include "realtime/kernel/clock.hpp"
#include "realtime/kernel/input_error.hpp"
#include "telemetry/monitor/frame_feed.hpp"
#include "telemetry/monitor/session_files.hpp"
#include "telemetry/monitor/web_server.hpp"

namespace fathom::monitor {
namespace {

using namespace std::chrono_literals;
using telemetry::FrameVerdict;

constexpr auto kPollInterval = 20ms;  // far shorter than any frame on the link
constexpr std::int64_t kProgressInterval_ns = 10'000'000'000;
constexpr std::int64_t kSaveInterval_ns = 30'000'000'000;

void require(bool good, const char* option, const char* mend) {
  if (!good) throw InputError(option, "", mend);
}

std::optional<telemetry::LinkIdentity> identityOf(const MonitorOptions& options) {
  if (!options.vehicle && !options.dive) return std::nullopt;
  require(options.vehicle && options.dive, "--vehicle/--dive", "give both or neither");
  require(*options.vehicle >= 0 && *options.vehicle <= 255, "--vehicle", "is outside 0 to 255");
  require(*options.dive >= 0 && *options.dive <= 65535, "--dive", "is outside 0 to 65535");
  return telemetry::LinkIdentity{static_cast<std::uint8_t>(*options.vehicle),
                                 static_cast<std::uint16_t>(*options.dive)};
}

std::unique_ptr<FrameFeed> openFeed(const MonitorOptions& options) {
  const bool live = options.udp_port || !options.serial_device.empty();
  require(live != !options.packets.empty(), "the source of frames",
          "give --udp and/or --serial, or else --packets");
  if (!live) {
    require(options.speed >= 0, "--speed", "is negative");
    std::error_code error;
    if (std::filesystem::is_regular_file(options.packets, error) &&
        std::filesystem::file_size(options.packets, error) == 0)
      throw InputError(options.packets.string(), "", "is empty: give a packets.bin that holds frames");
    return std::make_unique<RecordedFeed>(options.packets, options.speed);
  }
  std::vector<std::unique_ptr<FramePort>> ports;
  if (options.udp_port) {
    require(*options.udp_port >= 1 && *options.udp_port <= 65535, "--udp", "is outside 1 to 65535");
    ports.push_back(std::make_unique<io::UdpFramePort>(options.bind_address,
                                                       static_cast<std::uint16_t>(*options.udp_port), "", 0));
  }
  if (!options.serial_device.empty())
    ports.push_back(std::make_unique<io::SerialFramePort>(options.serial_device, options.baud));
  return std::make_unique<LiveFeed>(std::move(ports));
}

std::filesystem::path pageFolder(const MonitorOptions& options) {
  if (!options.page.empty()) return options.page;
  return std::filesystem::read_symlink("/proc/self/exe").parent_path().parent_path() / "share/fathom/monitor";
}

void printProgress(const MonitorModel& model) {
  const auto& c = model.receiver().counters();
  std::cout << "frames " << c[FrameVerdict::kAccepted] << " accepted, " << c.lost << " lost, "
            << c.frames - c[FrameVerdict::kAccepted] << " rejected; " << c.bytes << " bytes; tiles "
            << model.map().size() << ", " << static_cast<long>(model.map().area()) << " m2; track "
            << model.track().size() << " points" << std::endl;
}

}  // namespace

int runMonitor(const MonitorOptions& options, const std::atomic<bool>& stop) {
  SharedModel shared(identityOf(options));
  const auto feed = openFeed(options);
  std::optional<SessionFiles> files;
  if (!options.out.empty()) files.emplace(options.out);
  require(options.http_port >= 0 && options.http_port <= 65535, "--http", "is outside 0 to 65535");
  shared.feed.recorded = feed->recorded();
  const WebServer server(shared, options.http_address, options.http_port, pageFolder(options));
  std::cout << "fathom-monitor: http://" << options.http_address << ':' << server.port() << '/' << std::endl;

  const rt::RealClock clock;
  std::int64_t last_frame_ns = clock.monotonicNs(), last_progress_ns = last_frame_ns,
               last_save_ns = last_frame_ns;
  std::uint64_t printed_version = 0;
  int exit_code = kExitSuccess;
  const auto take = [&](std::span<const std::uint8_t> bytes, std::int64_t utc_ns) {
    const std::lock_guard lock(shared.mutex);
    const auto frame = shared.model.accept(bytes, utc_ns);
    if (feed->recorded()) shared.feed.now_utc_ns = utc_ns;
    if (files) files->log(frame, bytes.size(), utc_ns);
  };
  // Only this thread changes the model, so it may read it without the lock.
  while (!stop) {
    std::size_t count = 0;
    try {
      count = feed->poll(take);
    } catch (const InputError& error) {  // a damaged recording: what came before it stays on view
      std::cerr << "fathom-monitor: " << error.what() << std::endl;
      exit_code = kExitBadInput;
    }
    const std::int64_t now = clock.monotonicNs();
    {
      const std::lock_guard lock(shared.mutex);
      if (!feed->recorded()) shared.feed.now_utc_ns = clock.utcNs();
      shared.feed.finished = feed->finished();
    }
    if (count > 0) {
      last_frame_ns = now;
      shared.grew.notify_all();
    }
    const bool may_end = !feed->recorded() || feed->finished();
    if (!may_end) last_frame_ns = now;
    if (now - last_progress_ns >= kProgressInterval_ns && shared.model.version() != printed_version) {
      printProgress(shared.model);
      printed_version = shared.model.version();
      last_progress_ns = now;
    }
    if (files && now - last_save_ns >= kSaveInterval_ns) {
      files->save(shared.model);
      last_save_ns = now;
    }
    if (options.exit_after_idle_s && may_end &&
        static_cast<double>(now - last_frame_ns) >= *options.exit_after_idle_s * 1e9)
      break;
    if (count == 0) std::this_thread::sleep_for(kPollInterval);
  }
  if (files) files->save(shared.model);
  printProgress(shared.model);
  return exit_code;
}

}  // namespace fathom::monitor

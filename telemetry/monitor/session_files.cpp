#include "telemetry/monitor/session_files.hpp"

#include <stdexcept>
#include <string>

#include "realtime/kernel/input_error.hpp"
#include "recon/geometry/atomic_file.hpp"
#include "telemetry/monitor/export/exports.hpp"
#include "telemetry/wire/packet_log.hpp"

namespace fathom::monitor {

using telemetry::FrameVerdict;

namespace {
constexpr const char* kReceived = "received.bin";
constexpr std::uintmax_t kPacketHeadBytes = 12;
}  // namespace

SessionFiles::SessionFiles(std::filesystem::path folder) : folder_(std::move(folder)) {
  std::error_code error;
  std::filesystem::create_directories(folder_, error);
  if (!error) {
    log_.open(folder_ / "frames.log", std::ios::app);
    received_.open(folder_ / kReceived, std::ios::app | std::ios::binary);
  }
  if (error || !log_ || !received_)
    throw InputError(folder_.string(), "", "cannot write here: give --out a folder that can be made");
  if (log_.tellp() == 0) log_ << "# utc_ns verdict type vehicle dive sequence bytes\n";
}

std::size_t SessionFiles::reload(const std::function<void(std::span<const std::uint8_t>, std::int64_t)>& take,
                                 std::string& damage) {
  const auto path = folder_ / kReceived;
  std::uintmax_t whole = 0;
  std::size_t count = 0;
  try {
    telemetry::PacketLogReader reader(path);
    while (const auto packet = reader.next()) {
      take(packet->bytes, packet->utc_ns);
      whole += kPacketHeadBytes + packet->bytes.size();
      ++count;
    }
  } catch (const InputError& error) {
    std::error_code failed;
    std::filesystem::resize_file(path, whole, failed);
    if (failed) throw;
    damage = std::string(error.what()) + " (the damaged end has been cut off)";
  }
  return count;
}

void SessionFiles::log(const telemetry::DecodedFrame& frame, std::span<const std::uint8_t> bytes,
                       std::int64_t utc_ns, bool recorded) {
  const bool accepted = frame.verdict == FrameVerdict::kAccepted;
  if (accepted && !recorded &&
      !(telemetry::writePacket(received_, utc_ns, bytes) && received_.flush().good()))
    throw std::runtime_error((folder_ / kReceived).string() + ": cannot be written, is the disk full?");
  if (!accepted && ++rejected_lines_ > kMaxRejectedLines) return;
  log_ << utc_ns << ' ' << name(frame.verdict) << ' ';
  if (accepted || frame.verdict >= FrameVerdict::kForeign) {
    log_ << name(frame.header.type) << ' ' << unsigned{frame.header.identity.vehicle_id} << ' '
         << frame.header.identity.dive_id << ' ' << frame.header.sequence;
  } else {
    log_ << "- - - -";
  }
  log_ << ' ' << bytes.size() << '\n';
}

void SessionFiles::save(const MonitorModel& model) {
  log_.flush();
  const bool origin = model.mission().has_value();
  const bool map = model.map().version() != saved_map_ || origin != saved_origin_;
  const bool track = model.track().size() != saved_track_ || origin != saved_origin_;
  for (const std::string_view name : kExportNames) {
    if (!(name == "track.geojson" ? track : map)) continue;
    const Export made = makeExport(model, name);
    if (made.bytes.empty()) continue;
    writeFile(folder_ / name, made.bytes);
  }
  saved_map_ = model.map().version();
  saved_track_ = model.track().size();
  saved_origin_ = origin;
}

}  // namespace fathom::monitor

#include "telemetry/monitor/session_files.hpp"

#include <string>

#include "realtime/kernel/input_error.hpp"
#include "recon/geometry/atomic_file.hpp"
#include "recon/geometry/mesh_io.hpp"
#include "telemetry/monitor/reports.hpp"

namespace fathom::monitor {

using telemetry::FrameVerdict;

SessionFiles::SessionFiles(std::filesystem::path folder) : folder_(std::move(folder)) {
  std::error_code error;
  std::filesystem::create_directories(folder_, error);
  if (!error) log_.open(folder_ / "frames.log");
  if (error || !log_)
    throw InputError(folder_.string(), "", "cannot write here: give --out a folder that can be made");
  log_ << "# utc_ns verdict type vehicle dive sequence bytes\n";
}

void SessionFiles::log(const telemetry::DecodedFrame& frame, std::size_t bytes, std::int64_t utc_ns) {
  const bool accepted = frame.verdict == FrameVerdict::kAccepted;
  if (!accepted && ++rejected_lines_ > kMaxRejectedLines) return;
  log_ << utc_ns << ' ' << name(frame.verdict) << ' ';
  if (accepted || frame.verdict >= FrameVerdict::kForeign) {
    log_ << name(frame.header.type) << ' ' << unsigned{frame.header.identity.vehicle_id} << ' '
         << frame.header.identity.dive_id << ' ' << frame.header.sequence;
  } else {
    log_ << "- - - -";
  }
  log_ << ' ' << bytes << '\n';
}

void SessionFiles::save(const MonitorModel& model) {
  log_.flush();
  if (model.map().version() != saved_map_) {
    writePly(folder_ / "map.ply", model.map().mesh(),
             {"nav frame: x north, y east, z down [m]", "as received over the acoustic link"});
    saved_map_ = model.map().version();
  }
  if (const std::string track = trackGeoJson(model); !track.empty()) {
    AtomicFile file(folder_ / "track.geojson");
    file.stream() << track;
    file.commit();
  }
}

}  // namespace fathom::monitor

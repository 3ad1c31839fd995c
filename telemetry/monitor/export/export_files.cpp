#include "telemetry/monitor/export/export_files.hpp"

#include <exception>

#include "recon/geometry/atomic_file.hpp"
#include "telemetry/monitor/export/exports.hpp"

namespace fathom::monitor {

void ExportFiles::save(ModelView& view) {
  trouble_.clear();
  const bool origin = view.mission().has_value();
  const bool all = origin != saved_origin_ || view.epoch() != saved_epoch_;
  const bool map = all || view.store().version() != saved_map_;
  const bool track = all || view.track().size() != saved_track_;
  try {
    for (const std::string_view name : kExportNames) {
      if (!(name == "track.geojson" ? track : map)) continue;
      const Export made = makeExport(view, name);
      if (!made.bytes.empty()) writeFile(folder_ / name, made.bytes);
    }
  } catch (const std::exception& error) {
    trouble_ = error.what();
    return;
  }
  saved_epoch_ = view.epoch();
  saved_map_ = view.store().version();
  saved_track_ = view.track().size();
  saved_origin_ = origin;
}

}  // namespace fathom::monitor

#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

namespace fathom::sim {

// One exposure as the simulated camera logged it (fathom-sim camera --log).
struct CameraLogRow {
  double mission_s = 0;
  std::string file;
  int frame_id = 0;
  std::int64_t exposed_utc_ns = 0;
  std::string fate;  // sent, idle (no client), lost (lost_frames), away (camera_reboot)
  int packets_lost = 0;
};

// Columns are found by their names. Throws InputError for a file that is absent or has no such columns; a cut
// last line is left out.
[[nodiscard]] std::vector<CameraLogRow> readCameraLog(const std::filesystem::path& path);

}  // namespace fathom::sim

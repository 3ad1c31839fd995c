#pragma once

#include <cstdint>
#include <cstdio>
#include <filesystem>
#include <initializer_list>
#include <nlohmann/json_fwd.hpp>
#include <string>
#include <vector>

#include "sim/hil/fault_script.hpp"

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

// Reads the columns by name and ignores an incomplete last line. Throws InputError for an absent file and for
// missing columns.
[[nodiscard]] std::vector<CameraLogRow> readCameraLog(const std::filesystem::path& path);

// Faults of a bench run by kind: requested by the script, injected by the bench, and counted by the program
// under test (onboard/live.json and report.json).
class FaultTable {
 public:
  FaultTable(const FaultScript& script, const nlohmann::json& run, const nlohmann::json& live,
             const nlohmann::json& report, const std::vector<CameraLogRow>& left,
             const std::vector<CameraLogRow>& right);

  // Whether every packet of this exposure arrived, at once or by resending.
  [[nodiscard]] bool arrivedComplete(CameraSide side, const CameraLogRow& row) const;
  // A counter in nested tables; 0 without one.
  [[nodiscard]] static std::uint64_t counter(const nlohmann::json& json,
                                             std::initializer_list<const char*> path);

  // Prints the table; true when every kind's count agrees with what was injected.
  bool print(std::FILE* out) const;
  [[nodiscard]] nlohmann::ordered_json json() const;

 private:
  struct Row {
    FaultKind kind = FaultKind::kLostPackets;
    std::uint64_t asked = 0, injected = 0, counted = 0;
    std::string counter;  // of the program; "" without one
    bool exact = true;    // counted must equal injected; else be positive just when injected is
    [[nodiscard]] bool good() const;
  };
  void add(FaultKind kind, std::uint64_t injected, std::uint64_t counted, const std::string& counter,
           bool exact);

  FaultScript script_;
  std::vector<std::uint64_t> asked_;
  std::vector<Row> rows_;
};

}  // namespace fathom::sim

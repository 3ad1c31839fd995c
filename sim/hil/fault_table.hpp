#pragma once

#include <cstdint>
#include <cstdio>
#include <initializer_list>
#include <nlohmann/json_fwd.hpp>
#include <string>
#include <vector>

#include "sim/hil/camera_log.hpp"
#include "sim/hil/fault_script.hpp"

namespace fathom::sim {

// What a bench run's faults were: asked by the script, done by the bench, and counted by the program under
// test (onboard/live.json and report.json), kind by kind.
class FaultTable {
 public:
  FaultTable(const FaultScript& script, const nlohmann::json& run, const nlohmann::json& live,
             const nlohmann::json& report, const std::vector<CameraLogRow>& left,
             const std::vector<CameraLogRow>& right);

  // Whether every packet of this exposure came: at once, or again because the camera was told to send lost
  // packets again.
  [[nodiscard]] bool cameWhole(CameraSide side, const CameraLogRow& row) const;
  // A counter in nested tables; 0 where there is none.
  [[nodiscard]] static std::uint64_t counter(const nlohmann::json& json,
                                             std::initializer_list<const char*> path);

  // A table; true when every kind's count is what was injected.
  bool print(std::FILE* out) const;
  [[nodiscard]] nlohmann::ordered_json json() const;

 private:
  struct Row {
    FaultKind kind = FaultKind::kLostPackets;
    std::uint64_t asked = 0, injected = 0, counted = 0;
    std::string counter;  // of the program; "" for what has none
    bool exact = true;    // counted must equal injected; else only be there when something was injected
    [[nodiscard]] bool good() const;
  };
  void add(FaultKind kind, std::uint64_t injected, std::uint64_t counted, const std::string& counter,
           bool exact);

  FaultScript script_;
  std::vector<std::uint64_t> asked_;
  std::vector<Row> rows_;
};

}  // namespace fathom::sim

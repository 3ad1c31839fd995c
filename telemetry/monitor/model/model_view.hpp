#pragma once

#include <cstdint>
#include <optional>

#include "telemetry/monitor/map/surface.hpp"
#include "telemetry/monitor/model/coverage.hpp"
#include "telemetry/monitor/model/shared_model.hpp"

namespace fathom::monitor {

// A copy of what a model has received, for whoever works on it for longer than reception can wait: pages,
// exports, files. Meshes and coverage are made when asked for, outside of the model's lock, and kept until
// they change. For one thread at a time.
class ModelView {
 public:
  ModelView() = default;
  ModelView(const ModelView&) = delete;
  ModelView& operator=(const ModelView&) = delete;

  // Takes over what is new, under the model's lock; the map's chunks are shared, not copied.
  void refresh(SharedModel& shared);
  void take(const MonitorModel& model, std::uint64_t epoch = 0, std::int64_t now_utc_ns = 0);

  [[nodiscard]] std::uint64_t epoch() const { return epoch_; }
  [[nodiscard]] const BlockStore& store() const { return store_; }
  [[nodiscard]] Surface& surface() { return *surface_; }
  [[nodiscard]] const Track& track() const { return track_; }
  [[nodiscard]] const Coverage& coverage();  // of now
  [[nodiscard]] const std::optional<telemetry::MissionInfo>& mission() const { return mission_; }
  [[nodiscard]] telemetry::LinkIdentity identity() const { return identity_; }
  [[nodiscard]] std::int64_t historyStart() const { return history_start_ns_; }  // UTC [ns]

 private:
  std::uint64_t epoch_ = 0;
  std::int64_t now_utc_ns_ = 0, history_start_ns_ = 0;
  BlockStore store_;
  std::optional<Surface> surface_{store_};
  Track track_;
  std::uint64_t track_version_ = 0;
  std::optional<telemetry::MissionInfo> mission_;
  telemetry::LinkIdentity identity_;
  Coverage coverage_;
  std::uint64_t coverage_map_ = 0, coverage_track_ = 0;  // versions that coverage_ is of
};

}  // namespace fathom::monitor

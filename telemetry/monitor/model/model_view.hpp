#pragma once

#include <condition_variable>
#include <cstdint>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <vector>

#include "telemetry/monitor/map/surface.hpp"
#include "telemetry/monitor/model/coverage.hpp"
#include "telemetry/monitor/model/monitor_model.hpp"

namespace fathom::monitor {

// The state of playing a recording; absent for a live link.
struct Playback {
  std::int64_t first_utc_ns = 0, last_utc_ns = 0, at_utc_ns = 0;
  double speed = 0;  // 0: as fast as it can be taken
  bool playing = true;
  bool finished = false;
};

// A change of the playing that the page requests: the fields that are set.
struct PlaybackRequest {
  std::optional<std::int64_t> seek_utc_ns;
  std::optional<double> speed;
  std::optional<bool> playing;
};

// State shared by the receiving thread and the others, under the mutex. Reception waits for the mutex: hold
// it for milliseconds, and do long work on a ModelView.
struct SharedModel {
  SharedModel(std::optional<telemetry::LinkIdentity> only, const std::optional<telemetry::LinkKey>& key,
              std::uint64_t first_epoch)
      : identity(only),
        has_key(key.has_value()),
        model(std::make_unique<MonitorModel>(only, key)),
        epoch(first_epoch) {}

  // Why the page cannot send requests to the vehicle; empty if it can.
  [[nodiscard]] std::string whySilent() const {
    if (playback) return "This is a recording: nothing can be asked of the vehicle.";
    if (listens) return "This program only listens (--listen); another one may speak to the vehicle.";
    if (!has_key) return "No key: start fathom-monitor with --key FILE, the vehicle holds the same.";
    if (model->link().sender() == nullptr) return "No frame yet: it is not known which vehicle to ask.";
    return "";
  }

  // Drops what was received, for a recording that plays from its beginning again.
  void reset() {
    model = std::make_unique<MonitorModel>(identity);
    ++epoch;
  }

  static constexpr std::size_t kMaxPlaybackRequests = 16;

  std::mutex mutex;
  std::condition_variable grew;  // notified after changes
  const std::optional<telemetry::LinkIdentity> identity;
  const bool has_key;
  std::unique_ptr<MonitorModel> model;
  std::uint64_t epoch;          // of the model; a page with another one loads everything again
  std::int64_t now_utc_ns = 0;  // the wall clock; of a recording, its time
  std::string not_kept;         // what cannot be stored, a sentence; empty: nothing
  bool listens = false;         // receives and never sends
  std::optional<Playback> playback;
  std::vector<PlaybackRequest> playback_requests;
};

// A copy of a model's received data, for work that takes longer than reception can wait: pages, exports,
// files. Meshes and coverage are computed when asked for, outside of the model's lock, and kept until they
// change. For one thread at a time.
class ModelView {
 public:
  ModelView() = default;
  ModelView(const ModelView&) = delete;
  ModelView& operator=(const ModelView&) = delete;

  // Copies what is new, under the model's lock; the map's chunks are shared, not copied.
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

inline void ModelView::refresh(SharedModel& shared) {
  const std::lock_guard lock(shared.mutex);
  take(*shared.model, shared.epoch, shared.now_utc_ns);
}

inline void ModelView::take(const MonitorModel& model, std::uint64_t epoch, std::int64_t now_utc_ns) {
  now_utc_ns_ = now_utc_ns;
  history_start_ns_ = model.history().start();
  mission_ = model.mission();
  identity_ = model.receiver().identity().value_or(telemetry::LinkIdentity{});
  const bool is_another = epoch != epoch_;  // its versions cannot be compared with those before
  if (is_another || track_version_ != model.trackVersion()) track_ = model.track();
  if (is_another || store_.version() != model.map().version()) store_ = model.map().store();
  track_version_ = model.trackVersion();
  if (!is_another) return;
  epoch_ = epoch;
  surface_.emplace(store_);
  coverage_map_ = coverage_track_ = UINT64_MAX;
}

inline const Coverage& ModelView::coverage() {
  if (coverage_map_ != store_.version() || coverage_track_ != track_version_ ||
      now_utc_ns_ >= coverage_.changes_until_utc_ns) {
    coverage_ = coverageOf(track_, store_, now_utc_ns_);
    coverage_map_ = store_.version();
    coverage_track_ = track_version_;
  }
  return coverage_;
}

}  // namespace fathom::monitor

#include "telemetry/monitor/model/model_view.hpp"

namespace fathom::monitor {

void ModelView::refresh(SharedModel& shared) {
  const std::lock_guard lock(shared.mutex);
  take(*shared.model, shared.epoch, shared.now_utc_ns);
}

void ModelView::take(const MonitorModel& model, std::uint64_t epoch, std::int64_t now_utc_ns) {
  now_utc_ns_ = now_utc_ns;
  history_start_ns_ = model.history().start();
  mission_ = model.mission();
  identity_ = model.receiver().identity().value_or(telemetry::LinkIdentity{});
  const bool is_another = epoch != epoch_;  // whose versions say nothing of the one before
  if (is_another || track_version_ != model.trackVersion()) track_ = model.track();
  if (is_another || store_.version() != model.map().version()) store_ = model.map().store();
  track_version_ = model.trackVersion();
  if (!is_another) return;
  epoch_ = epoch;
  surface_.emplace(store_);
  coverage_map_ = coverage_track_ = UINT64_MAX;
}

const Coverage& ModelView::coverage() {
  if (coverage_map_ != store_.version() || coverage_track_ != track_version_ ||
      now_utc_ns_ >= coverage_.changes_until_utc_ns) {
    coverage_ = coverageOf(track_, store_, now_utc_ns_);
    coverage_map_ = store_.version();
    coverage_track_ = track_version_;
  }
  return coverage_;
}

}  // namespace fathom::monitor

#pragma once

#include <condition_variable>
#include <cstdint>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <vector>

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

}  // namespace fathom::monitor

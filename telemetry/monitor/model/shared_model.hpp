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

// Where a recording stands; absent for a live link.
struct Playback {
  std::int64_t first_utc_ns = 0, last_utc_ns = 0, at_utc_ns = 0;
  double speed = 0;  // 0: as fast as it can be taken
  bool playing = true;
  bool finished = false;
};

// A change to the playing that the page asks for: what is set.
struct PlaybackWish {
  std::optional<std::int64_t> seek_utc_ns;
  std::optional<double> speed;
  std::optional<bool> playing;
};

// What the receiving thread and the others share; everything under the mutex. Reception waits for it: hold it
// for milliseconds, and work on a ModelView.
struct SharedModel {
  SharedModel(std::optional<telemetry::LinkIdentity> only, const std::optional<telemetry::LinkKey>& key,
              std::uint64_t first_epoch)
      : identity(only),
        has_key(key.has_value()),
        model(std::make_unique<MonitorModel>(only, key)),
        epoch(first_epoch) {}

  // Why the page cannot ask the vehicle for anything; empty if it can.
  [[nodiscard]] std::string whySilent() const {
    if (playback) return "This is a recording: nothing can be asked of the vehicle.";
    if (listens) return "This program only listens (--listen); another one may speak to the vehicle.";
    if (!has_key) return "No key: start fathom-monitor with --key FILE, the vehicle holds the same.";
    if (model->link().sender() == nullptr) return "No frame yet: it is not known which vehicle to ask.";
    return "";
  }

  // Forgets what was received, for a recording that plays from its beginning again.
  void beginAnew() {
    model = std::make_unique<MonitorModel>(identity);
    ++epoch;
  }

  static constexpr std::size_t kMaxWishes = 16;

  std::mutex mutex;
  std::condition_variable grew;  // notified after changes
  const std::optional<telemetry::LinkIdentity> identity;
  const bool has_key;
  std::unique_ptr<MonitorModel> model;
  std::uint64_t epoch;          // a page that knows another one begins anew
  std::int64_t now_utc_ns = 0;  // the wall clock; of a recording, its time
  std::string not_kept;         // what the disk does not take, a sentence; empty: nothing
  bool listens = false;         // and never speaks
  std::optional<Playback> playback;
  std::vector<PlaybackWish> wishes;
};

}  // namespace fathom::monitor

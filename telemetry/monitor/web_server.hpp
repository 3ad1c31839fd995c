#pragma once

#include <condition_variable>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <mutex>
#include <string>

#include "telemetry/monitor/reports.hpp"

namespace fathom::monitor {

// The model and its feed between the thread that receives and those that serve.
struct SharedModel {
  explicit SharedModel(std::optional<telemetry::LinkIdentity> identity) : model(identity) {}
  std::mutex mutex;
  std::condition_variable grew;  // after a change, and at the end
  MonitorModel model;
  FeedState feed;
  bool closing = false;
};

// Serves the page and the model over HTTP:
//   /               the page's files
//   /api/state      stateJson        /api/track   trackJson        /api/tiles?since=V   tilesBinary
//   /api/events     server-sent events, `data: {"version":V,"map_version":M}` after each change, at most 4 a
//   second
class WebServer {
 public:
  // `port` 0: any free one. Throws InputError when it cannot listen there or `page` holds no index.html.
  WebServer(SharedModel& shared, const std::string& address, int port, const std::filesystem::path& page);
  ~WebServer();
  [[nodiscard]] int port() const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace fathom::monitor

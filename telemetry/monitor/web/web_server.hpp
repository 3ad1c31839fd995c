#pragma once

#include <memory>

#include "telemetry/monitor/model/model_view.hpp"
#include "telemetry/web/page_server.hpp"

namespace fathom::monitor {

// Serves the page and the model over HTTP:
//   /                     the page's files
//   /api/state, /api/track, /api/history, /api/profile?n0=&e0=&n1=&e1=, /api/coverage    see page_api.hpp
//   /api/map?since=V      mapBinary
//   /api/export/NAME      map.ply, elevation.tif, colour.tif, track.geojson
//   /api/events           server-sent events, `data: {"epoch":E,"version":V}` after each change, at most 4 a
//                         second
//   POST /api/request, /api/fix, /api/playback     see page_api.hpp
// No request holds the model's lock for longer than a copy takes (ModelView).
class WebServer {
 public:
  // Throws InputError when it cannot listen; `config`'s limits are set here.
  WebServer(SharedModel& shared, web::PageServerConfig config);
  ~WebServer();
  [[nodiscard]] int port() const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace fathom::monitor

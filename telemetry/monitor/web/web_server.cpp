#include "telemetry/monitor/web/web_server.hpp"

#include <array>
#include <charconv>
#include <cmath>
#include <mutex>
#include <optional>
#include <string>
#include <thread>

#include "realtime/base/units.hpp"
#include "telemetry/monitor/export/exports.hpp"
#include "telemetry/monitor/map/received_map.hpp"
#include "telemetry/monitor/model/model_view.hpp"
#include "telemetry/monitor/web/page_api.hpp"

namespace fathom::monitor {
namespace {

using namespace std::chrono_literals;
using web::answer, web::refusal, web::HttpRequest, web::Response;
using web::status::kBadRequest, web::status::kBusy, web::status::kConflict, web::status::kNotFound;

constexpr const char* kJson = "application/json";
constexpr const char* kBinary = "application/octet-stream";

std::uint64_t sinceOf(const HttpRequest& request) {
  const std::string text = request.parameter("since");
  std::uint64_t since = 0;
  std::from_chars(text.data(), text.data() + text.size(), since);
  return since;
}

// The line from n0, e0 to n1, e1 [m]; nullopt when a value is absent or out of bounds.
std::optional<std::array<double, 4>> lineOf(const HttpRequest& request) {
  constexpr std::array<const char*, 4> kNames{"n0", "e0", "n1", "e1"};
  std::array<double, 4> line{};
  for (std::size_t i = 0; i < kNames.size(); ++i) {
    const std::string text = request.parameter(kNames[i]);
    const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), line[i]);
    if (error != std::errc() || end != text.data() + text.size() || !(std::abs(line[i]) <= kMaxHorizontal_m))
      return std::nullopt;
  }
  return line;
}

}  // namespace

struct WebServer::Impl {
  explicit Impl(SharedModel& s) : shared(s) {}
  ~Impl();
  void addReads(web::Routes& routes);
  void addExports(web::Routes& routes);
  void addPosts(web::Routes& routes);
  void publishChanges();

  SharedModel& shared;
  std::mutex view_mutex;  // of page_view; locked before the model's, never after it
  ModelView page_view;
  ModelView export_view;  // of long work, one at a time
  std::optional<web::PageServer> page;
  bool closing = false;   // under the model's mutex
  std::thread publisher;  // last: it uses the rest
};

void WebServer::Impl::addReads(web::Routes& routes) {
  routes.get("/api/state", [this](const HttpRequest&) {
    const std::lock_guard lock(view_mutex);
    return answer(stateJson(shared, page_view), kJson);
  });
  routes.get("/api/history", [this](const HttpRequest&) {
    const std::lock_guard lock(shared.mutex);
    return answer(historyJson(*shared.model), kJson);
  });
  // Answers computed from a copy of the map and the track.
  const auto view = [this, &routes](const char* path, auto make) {
    routes.get(path, [this, make](const HttpRequest& request) {
      const std::lock_guard lock(view_mutex);
      page_view.refresh(shared);
      return make(request, page_view);
    });
  };
  view("/api/track", [](const HttpRequest&, ModelView& v) { return answer(trackJson(v), kJson); });
  view("/api/coverage",
       [](const HttpRequest&, ModelView& v) { return answer(coverageBinary(v.coverage()), kBinary); });
  view("/api/map", [](const HttpRequest& request, ModelView& v) {
    Response map = answer(mapBinary(v.store(), v.surface(), sinceOf(request), v.historyStart()), kBinary);
    map.headers.emplace_back("X-Epoch", epochOf(v));
    return map;
  });
  view("/api/profile", [](const HttpRequest& request, ModelView& v) {
    const auto line = lineOf(request);
    if (!line) return refusal(kBadRequest, "needs n0, e0, n1, e1: places in nav [m]");
    return answer(profileJson(v.surface(), (*line)[0], (*line)[1], (*line)[2], (*line)[3]), kJson);
  });
}

void WebServer::Impl::addExports(web::Routes& routes) {
  for (const std::string_view name : kExportNames) {
    const auto handler = [this, name](const HttpRequest&) {
      export_view.refresh(shared);
      Export file = makeExport(export_view, name);
      if (file.bytes.empty()) return refusal(kNotFound, "Not yet: " + file.why + ".");
      Response response = answer(std::move(file.bytes), file.type);
      response.headers.emplace_back("Content-Disposition",
                                    "attachment; filename=\"" + std::string(name) + "\"");
      return response;
    };
    routes.get("/api/export/" + std::string(name), handler, web::Routes::Work::kLong);
  }
}

void WebServer::Impl::addPosts(web::Routes& routes) {
  // parse(body, why) returns the value, take(value) takes or refuses it.
  const auto post = [this, &routes](const char* path, auto parse, auto take) {
    routes.post(path, [this, parse, take](const HttpRequest& request) {
      std::string why;
      const auto wanted = parse(request.body, why);
      if (!wanted) return refusal(kBadRequest, why);
      const std::lock_guard lock(shared.mutex);
      return take(*wanted);
    });
  };
  const auto taken = [] { return answer("{}", kJson); };
  post("/api/request", parseRequest, [this, taken](const telemetry::Request& wanted) {
    if (const std::string why = shared.whySilent(); !why.empty()) return refusal(kConflict, why);
    if (!shared.model->ask(wanted, shared.now_utc_ns))
      return refusal(kBusy, "too many requests wait for the ship's turn");
    return taken();
  });
  post("/api/fix", parseFix, [this, taken](const telemetry::UsblFixMessage& fix) {
    if (const std::string why = shared.whySilent(); !why.empty()) return refusal(kConflict, why);
    if (!shared.model->sendFix(fix)) return refusal(kBadRequest, "the fix is out of bounds");
    return taken();
  });
  post("/api/playback", parsePlayback, [this, taken](const PlaybackRequest& wanted) {
    if (!shared.playback) return refusal(kConflict, "this is a live link, not a recording");
    if (shared.playback_requests.size() >= SharedModel::kMaxPlaybackRequests)
      return refusal(kBusy, "too many requests wait");
    shared.playback_requests.push_back(wanted);
    return taken();
  });
}

void WebServer::Impl::publishChanges() {
  const auto now = [this] {
    std::string text =
        R"({"epoch":")" + epochOf(shared) + R"(","version":)" + std::to_string(shared.model->version());
    if (shared.playback) text += R"(,"at":)" + std::to_string(shared.playback->at_utc_ns / kSecond_ns);
    return text + "}";
  };
  std::string published;
  std::unique_lock lock(shared.mutex);
  while (!closing) {
    if (std::string text = now(); text != published) {
      published = text;
      lock.unlock();
      page->publish(std::move(text));
      lock.lock();
    }
    if (!closing) shared.grew.wait(lock);
  }
}

WebServer::Impl::~Impl() {
  {
    const std::lock_guard lock(shared.mutex);
    closing = true;
  }
  shared.grew.notify_all();
  if (publisher.joinable()) publisher.join();
}

WebServer::WebServer(SharedModel& shared, web::PageServerConfig config)
    : impl_(std::make_unique<Impl>(shared)) {
  config.max_body_bytes = kMaxBodyBytes;
  web::Routes routes;
  impl_->addReads(routes);
  impl_->addExports(routes);
  impl_->addPosts(routes);
  routes.events("/api/events");
  impl_->page.emplace(config, std::move(routes));
  impl_->publisher = std::thread([impl = impl_.get()] { impl->publishChanges(); });
}

WebServer::~WebServer() = default;

int WebServer::port() const {
  return impl_->page->port();
}

}  // namespace fathom::monitor

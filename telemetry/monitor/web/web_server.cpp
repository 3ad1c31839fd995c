#include "telemetry/monitor/web/web_server.hpp"

#include <array>
#include <charconv>
#include <cmath>
#include <mutex>
#include <optional>
#include <string>
#include <thread>

#include "telemetry/monitor/export/exports.hpp"
#include "telemetry/monitor/map/chunk_stream.hpp"
#include "telemetry/monitor/model/model_view.hpp"
#include "telemetry/monitor/web/page_requests.hpp"
#include "telemetry/monitor/web/reports.hpp"

namespace fathom::monitor {
namespace {

using namespace std::chrono_literals;
using web::answer, web::refusal, web::Request, web::Response;
using web::status::kBadRequest, web::status::kBusy, web::status::kConflict, web::status::kNotFound;

constexpr const char* kJson = "application/json";
constexpr const char* kBinary = "application/octet-stream";

std::uint64_t sinceOf(const Request& request) {
  const std::string text = request.parameter("since");
  std::uint64_t since = 0;
  std::from_chars(text.data(), text.data() + text.size(), since);
  return since;
}

// From n0, e0 to n1, e1 [m]; none where one is no place that a dive has.
std::optional<std::array<double, 4>> lineOf(const Request& request) {
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
  void tellOfGrowth();

  SharedModel& shared;
  std::mutex view_mutex;  // of page_view; may wait for the model's, never the other way round
  ModelView page_view;
  ModelView export_view;  // of long work, which is one at a time
  std::optional<web::PageServer> page;
  bool closing = false;  // under the model's mutex
  std::thread teller;    // last: it uses the rest
};

void WebServer::Impl::addReads(web::Routes& routes) {
  routes.get("/api/state", [this](const Request&) {
    const std::lock_guard lock(view_mutex);
    return answer(stateJson(shared, page_view), kJson);
  });
  routes.get("/api/history", [this](const Request&) {
    const std::lock_guard lock(shared.mutex);
    return answer(historyJson(*shared.model), kJson);
  });
  // What is made of the map or the track, from a copy.
  const auto view = [this, &routes](const char* path, auto make) {
    routes.get(path, [this, make](const Request& request) {
      const std::lock_guard lock(view_mutex);
      page_view.refresh(shared);
      return make(request, page_view);
    });
  };
  view("/api/track", [](const Request&, ModelView& v) { return answer(trackJson(v), kJson); });
  view("/api/coverage",
       [](const Request&, ModelView& v) { return answer(coverageBinary(v.coverage()), kBinary); });
  view("/api/map", [](const Request& request, ModelView& v) {
    Response map = answer(mapBinary(v.store(), v.surface(), sinceOf(request), v.historyStart()), kBinary);
    map.headers.emplace_back("X-Epoch", epochOf(v));
    return map;
  });
  view("/api/profile", [](const Request& request, ModelView& v) {
    const auto line = lineOf(request);
    if (!line) return refusal(kBadRequest, "needs n0, e0, n1, e1: places in nav [m]");
    return answer(profileJson(v.surface(), (*line)[0], (*line)[1], (*line)[2], (*line)[3]), kJson);
  });
}

void WebServer::Impl::addExports(web::Routes& routes) {
  for (const std::string_view name : kExportNames) {
    const auto handler = [this, name](const Request&) {
      export_view.refresh(shared);
      Export made = makeExport(export_view, name);
      if (made.bytes.empty()) return refusal(kNotFound, "Not yet: " + made.why + ".");
      Response file = answer(std::move(made.bytes), made.type);
      file.headers.emplace_back("Content-Disposition", "attachment; filename=\"" + std::string(name) + "\"");
      return file;
    };
    routes.get("/api/export/" + std::string(name), handler, web::Routes::Work::kLong);
  }
}

void WebServer::Impl::addPosts(web::Routes& routes) {
  // parse(body, why) gives what is wanted, take(wanted) takes it or refuses.
  const auto post = [this, &routes](const char* path, auto parse, auto take) {
    routes.post(path, [this, parse, take](const Request& request) {
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
    if (!shared.model->tellFix(fix)) return refusal(kBadRequest, "the fix is out of bounds");
    return taken();
  });
  post("/api/playback", parsePlayback, [this, taken](const PlaybackWish& wish) {
    if (!shared.playback) return refusal(kConflict, "this is a live link, not a recording");
    if (shared.wishes.size() >= SharedModel::kMaxWishes) return refusal(kBusy, "too many wishes wait");
    shared.wishes.push_back(wish);
    return taken();
  });
}

void WebServer::Impl::tellOfGrowth() {
  const auto now = [this] {
    std::string text =
        R"({"epoch":")" + epochOf(shared) + R"(","version":)" + std::to_string(shared.model->version());
    if (shared.playback) text += R"(,"at":)" + std::to_string(shared.playback->at_utc_ns / 1'000'000'000);
    return text + "}";
  };
  std::string told;
  std::unique_lock lock(shared.mutex);
  while (!closing) {
    if (std::string text = now(); text != told) {
      told = text;
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
  if (teller.joinable()) teller.join();
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
  impl_->teller = std::thread([impl = impl_.get()] { impl->tellOfGrowth(); });
}

WebServer::~WebServer() = default;

int WebServer::port() const {
  return impl_->page->port();
}

}  // namespace fathom::monitor

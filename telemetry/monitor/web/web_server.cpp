#include "telemetry/monitor/web/web_server.hpp"

#include <httplib.h>

#include <algorithm>
#include <atomic>
#include <charconv>
#include <chrono>
#include <cmath>
#include <optional>
#include <thread>

#include "telemetry/monitor/export/exports.hpp"
#include "telemetry/monitor/map/chunk_stream.hpp"
#include "telemetry/monitor/web/page_requests.hpp"
#include "telemetry/monitor/web/reports.hpp"

namespace fathom::monitor {
namespace {

using namespace std::chrono_literals;
using httplib::Request;
using httplib::Response;
using web::kBadRequest, web::kBusy, web::kConflict, web::kFailed, web::kNotFound, web::refuse;

constexpr std::size_t kThreads = 24;    // each event stream holds one
constexpr int kMaxEventStreams = 16;    // a page refused a stream asks for the state instead
constexpr auto kEventInterval = 250ms;  // a person does not see faster
constexpr auto kHeartbeat = 5s;         // tells a closed connection from a quiet dive

std::uint64_t sinceOf(const Request& request) {
  const std::string text = request.get_param_value("since");
  std::uint64_t since = 0;
  std::from_chars(text.data(), text.data() + text.size(), since);
  return since;
}

}  // namespace

struct WebServer::Impl {
  explicit Impl(SharedModel& s) : shared(s) {}
  void reads(httplib::Server& server);
  void exports(httplib::Server& server);
  void posts(httplib::Server& server);
  void events(Response& response);

  SharedModel& shared;
  std::atomic<int> streams{0};
  std::optional<web::PageServer> page;  // last: its threads use the rest
};

void WebServer::Impl::reads(httplib::Server& server) {
  const auto json = [this, &server](const char* path, auto make) {
    server.Get(path, [this, make](const Request&, Response& response) {
      const std::lock_guard lock(shared.mutex);
      response.set_content(make(shared), "application/json");
    });
  };
  json("/api/state", [](const SharedModel& s) { return stateJson(s); });
  json("/api/track", [](const SharedModel& s) { return trackJson(*s.model); });
  json("/api/history", [](const SharedModel& s) { return historyJson(*s.model); });
  server.Get("/api/map", [this](const Request& request, Response& response) {
    const std::lock_guard lock(shared.mutex);
    const MonitorModel& model = *shared.model;
    const std::int64_t base = model.history().start();
    response.set_header("X-Epoch", epochOf(shared));
    response.set_content(mapBinary(model.map().store(), model.map().surface(), sinceOf(request), base),
                         "application/octet-stream");
  });
  server.Get("/api/coverage", [this](const Request&, Response& response) {
    const std::lock_guard lock(shared.mutex);
    response.set_content(coverageBinary(shared.model->coverage(shared.now_utc_ns)),
                         "application/octet-stream");
  });
  server.Get("/api/profile", [this](const Request& request, Response& response) {
    std::array<double, 4> line{};
    constexpr std::array<const char*, 4> kNames{"n0", "e0", "n1", "e1"};
    for (std::size_t i = 0; i < 4; ++i) {
      const std::string text = request.get_param_value(kNames[i]);
      const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), line[i]);
      if (error != std::errc() || end != text.data() + text.size() ||
          !(std::abs(line[i]) <= kMaxHorizontal_m))
        return refuse(response, kBadRequest, "needs n0, e0, n1, e1: places in nav [m]");
    }
    const std::lock_guard lock(shared.mutex);
    response.set_content(profileJson(*shared.model, line[0], line[1], line[2], line[3]), "application/json");
  });
  server.Get("/api/events", [this](const Request&, Response& response) { events(response); });
}

void WebServer::Impl::exports(httplib::Server& server) {
  for (const std::string_view name : kExportNames) {
    server.Get("/api/export/" + std::string(name), [this, name](const Request&, Response& response) {
      Export made;
      try {
        const std::lock_guard lock(shared.mutex);
        made = makeExport(*shared.model, name);
      } catch (const std::runtime_error& error) {
        return refuse(response, kFailed, error.what());
      }
      if (made.bytes.empty()) return refuse(response, kNotFound, "Not yet: " + made.why + ".");
      response.set_header("Content-Disposition", "attachment; filename=\"" + std::string(name) + "\"");
      response.set_content(made.bytes, made.type);
    });
  }
}

void WebServer::Impl::posts(httplib::Server& server) {
  // parse(body, why) gives what is wanted, take(wanted, response) takes it or refuses.
  const auto post = [this, &server](const char* path, auto parse, auto take) {
    server.Post(path, [this, parse, take](const Request& request, Response& response) {
      std::string why;
      const auto wanted = parse(request.body, why);
      if (!wanted) return refuse(response, kBadRequest, why);
      const std::lock_guard lock(shared.mutex);
      take(*wanted, response);
      if (response.body.empty()) response.set_content("{}", "application/json");
    });
  };
  post("/api/request", parseRequest, [this](const telemetry::Request& wanted, Response& response) {
    if (const std::string why = shared.whySilent(); !why.empty()) return refuse(response, kConflict, why);
    if (!shared.model->ask(wanted, shared.now_utc_ns))
      refuse(response, kBusy, "too many requests wait for the ship's turn");
  });
  post("/api/fix", parseFix, [this](const telemetry::UsblFixMessage& fix, Response& response) {
    if (const std::string why = shared.whySilent(); !why.empty()) return refuse(response, kConflict, why);
    if (!shared.model->tellFix(fix)) refuse(response, kBadRequest, "the fix is out of bounds");
  });
  post("/api/playback", parsePlayback, [this](const PlaybackWish& wish, Response& response) {
    if (!shared.playback) return refuse(response, kConflict, "this is a live link, not a recording");
    if (shared.wishes.size() >= SharedModel::kMaxWishes)
      return refuse(response, kBusy, "too many wishes wait");
    shared.wishes.push_back(wish);
  });
}

void WebServer::Impl::events(Response& response) {
  if (streams.fetch_add(1) >= kMaxEventStreams) {
    --streams;
    response.status = kBusy;
    return;
  }
  auto seen = std::make_shared<std::string>();
  response.set_chunked_content_provider(
      "text/event-stream",
      [this, seen](std::size_t, httplib::DataSink& sink) {
        std::string line = ": quiet\n\n";
        const auto now = [this] {
          std::string text =
              R"({"epoch":")" + epochOf(shared) + R"(","version":)" + std::to_string(shared.model->version());
          if (shared.playback)
            text += R"(,"at":)" + std::to_string(shared.playback->at_utc_ns / 1'000'000'000);
          return text + "}";
        };
        {
          std::unique_lock lock(shared.mutex);
          shared.grew.wait_for(lock, kHeartbeat, [&] { return shared.closing || now() != *seen; });
          if (shared.closing) {
            lock.unlock();
            sink.done();
            return true;
          }
          if (std::string text = now(); text != *seen) {
            line = "data: " + text + "\n\n";
            *seen = std::move(text);
          }
        }
        if (!sink.write(line.data(), line.size())) return false;
        std::this_thread::sleep_for(kEventInterval);
        return true;
      },
      [this](bool) { --streams; });
}

WebServer::WebServer(SharedModel& shared, web::PageServerConfig config)
    : impl_(std::make_unique<Impl>(shared)) {
  config.threads = kThreads;
  config.max_body_bytes = kMaxBodyBytes;
  impl_->page.emplace(config, [this](httplib::Server& server) {
    impl_->reads(server);
    impl_->exports(server);
    impl_->posts(server);
  });
}

WebServer::~WebServer() {
  {
    const std::lock_guard lock(impl_->shared.mutex);
    impl_->shared.closing = true;
  }
  impl_->shared.grew.notify_all();
}

int WebServer::port() const {
  return impl_->page->port();
}

}  // namespace fathom::monitor
